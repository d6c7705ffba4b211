"""The estimators against the bound, and maximum likelihood against scoring on the same full echo."""

import subprocess
import sys

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from isac_cosim.isacsim.radio.bounds import cell_bound
from isac_cosim.isacsim.radio.echo import DEGREES, Moments, draw_moments, fourth_moment, spread
from isac_cosim.isacsim.radio.echo_tensor import observe_tensor
from isac_cosim.isacsim.radio.estimation import Estimates
from isac_cosim.isacsim.radio.estimators import ESTIMATORS
from isac_cosim.isacsim.radio.estimators.candan import candan_offset
from isac_cosim.isacsim.radio.estimators.grid import vertex
from isac_cosim.isacsim.radio.estimators.maximum_likelihood import maximum_likelihood
from isac_cosim.isacsim.radio.estimators.on_tensor import score
from isac_cosim.isacsim.radio.waveform import Waveform, centred, steering
from isac_cosim.isacsim.sensing.chain import SensingSettings
from tests.support.sensing_road import drive, road_sites, sense

WAVEFORM = Waveform()

pytestmark = pytest.mark.usefixtures("one_thread")


def moments_of(noise: np.ndarray, amplitude: float) -> Moments:
    """Moments of a full noise tensor about a target at zero, by the sums that define them."""
    weights = []
    for count in WAVEFORM.shape:
        scaled = centred(count) / spread(count)
        weights.append([np.ones(count), -1j * scaled, -(scaled**2 - 1) / np.sqrt(fourth_moment(count) - 1)])
    partial = np.einsum("ijk,ck->ijc", noise, np.array(weights[2]))
    partial = np.einsum("ijc,bj->ibc", partial, np.array(weights[1]))
    contracted = np.einsum("ibc,ai->abc", partial, np.array(weights[0]))
    values = [contracted[degree] for degree in DEGREES]
    return Moments(np.array([amplitude]), np.array(values)[:, None] / np.sqrt(WAVEFORM.size))


@pytest.mark.parametrize(("snr_db", "within"), [(-30, 0.06), (-20, 0.004), (0, 1e-4)])
def test_moments_and_the_full_echo_give_the_same_estimate(snr_db: float, within: float) -> None:
    """One noise, two ways: the difference is a fraction `within` of the standard deviation."""
    rng = np.random.default_rng(1)
    snr = 10 ** (snr_db / 10)
    differences = []
    for _ in range(20):
        noise = (rng.normal(size=WAVEFORM.shape) + 1j * rng.normal(size=WAVEFORM.shape)) * np.sqrt(0.5)
        offset, power = maximum_likelihood(moments_of(noise, np.sqrt(snr * WAVEFORM.size)), WAVEFORM)
        full, full_power = score(torch.as_tensor(noise + np.sqrt(snr))[None], torch.zeros((1, 3), dtype=torch.float64))
        differences.append(offset[0] - full[0].numpy())
        assert power[0] == pytest.approx(full_power.item(), rel=0.02)
    deviation = cell_bound(np.array(snr), WAVEFORM)
    assert np.all(np.sqrt(np.mean(np.square(differences), axis=0)) < within * deviation)


def matched_filter(t: np.ndarray, moments: Moments) -> tuple[np.ndarray, np.ndarray]:
    """The matched filter at scaled offsets (3, B) and its slopes, (B,) and (3, B), by the sum over all moments."""
    fourth = np.array([fourth_moment(n) for n in WAVEFORM.shape])[:, None]
    root = np.sqrt(fourth - 1)
    factors = np.array([1 - t**2 / 2 + fourth / 24 * t**4, t * (1 - fourth / 6 * t**2), root / 2 * t**2])
    slopes = np.array([-factors[1], 1 - fourth / 2 * t**2, root * t])
    noise = moments.noise.copy()
    noise[0] += moments.amplitude
    total = np.zeros((4, t.shape[1]), np.complex128)
    for degree, moment in zip(DEGREES, noise, strict=True):
        total[0] += moment * factors[degree, range(3)].prod(axis=0)
        for axis in range(3):
            others = [factors[degree[k], k] for k in range(3) if k != axis]
            total[1 + axis] += moment * slopes[degree[axis], axis] * others[0] * others[1]
    return total[0], total[1:]


