"""The DFT block against the full tensor, which draws every number and knows nothing of the target's place."""

import numpy as np
import pytest
import torch
from scipy import stats

import isac_cosim.benchmarks.echo
from isac_cosim.isacsim.radio.echo import BLOCK, DEGREES, _kernel, draw_bins, draw_search, fourth_moment, spread
from isac_cosim.isacsim.radio.echo_tensor import observe_tensor, synthesise
from isac_cosim.isacsim.radio.estimators import ESTIMATORS
from isac_cosim.isacsim.radio.waveform import Waveform, centred, steering

WAVEFORM = Waveform()

pytestmark = pytest.mark.usefixtures("one_thread")


def anywhere(count: int, seed: int) -> np.ndarray:
    """Targets anywhere in and between cells, away from the ambiguities."""
    rng = np.random.default_rng(seed)
    return np.stack([rng.uniform(-3, 3, count), rng.uniform(-100, -20, count), rng.uniform(-15, 15, count)], axis=1)


def test_tensor_is_equation_1() -> None:
    cells = np.array([[1.3, -4.6, 2.2]])
    quiet = synthesise(
        torch.as_tensor(cells), torch.tensor([1e12]), WAVEFORM, torch.Generator().manual_seed(0), torch.complex128
    )
    sine, distance, radial = WAVEFORM.measured(cells)[0]
    p, n, m = np.meshgrid(*(np.arange(k) for k in WAVEFORM.shape), indexing="ij")
    delay, doppler = 2 * distance / 299_792_458, -2 * radial * WAVEFORM.carrier_hz / 299_792_458
    expected = np.exp(
        2j * np.pi * (0.5 * p * sine - n * WAVEFORM.subcarrier_spacing_hz * delay + m * WAVEFORM.symbol_s * doppler)
    )
    echo = quiet[0].numpy()
    assert np.abs(echo / echo[0, 0, 0] - expected).max() < 1e-4


@pytest.mark.parametrize("axis", range(3))
def test_kernels_are_the_moments_of_a_tone(axis: int) -> None:
    """Against the sums they stand for: h_d of a unit tone at a distance of x cells."""
    count = WAVEFORM.shape[axis]
    scaled = centred(count) / spread(count)
    weights = [np.ones(count), -1j * scaled, -(scaled**2 - 1) / np.sqrt(fourth_moment(count) - 1)]
    gram = np.array([[np.vdot(a, b) / count for a in weights] for b in weights])
    assert np.abs(gram - np.eye(3)).max() < 1e-12
    for degree, weight in enumerate(weights):
        distance, values = _kernel(count, degree)
        for x in (-2.3, 0.0, 0.5, 1.7):
            expected = (weight * steering(np.array(-x), count)).mean()
            assert abs(np.interp(x, distance, values) - expected) < 1e-5


def test_bins_and_moments_have_the_covariance_of_white_noise() -> None:
    """Moments drawn with their cells are white among themselves, and correlate with a cell by that cell's kernel."""
    count = 40_000
    place = np.array([0.31, -50.2, 4.4])
    cells = np.tile(place, (count, 1))
    bins, moments = draw_search(cells, np.full(count, 1e-9), WAVEFORM, np.random.default_rng(3))
    gram = moments.noise @ moments.noise.conj().T / count
    assert np.abs(gram - np.eye(10)).max() < 6 / np.sqrt(count)
    near = BLOCK // 2
    seen = moments.noise @ bins.values[:, near, near, near].conj() / count
    offset = place - (bins.first[0] + near)
    for row, degrees in enumerate(DEGREES):
        kernels = [np.interp(offset[k], *_kernel(WAVEFORM.shape[k], degrees[k])) for k in range(3)]
        assert abs(seen[row] - np.prod(kernels)) < 6 / np.sqrt(count)


