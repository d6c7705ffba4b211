"""Who is watched, with whom, and when, on a straight road where everything is known."""

from __future__ import annotations

import numpy as np
import pytest

from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.road.straight_road import ScriptedVehicle, straight_road
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.samples.uv_choice import PairSettings
from isac_cosim.labeling.streams.stretches import (
    NO_UV,
    TRACK_ENDS,
    UV_ENDS,
    Timing,
    WatchedStretches,
    watched,
)

TIMING = Timing(
    decision_s=0.1, window_s=2.2, report_delay_s=0.0, run_in_s=0.5, margin_s=0.8, outcome_s=0.0, longest_stretch_s=120.0
)


def driving(recording: Recording, pairs: PairSettings | None = None, timing: Timing = TIMING) -> WatchedStretches:
    return watched(recording, Surroundings(recording), pairs or PairSettings(), timing)


def leader(vehicle: str = "leader", start_m: float = 50.0, lateral: float = 0.0, **more: float) -> ScriptedVehicle:
    return ScriptedVehicle(vehicle, start_m=start_m, lateral=lateral, **more)


def test_a_follower_is_watched_from_its_first_whole_window_to_the_end_of_its_track() -> None:
    watched_driving = driving(straight_road(ScriptedVehicle("tv"), leader()))
    (stretch,) = watched_driving.stretches
    assert (stretch.tv, set(stretch.uv)) == ("tv", {"leader"})
    # 0.8 s for the kernel, 0.5 s for the filter, 2.2 s of window; and 0.8 s at the end of 40 s.
    assert stretch.decision_s[0] == pytest.approx(3.5)
    assert stretch.decision_s[-1] == pytest.approx(39.2)
    np.testing.assert_allclose(np.diff(stretch.decision_s), 0.1)
    assert stretch.start_s == pytest.approx(0.8)
    assert watched_driving.instants == 2 * 401
    assert watched_driving.uncovered == {TRACK_ENDS: 2 * (401 - 358), NO_UV: 358}


def test_no_prediction_comes_so_late_that_its_outcome_stays_open() -> None:
    recording = straight_road(ScriptedVehicle("tv"), leader())
    watched_driving = driving(recording, timing=Timing(**{**TIMING.__dict__, "outcome_s": 6.0}))
    (stretch,) = watched_driving.stretches
    assert stretch.decision_s[0] == pytest.approx(3.5)
    assert stretch.decision_s[-1] == pytest.approx(40.0 - 6.0)
    assert watched_driving.alone[0].decision_s[-1] == pytest.approx(40.0 - 6.0)
    assert watched_driving.uncovered[TRACK_ENDS] == 2 * (401 - 306)


@pytest.mark.parametrize(("gap_m", "watched_too"), [(99.0, True), (101.0, False)])
def test_the_leader_is_within_range(gap_m: float, watched_too: bool) -> None:
    recording = straight_road(ScriptedVehicle("tv"), leader(start_m=gap_m + 5.0))
    assert bool(driving(recording).stretches) == watched_too


def test_a_leader_that_is_not_connected_is_no_uv() -> None:
    recording = straight_road(ScriptedVehicle("tv"), leader())
    assert not driving(recording, PairSettings(connected_share=0.0)).stretches


def test_the_uv_is_the_leader_when_the_window_begins() -> None:
    """The TV crosses to the next lane at 20 s: from then on there is another leader, 2.2 s later another UV."""
    tv = ScriptedVehicle("tv", lateral=[(19.0, 0.0), (21.0, 3.2)])
    recording = straight_road(tv, leader("old"), leader("new", 60.0, 3.2))
    (stretch,) = [stretch for stretch in driving(recording).stretches if stretch.tv == "tv"]
    changed = stretch.decision_s[stretch.uv.index("new")]
    assert changed == pytest.approx(20.0 + 2.2, abs=0.11)
    assert set(stretch.uv[: stretch.uv.index("new")]) == {"old"}


def test_a_uv_has_reported_throughout_the_window() -> None:
    """The leader leaves the road at 20 s; its last useful report is 0.8 s older, because the kernel needs the rest."""
    recording = straight_road(ScriptedVehicle("tv"), leader(duration_s=20.0))
    watched_driving = driving(recording)
    assert watched_driving.stretches[0].decision_s[-1] == pytest.approx(19.2)
    assert watched_driving.uncovered[UV_ENDS] > 0
    late = driving(recording, timing=Timing(**{**TIMING.__dict__, "report_delay_s": 0.5}))
    assert late.stretches[0].decision_s[-1] == pytest.approx(19.7)


def test_a_short_pause_is_sensed_through_and_a_long_one_is_not() -> None:
    """Without a leader for 1 s the TV is sensed on; for 6 s it is not."""
    for away_s, count in ((1.0, 1), (6.0, 2)):
        beside = [(15.0, 0.0), (15.01, 3.2), (15.0 + away_s, 3.2), (15.01 + away_s, 0.0)]
        recording = straight_road(ScriptedVehicle("tv"), ScriptedVehicle("leader", start_m=50.0, lateral=beside))
        stretches = [stretch for stretch in driving(recording).stretches if stretch.tv == "tv"]
        assert len(stretches) == count
        if count == 2:
            assert stretches[1].start_s == pytest.approx(stretches[1].decision_s[0] - 2.7)


def test_a_long_stretch_is_cut_without_losing_a_prediction() -> None:
    recording = straight_road(ScriptedVehicle("tv"), leader())
    whole = driving(recording).stretches[0]
    parts = driving(recording, timing=Timing(**{**TIMING.__dict__, "longest_stretch_s": 12.0})).stretches
    assert len(parts) > 2
    assert all(part.end_s - part.start_s <= 12.0 + 1e-6 for part in parts)
    np.testing.assert_allclose(np.concatenate([part.decision_s for part in parts]), whole.decision_s)


def test_every_instant_has_a_uv_or_none_or_is_at_the_ends() -> None:
    """The leader is gone from 20 s on; the TV is then watched alone, as the leader is all the time."""
    recording = straight_road(ScriptedVehicle("tv"), leader(duration_s=20.0))
    watched_driving = driving(recording)
    with_uv, alone = (
        {(stretch.tv, time) for stretch in stretches for time in stretch.decision_s.tolist()}
        for stretches in (watched_driving.stretches, watched_driving.alone)
    )
    assert not with_uv & alone
    assert ("tv", 25.0) in alone
    assert ("leader", 10.0) in alone
    assert len(with_uv) + len(alone) + watched_driving.uncovered[TRACK_ENDS] == watched_driving.instants