def test_the_climb_is_that_of_complex_numbers_summed_over_all_moments() -> None:
    rng = np.random.default_rng(2)
    moments = draw_moments(10 ** (rng.uniform(-20, 10, 200) / 10), WAVEFORM, rng)
    scaled = np.zeros((3, 200))
    for _ in range(4):
        filtered, slopes = matched_filter(scaled, moments)
        scaled = scaled + (filtered.conj() * slopes).real / np.abs(filtered) ** 2
    offset, power = maximum_likelihood(moments, WAVEFORM)
    cells_per_scaled = [n / (2 * np.pi * spread(n)) for n in WAVEFORM.shape]
    np.testing.assert_allclose(offset, scaled.T * cells_per_scaled, atol=1e-12)
    np.testing.assert_allclose(power, np.abs(filtered) ** 2, rtol=1e-12)


@pytest.mark.parametrize("snr_db", [-25, -20, -10, 0, 10, 20])
def test_maximum_likelihood_is_on_the_bound_anywhere_between_cells(snr_db: float) -> None:
    count = 8000
    rng = np.random.default_rng(2)
    fraction = np.stack(np.meshgrid(*[[0.0, 0.25, 0.5]] * 3), axis=-1).reshape(-1, 3)
    cells = np.array([1.0, -40.0, 5.0]) + fraction[rng.integers(len(fraction), size=count)]
    snr = np.full(count, 10 ** (snr_db / 10))
    error = ESTIMATORS["ml"].observe(cells, snr, WAVEFORM, rng).cells - cells
    ratio = np.sqrt(np.mean(error**2, axis=0)) / cell_bound(snr[0], WAVEFORM)
    assert np.all(ratio < 1.05)
    assert np.all(ratio > 0.97)


@pytest.mark.parametrize("snr_db", [-25, 0, 20])
def test_maximum_likelihood_on_the_tensor_is_on_the_bound(snr_db: float) -> None:
    count = 240
    rng = np.random.default_rng(3)
    cells = np.array([1.0, -40.0, 5.0]) + rng.choice([0.0, 0.25, 0.5], size=(count, 3))
    snr = np.full(count, 10 ** (snr_db / 10))
    error = observe_tensor(cells, snr, ESTIMATORS["ml"], WAVEFORM, 4).cells - cells
    ratio = np.sqrt(np.mean((error / cell_bound(snr[0], WAVEFORM)) ** 2))
    # 240 echoes leave a standard error of 2.6 % over three axes.
    assert ratio < 1.1


def test_the_grids_err_by_their_cell() -> None:
    rng = np.random.default_rng(5)
    cells = np.stack([rng.uniform(-3, 3, 4000), rng.uniform(-90, -10, 4000), rng.uniform(-9, 9, 4000)], axis=1)
    for estimator, width in (("grid", 1.0), ("padded_grid", 0.5)):
        error = ESTIMATORS[estimator].observe(cells, np.full(4000, 10.0), WAVEFORM, rng).cells - cells
        assert np.sqrt(np.mean(error**2, axis=0)) == pytest.approx(width / np.sqrt(12) * np.ones(3), rel=0.04)


def test_candan_is_twice_the_bound_at_every_snr() -> None:
    rng = np.random.default_rng(6)
    cells = np.array([1.0, -40.0, 5.0]) + rng.random((4000, 3))
    for snr in (0.1, 1.0, 100.0):
        error = ESTIMATORS["candan"].observe(cells, np.full(4000, snr), WAVEFORM, rng).cells - cells
        assert np.sqrt(np.mean(error**2, axis=0)) / cell_bound(np.array(snr), WAVEFORM) == pytest.approx(2.15, rel=0.07)


def test_a_parabola_leaves_a_hundredth_of_a_cell_at_every_snr() -> None:
    """So its error over the bound grows with the SNR: 4 times at 0 dB."""
    rng = np.random.default_rng(6)
    cells = np.array([1.0, -40.0, 5.0]) + rng.random((4000, 3))
    for snr, over_bound in ((1.0, 4.1), (100.0, 40.0)):
        error = ESTIMATORS["padded_parabola"].observe(cells, np.full(4000, snr), WAVEFORM, rng).cells - cells
        rms = np.sqrt(np.mean(error**2, axis=0))
        assert rms / cell_bound(np.array(snr), WAVEFORM) == pytest.approx(over_bound, rel=0.06)
        assert rms == pytest.approx(0.0075, rel=0.1)


