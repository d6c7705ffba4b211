"""Vehicles that leave the middle of their lane: counted on made-up tracks, and compared between widths of sublanes."""

import numpy as np
import pytest

from isac_cosim.benchmarks.findings.driving.abandoned_changes import (
    LONG_S,
    AbandonedChange,
    excursions,
    traffic_left_alone,
)
from isac_cosim.isacsim.traffic.recordings.recording import Track

STEP = 0.01


def track(lateral: np.ndarray) -> Track:
    still, lane = np.zeros(len(lateral)), np.zeros(len(lateral), np.int64)
    return Track("v", "passenger", 4.5, 1.8, 0, still, lateral, still, lane, still, lateral)


def test_a_vehicle_that_stops_aside_and_comes_back_is_an_excursion() -> None:
    """Out at 1 m/s to 1 m, there for 2 s, and back: aside for 0.5 + 2 + 0.5 s."""
    ramp = np.arange(0.0, 1.0, STEP)
    path = np.concatenate([np.zeros(100), ramp, np.ones(200), ramp[::-1], np.zeros(100)])
    (excursion,) = excursions(track(path), STEP)
    assert not excursion.crosses
    assert excursion.lasts_s == pytest.approx(3.0, abs=0.05)
    assert excursion.stopped_s == pytest.approx(2.0, abs=0.05)


def test_a_vehicle_that_crosses_the_marking_is_one_excursion_without_a_stop() -> None:
    path = np.arange(0.0, 3.6, STEP)
    path[path > 1.8] -= 3.6
    (excursion,) = excursions(track(np.concatenate([np.zeros(50), path, np.zeros(50)])), STEP)
    assert excursion == AbandonedChange(True, pytest.approx(2.6, abs=0.05), 0.0)


@pytest.mark.slow
def test_whole_lanes_end_the_stops_of_narrow_sublanes() -> None:
    def counts(sublane_m: float) -> tuple[int, int, int]:
        recording = traffic_left_alone("motorway", 7, 60.0, sublane_m)
        seen = [excursion for track in recording.tracks.values() for excursion in excursions(track, recording.step_s)]
        back = [excursion for excursion in seen if not excursion.crosses]
        return len(seen) - len(back), len(back), sum(excursion.stopped_s > LONG_S for excursion in seen)

    across, back, stopped = counts(5.0)
    narrow_across, narrow_back, narrow_stopped = counts(0.8)
    assert across > 0.7 * narrow_across
    assert back < 0.7 * narrow_back
    assert stopped < 0.4 * narrow_stopped
