"""What is found in the cells: nothing but noise seldom, every lone point where it is, no sidelobes."""

from __future__ import annotations

import numpy as np
import pytest

from isac_cosim.benchmarks.scene_cube import tensor
from isac_cosim.isacsim.radio.waveform import Waveform
from isac_cosim.isacsim.scene.cells import CellGrid, Echoes, draw
from isac_cosim.isacsim.scene.detection import detect, threshold
from isac_cosim.isacsim.scene.settings import NUMEROLOGIES

NR100 = CellGrid.of(NUMEROLOGIES["nr100"].waveform, 350.0)


def test_lone_points_are_found_where_they_are() -> None:
    rng = np.random.default_rng(1)
    measured = np.stack([rng.uniform(-0.8, 0.8, 9), np.linspace(20, 340, 9), rng.uniform(-40, 40, 9)], axis=1)
    echoes = Echoes(measured, np.exp(2j * np.pi * rng.random(9)))
    found = detect(draw(echoes, NR100, rng), NR100, 1e-6, rng)
    assert len(found) == 9
    order = np.argsort(found.measured[:, 1])
    apart = (found.measured[order] - measured) * NR100.per_unit
    assert np.abs(apart).max() < 5e-3
    assert found.power == pytest.approx(found.power.mean(), rel=1.0)


def test_sidelobes_of_a_strong_point_are_no_detections() -> None:
    """60 dB above the threshold, between cells on all axes; the whole echo, so that no sidelobe is left out."""
    waveform = Waveform(subcarriers=64, symbols=16, antennas=8, subcarrier_spacing_hz=480e3, cyclic_prefix_s=None)
    grid, rng = CellGrid(waveform, 48), np.random.default_rng(2)
    echoes = Echoes(np.array([[0.5, 20.5, 0.5]]) / grid.per_unit, np.array([30.0 + 0j]))
    assert len(detect(tensor(echoes, grid, rng), grid, 1e-6, rng)) == 1


@pytest.mark.slow
def test_noise_alone_is_found_as_often_as_the_settings_say() -> None:
    """Both where nothing is drawn, and in an echo that is noise throughout."""
    waveform = Waveform(subcarriers=32, symbols=8, antennas=8, cyclic_prefix_s=None)
    grid, rng = CellGrid(waveform, 30), np.random.default_rng(3)
    nothing = Echoes(np.empty((0, 3)), np.empty(0, np.complex128))
    rate = 0.2
    for draw_cells in (draw, tensor):
        found = [len(detect(draw_cells(nothing, grid, rng), grid, rate, rng)) for _ in range(1500)]
        # Exceedances of neighbours are one peak, and the outermost ranges have none: a little less than the rate.
        assert 0.6 * rate < np.mean(found) < 1.15 * rate
    assert threshold(grid, 1e-3) == pytest.approx(np.log(8 * 30 * 8 / 1e-3))