@given(st.floats(-0.5, 0.5), st.floats(0.1, 10), st.floats(-5, 5))
def test_the_vertex_of_a_parabola_is_exact(at: float, bend: float, height: float) -> None:
    low, peak, high = (np.array(height - bend * (k - at) ** 2) for k in (-1, 0, 1))
    assert vertex(low, peak, high) == pytest.approx(at, abs=1e-9)


@settings(max_examples=50, deadline=None)
@given(offset=st.floats(-0.5, 0.5), count=st.sampled_from([8, 42, 128]))
def test_candan_of_a_clean_tone_is_exact(offset: float, count: int) -> None:
    tone = steering(np.array(offset), count)
    low, peak, high = (np.atleast_1d(np.vdot(steering(np.array(float(k)), count), tone)) for k in (-1, 0, 1))
    assert candan_offset(low, peak, high, count)[0] == pytest.approx(offset, abs=1e-9)


def test_noise_that_outshines_the_target_is_anywhere() -> None:
    """Far below the threshold the estimates fill the whole search space evenly."""
    count = 3000
    cells = np.tile([0.5, -20.0, 1.0], (count, 1))
    estimates = ESTIMATORS["ml"].observe(cells, np.full(count, 1e-5), WAVEFORM, np.random.default_rng(7))
    sine, distance, radial = WAVEFORM.measured(estimates.cells).T
    assert np.quantile(distance, [0.25, 0.75]) == pytest.approx([1249, 3747], rel=0.05)
    assert abs(np.mean(sine)) < 0.05
    assert abs(np.mean(radial)) < 30
    assert np.median(estimates.power) == pytest.approx(13.0, abs=0.3)


def test_an_estimator_that_another_package_offers_works_in_the_chain(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that knows no noise: the chain senses with it, on DFT blocks and on full echoes."""

    class Perfect:
        label = "perfect"

        def observe(self, cells, snr, waveform, rng) -> Estimates:
            return Estimates(cells.copy(), snr * waveform.size)

        def estimate(self, echo):
            return torch.zeros((len(echo), 3), dtype=torch.float64), torch.ones(len(echo), dtype=torch.float64)

        def deviation(self, power, waveform):
            return np.full((len(power), 3), 1e-4)

    with pytest.raises(ValidationError, match="unknown estimator 'perfect'"):
        SensingSettings(estimator="perfect")
    monkeypatch.setitem(ESTIMATORS._items, "perfect", Perfect())
    truth = drive(20, 130.0, 1.0, 25.0)
    record = sense(truth[None], road_sites(), SensingSettings(estimator="perfect"), [("p",)])[0]
    assert np.abs(record.fixes - truth[:4]).max() < 1e-6
    assert observe_tensor(np.ones((3, 3)), np.ones(3), Perfect(), WAVEFORM, 1).power.tolist() == [1, 1, 1]


def test_names_that_are_near_are_suggested() -> None:
    with pytest.raises(ValidationError, match="unknown estimator 'candam': did you mean candan"):
        SensingSettings(estimator="candam")


def test_drawing_dft_blocks_does_not_load_torch() -> None:
    """Workers that only sense would wait seconds for it."""
    code = (
        "import sys, numpy as np; from isac_cosim.isacsim.sensing.chain import SensingSettings; "
        "from tests.support.sensing_road import drive, road_sites, sense; "
        "sense(drive(4, 130.0, 1.0, 25.0)[None], road_sites(), SensingSettings(), [(1,)]); "
        "sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_receivers_deviation_is_its_error() -> None:
    count = 5000
    rng = np.random.default_rng(8)
    cells = np.array([1.0, -40.0, 5.0]) + rng.random((count, 3))
    for estimator in ("ml", "candan", "grid", "padded_grid", "padded_parabola"):
        estimates = ESTIMATORS[estimator].observe(cells, np.full(count, 0.03), WAVEFORM, rng)
        normalised = (estimates.cells - cells) / ESTIMATORS[estimator].deviation(estimates.power, WAVEFORM)
        assert np.sqrt(np.mean(normalised**2)) == pytest.approx(1, abs=0.1)