def test_half_cells_overlap_as_in_a_padded_transform() -> None:
    count = 20_000
    bins = draw_bins(
        np.tile([0.2, -50.1, 3.0], (count, 1)), np.full(count, 1e-9), "half", WAVEFORM, np.random.default_rng(4)
    )
    values = bins.values
    step = [np.mean(values[:, 0, 0, 0] * values[(slice(None), *np.eye(3, dtype=int)[k])].conj()) for k in range(3)]
    expected = [np.interp(0.5, *_kernel(n, 0)) for n in WAVEFORM.shape]
    assert np.abs(np.array(step) - expected).max() < 6 / np.sqrt(count)


@pytest.mark.parametrize("snr_db", [-30, -20, 0, 20])
def test_block_and_tensor_give_estimates_of_one_law(snr_db: int) -> None:
    """Kolmogorov-Smirnov on each coordinate's error; the tensor's estimator starts from its own coarse search."""
    count, snr = 500, 10 ** (snr_db / 10)
    cells = anywhere(count, 5)
    slow = observe_tensor(cells, np.full(count, snr), ESTIMATORS["ml"], WAVEFORM, 6)
    fast_cells = anywhere(20 * count, 7)
    fast = ESTIMATORS["ml"].observe(fast_cells, np.full(20 * count, snr), WAVEFORM, np.random.default_rng(8))
    slow_error, fast_error = slow.cells - cells, fast.cells - fast_cells
    on_target = np.all(np.abs(slow_error) < 1, axis=1), np.all(np.abs(fast_error) < 1, axis=1)
    for axis in range(3):
        assert stats.ks_2samp(slow_error[on_target[0], axis], fast_error[on_target[1], axis]).pvalue > 1e-3
    assert stats.ks_2samp(slow.power, fast.power).pvalue > 1e-3


@pytest.mark.parametrize("estimator", ["candan", "grid", "padded_grid", "padded_parabola"])
def test_block_and_tensor_agree_for_the_coarser_estimators(estimator: str) -> None:
    cells, fast_cells = anywhere(250, 9), anywhere(5000, 10)
    slow = observe_tensor(cells, np.full(250, 1.0), ESTIMATORS[estimator], WAVEFORM, 11)
    fast = ESTIMATORS[estimator].observe(fast_cells, np.full(5000, 1.0), WAVEFORM, np.random.default_rng(12))
    for axis in range(3):
        assert stats.ks_2samp((slow.cells - cells)[:, axis], (fast.cells - fast_cells)[:, axis]).pvalue > 1e-3


def outliers(estimated: np.ndarray, cells: np.ndarray) -> int:
    return int(np.any(np.abs(estimated - cells) > 1, axis=1).sum())


@pytest.mark.parametrize(
    "snr_db",
    [
        -31,
        pytest.param(-34, marks=pytest.mark.slow),
        *(pytest.param(s, marks=pytest.mark.slow) for s in (-33, -32, -30, -28, -25, -22)),
    ],
)
def test_outlier_rates_agree_through_the_threshold(snr_db: int) -> None:
    snr = 10 ** (snr_db / 10)
    count, fast_count = 600, 12_000
    cells, fast_cells = anywhere(count, 13), anywhere(fast_count, 14)
    slow = outliers(observe_tensor(cells, np.full(count, snr), ESTIMATORS["ml"], WAVEFORM, 15).cells, cells)
    fast = outliers(
        ESTIMATORS["ml"].observe(fast_cells, np.full(fast_count, snr), WAVEFORM, np.random.default_rng(16)).cells,
        fast_cells,
    )
    table = [[slow, count - slow], [fast, fast_count - fast]]
    assert stats.fisher_exact(table).pvalue > 1e-3


@pytest.mark.slow
def test_the_bench_reports_what_it_promises() -> None:
    result = isac_cosim.benchmarks.echo.run()
    assert {"reference", "window", "tensor"} <= result["snapshots_per_s"].keys()
    assert result["ratio_window"] > 0
    for method in ("window", "tensor"):
        assert set(result["rmse_over_bound"][method]) == {"-25 dB", "-20 dB", "-10 dB", "0 dB", "10 dB", "20 dB"}
    assert np.max(list(result["rmse_over_bound"]["window"].values())) < 1.1
