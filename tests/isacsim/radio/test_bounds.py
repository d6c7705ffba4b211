"""The bounds against numerical Fisher information, from the echo model's derivatives alone."""

import numpy as np
import pytest

from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.bounds import cell_bound, measured_bound
from isac_cosim.isacsim.radio.waveform import LIGHT_SPEED_MPS, Waveform
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.isacsim.tracking.fusion import position_bound

WAVEFORM = Waveform()


def echo(sine: float, delay_s: float, doppler_hz: float, real: float, imaginary: float) -> np.ndarray:
    """Eq. (1) without noise, flattened."""
    p, n, m = np.meshgrid(*(np.arange(k) for k in WAVEFORM.shape), indexing="ij")
    phase = 0.5 * p * sine - n * WAVEFORM.subcarrier_spacing_hz * delay_s + m * WAVEFORM.symbol_s * doppler_hz
    return ((real + 1j * imaginary) * np.exp(2j * np.pi * phase)).ravel()


def fisher(model, parameters: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Fisher information of a mean in complex white noise of unit variance, by central differences."""
    columns = []
    for k, step in enumerate(steps):
        move = np.eye(len(parameters))[k] * step
        columns.append((model(*(parameters + move)) - model(*(parameters - move))) / (2 * step))
    derivative = np.stack(columns, axis=1)
    return 2 * (derivative.conj().T @ derivative).real


def test_one_echo() -> None:
    snr, sine = 0.5, 0.4
    parameters = np.array([sine, 7e-7, 300.0, np.sqrt(snr) * 0.6, np.sqrt(snr) * 0.8])
    covariance = np.linalg.inv(fisher(echo, parameters, np.array([1e-6, 1e-12, 1e-2, 1e-6, 1e-6])))
    deviation = np.sqrt(np.diag(covariance))
    assert measured_bound(np.array(snr), WAVEFORM) == pytest.approx(
        [deviation[0], deviation[1] * LIGHT_SPEED_MPS / 2, deviation[2] * WAVEFORM.wavelength_m / 2], rel=1e-6
    )


def test_the_figures_at_0_db() -> None:
    # A small sine is its angle.
    assert measured_bound(np.array(1.0), WAVEFORM) == pytest.approx([np.radians(0.027), 0.073, 0.054], rel=0.01)
    assert cell_bound(np.array([0.01, 1.0]), WAVEFORM)[0] == pytest.approx(10 * cell_bound(np.array(1.0), WAVEFORM))


def test_a_fix_of_two_masts() -> None:
    """Position and velocity as parameters of both echoes at once, each echo with an amplitude of its own."""
    sites = [Site("a", -80.0, 20.0, 25.0, 120.0), Site("b", 90.0, -20.0, 10.0, 300.0)]
    snr = np.array([[1.0, 0.3]])

    def echoes(x: float, y: float, vx: float, vy: float, *amplitudes: float) -> np.ndarray:
        parts = []
        for k, site in enumerate(sites):
            azimuth = np.radians(site.azimuth_deg)
            offset = np.array([x - site.x, y - site.y])
            distance = np.sqrt(offset @ offset + (site.height_m - 0.8) ** 2)
            sine = offset @ [np.cos(azimuth), -np.sin(azimuth)] / distance
            radial = offset @ [vx, vy] / distance
            doppler = -2 * radial * WAVEFORM.carrier_hz / LIGHT_SPEED_MPS
            parts.append(echo(sine, 2 * distance / LIGHT_SPEED_MPS, doppler, *amplitudes[2 * k : 2 * k + 2]))
        return np.concatenate(parts)

    state = np.array([10.0, 3.0, 20.0, -2.0])
    amplitudes = np.sqrt(snr[0])[:, None] * [0.6, -0.8]
    information = fisher(echoes, np.concatenate([state, amplitudes.ravel()]), np.full(8, 1e-4))
    expected = np.linalg.inv(information)[:4, :4]
    panels = Panels.of(sites, 0.8).take(np.array([[0, 1]]))
    bound = position_bound(state[None], measured_bound(snr, WAVEFORM), panels)[0]
    assert bound == pytest.approx(expected, rel=1e-4, abs=1e-9)
