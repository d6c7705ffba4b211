"""Numerology: sizes of a cell, and the way between physical quantities and cells."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.isacsim.radio.waveform import LIGHT_SPEED_MPS, Waveform, centred, steering

WAVEFORM = Waveform()


def test_the_size_of_a_cell() -> None:
    """39 m and 28.6 m/s; a quarter of the sine, 14 degrees at broadside."""
    size = 1 / np.abs(WAVEFORM.cells_per_unit)
    assert size[1:] == pytest.approx([39.0, 28.6], rel=0.003)
    assert np.degrees(np.arcsin(size[0])) == pytest.approx(14.5, abs=0.1)
    assert WAVEFORM.size == 43_008


@settings(max_examples=100, deadline=None)
@given(sine=st.floats(-0.99, 0.99), distance=st.floats(1, 4900), speed=st.floats(-590, 590))
def test_cells_and_back(sine: float, distance: float, speed: float) -> None:
    measured = np.array([[sine, distance, speed]])
    assert WAVEFORM.measured(WAVEFORM.cells(measured)) == pytest.approx(measured, abs=1e-9, rel=1e-12)


@settings(max_examples=30, deadline=None)
@given(turns=st.tuples(*[st.integers(-3, 3)] * 3))
def test_cells_a_whole_axis_apart_are_one(turns: tuple[int, int, int]) -> None:
    measured = np.array([[0.3, 120.0, -17.0]])
    moved = WAVEFORM.cells(measured) + np.array(turns) * WAVEFORM.shape
    assert WAVEFORM.measured(moved) == pytest.approx(measured, abs=1e-6)


def test_a_receding_target_lowers_the_frequency() -> None:
    """Doppler shift -2 v f / c, turning the phase by 2 pi f T a symbol."""
    doppler = -2 * 10.0 * WAVEFORM.carrier_hz / LIGHT_SPEED_MPS
    cells = WAVEFORM.cells(np.array([0.0, 50.0, 10.0]))
    tone = steering(cells[2], WAVEFORM.symbols)
    assert tone[1] / tone[0] == pytest.approx(np.exp(2j * np.pi * doppler * WAVEFORM.symbol_s))


def test_steering_is_equation_2_about_the_centre() -> None:
    sine = 0.37
    cells = WAVEFORM.cells(np.array([sine, 0.0, 0.0]))[0]
    phasors = steering(cells, 8)
    assert phasors / phasors[0] == pytest.approx(np.exp(2j * np.pi * 0.5 * np.arange(8) * sine))
    assert centred(8).sum() == 0
