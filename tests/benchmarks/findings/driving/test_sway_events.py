"""The bench of sway: the same traffic with sway and without, and which events are the same."""

from __future__ import annotations

import numpy as np

from isac_cosim.benchmarks.findings.driving import sway_events as bench
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings
from isac_cosim.labeling.intentions import Event, Intention


def event(vehicle: str, intention: Intention, commit: float, onset: float | None = None) -> Event:
    return Event(vehicle, intention, commit - 1.0 if onset is None else onset, commit, commit + 1.0, 0.0)


def test_events_are_the_same_within_a_second_and_once() -> None:
    still = [event("a", Intention.HARD_BRAKE, 10.0), event("a", Intention.HARD_BRAKE, 30.0)]
    swaying = [
        event("a", Intention.HARD_BRAKE, 10.4, 7.0),
        event("a", Intention.HARD_BRAKE, 31.5),
        event("b", Intention.HARD_BRAKE, 30.0),
        event("a", Intention.LEFT_LANE_CHANGE, 30.0),
    ]
    comparisons: dict[Intention, bench.Comparison] = {}
    bench.compare(still, swaying, comparisons)
    brakes = comparisons[Intention.HARD_BRAKE]
    assert (brakes.still, brakes.swaying) == (2, 3)
    np.testing.assert_allclose(brakes.shifts_s, [-2.0])
    assert bench.cells(brakes, 4.0) == ["2", "3", "1", "2", "0.50", "-2.00 (-2.00 to -2.00)"]
    changes = comparisons[Intention.LEFT_LANE_CHANGE]
    assert (changes.still, changes.swaying, changes.shifts_s) == (0, 1, [])


def test_the_traffic_is_the_same_but_for_the_sway() -> None:
    still, swaying = bench.recordings(load("straight_road"), 1, TrafficSettings(run_in_s=20.0, duration_s=5.0))
    assert still.tracks.keys() == swaying.tracks.keys()
    assert len(still.tracks) > 3
    for vehicle, track in still.tracks.items():
        np.testing.assert_array_equal(track.lane_pos, swaying.tracks[vehicle].lane_pos)
        assert np.ptp(swaying.tracks[vehicle].lane_lat - track.lane_lat) > 0.0
