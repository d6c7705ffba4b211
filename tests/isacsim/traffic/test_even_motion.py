"""Evenly spaced conditioned states are those of `states`, whatever the rates."""

from __future__ import annotations

import numpy as np
import pytest

from isac_cosim.isacsim.traffic.motion import MotionSettings, even_states, states
from tests.support.drives import Drive, Road, record, sweep

ROAD = Road(curvature=0.002, heading=0.3)


@pytest.mark.parametrize("rate_hz", [400.0, 100.0, 20.0, 1000.0, 70.0, 333.3])
@pytest.mark.parametrize("start_s", [3.0, 3.0037, 5.0125])
def test_even_states_are_those_of_states(rate_hz: float, start_s: float) -> None:
    recording = record(ROAD, Drive("tv", duration_s=12.0, lateral=sweep(4.0, 4.0, 3.2), begin_s=1.0))
    track, settings, count = recording.tracks["tv"], MotionSettings(), round(6 * rate_hz)
    even = even_states(recording, track, start_s, count, rate_hz, settings)
    expected = states(recording, track, start_s + np.arange(count) / rate_hz, settings)
    np.testing.assert_allclose(even, expected, rtol=0, atol=2e-8)


def test_a_whole_track_is_conditioned_to_its_ends() -> None:
    recording = record(ROAD, Drive("tv", duration_s=2.0))
    track, settings = recording.tracks["tv"], MotionSettings()
    even = even_states(recording, track, 0.0, len(track), 100.0, settings)
    np.testing.assert_allclose(even, states(recording, track, recording.times(track), settings), atol=2e-8)
    with pytest.raises(ValueError, match="has no state"):
        even_states(recording, track, 0.0, len(track) + 1, 100.0, settings)
