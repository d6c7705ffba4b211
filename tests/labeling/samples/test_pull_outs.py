"""Pull-outs: when the TV passes the UV, until when that is observed, and which pull-outs are in no class."""

from __future__ import annotations

from dataclasses import replace
from math import isnan

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from isac_cosim.isacsim.traffic.motion import MotionSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Event, Intention
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.samples.candidates import Candidate, Candidates, RecordSettings, candidates
from isac_cosim.labeling.samples.pull_outs import PullOut, observed_pass, pull_out_of
from isac_cosim.labeling.samples.uv_choice import PairSettings
from tests.support.drives import WIDTH_M, Drive, Road, Stretch, record, sweep, total

ONSET_S = 10.0


def traffic(
    gap_m: float, closing_mps: float, tv_s: float = 60.0, uv_s: float = 60.0, returns_at: float | None = None
) -> Recording:
    """A TV pulls out at 10 s, its front `gap_m` behind that of a UV on which it gains so much."""
    lateral = sweep(ONSET_S, 4.0, WIDTH_M)
    if returns_at is not None:
        lateral = total(lateral, sweep(returns_at, 4.0, -WIDTH_M))
    return record(
        Road(),
        Drive("tv", 0.0, 24.0 + closing_mps, lateral, tv_s),
        Drive("uv", gap_m + ONSET_S * closing_mps, 24.0, 0.0, uv_s, kind="truck"),
    )


def offered(recording: Recording) -> Candidates:
    pairs = PairSettings(tv_kinds=("passenger",))
    return candidates(recording, label(recording, LabelSettings()), pairs, RecordSettings())


def pull_outs(recording: Recording) -> tuple[list[Candidate], list[Candidate]]:
    """The pull-outs among the samples, and the dropped ones."""
    result = offered(recording)
    return [sample for sample in result.samples if sample.pull_out is not None], list(result.dropped_pull_outs)


@settings(max_examples=12, deadline=None)
@given(
    gap_m=st.floats(5.0, 90.0), closing_mps=st.floats(0.5, 12.0), tv_s=st.floats(12.0, 60.0), uv_s=st.floats(12.0, 60.0)
)
def test_the_time_of_passing_is_that_of_the_fronts(gap_m: float, closing_mps: float, tv_s: float, uv_s: float) -> None:
    tv_s, uv_s = round(tv_s, 2), round(uv_s, 2)
    observed = observed_pass(Surroundings(traffic(gap_m, closing_mps, tv_s, uv_s)), "tv", "uv", ONSET_S)
    assert observed is not None
    t_pass, t_pair_end = observed
    assert t_pair_end == pytest.approx(min(tv_s, uv_s))
    expected = ONSET_S + gap_m / closing_mps
    if expected > t_pair_end:
        assert isnan(t_pass)
    else:
        assert t_pass == pytest.approx(expected, abs=0.01)


def test_a_uv_that_is_not_ahead_is_not_passed() -> None:
    recording = traffic(40.0, 8.0)
    assert observed_pass(Surroundings(recording), "uv", "tv", ONSET_S) is None
    assert observed_pass(Surroundings(recording), "tv", "uv", 15.1) is None


def test_the_pair_is_observed_until_the_uv_turns_off() -> None:
    """Off the road that the TV drives, the UV is not observed, although its track goes on."""
    road = Road((Stretch(800.0), Stretch(4000.0)))
    recording = record(road, Drive("tv", 0.0, 30.0, sweep(ONSET_S, 4.0, WIDTH_M)), Drive("uv", 100.0, 28.0))
    exit_lane = replace(recording.lanes[0], id="exit_0", edge="exit")
    track = recording.tracks["uv"]
    lane = np.where(track.lane >= 3, len(recording.lanes), track.lane).astype(np.int32)
    turned = replace(track, lane=lane)
    forked = replace(recording, lanes=(*recording.lanes, exit_lane), tracks={**recording.tracks, "uv": turned})
    observed = observed_pass(Surroundings(forked), "tv", "uv", ONSET_S)
    assert observed is not None
    assert isnan(observed[0])
    assert observed[1] == pytest.approx(700.0 / 28.0, abs=0.11)
    straight = observed_pass(Surroundings(recording), "tv", "uv", ONSET_S)
    assert straight is not None
    assert straight[0] == pytest.approx(50.0, abs=0.01)


@pytest.mark.parametrize(
    ("tv_s", "returns_at", "outcome", "intention"),
    [
        (60.0, 20.0, "overtaken", Intention.OVERTAKE),
        (60.0, None, "passed_did_not_return", Intention.LEFT_LANE_CHANGE),
        (30.0, None, "unresolved", Intention.LEFT_LANE_CHANGE),
    ],
)
def test_pull_outs_by_their_outcome(tv_s: float, returns_at: float | None, outcome: str, intention: Intention) -> None:
    recording = traffic(40.0, 8.0, tv_s, returns_at=returns_at)
    samples, dropped = pull_outs(recording)
    [pull_out] = samples + dropped
    assert pull_out.intention is intention
    assert pull_out.pull_out is not None
    assert pull_out.pull_out.outcome == outcome
    assert pull_out.pull_out.t_pass == pytest.approx(15.0)
    assert pull_out.pull_out.t_pair_end == pytest.approx(tv_s)
    assert pull_out.pull_out.dropped == bool(dropped) == (outcome != "overtaken")
    assert offered(recording).left_out.get(outcome, 0) == len(dropped)


def test_a_change_that_does_not_pass_is_a_sample_with_its_answer() -> None:
    samples, dropped = pull_outs(traffic(40.0, 0.5))
    [change] = samples
    assert dropped == []
    assert change.pull_out is not None
    assert change.pull_out.outcome == "not_passed"
    assert isnan(change.pull_out.t_pass)


def test_other_events_are_no_pull_outs() -> None:
    surroundings = Surroundings(traffic(40.0, 8.0))
    change = Event("tv", Intention.LEFT_LANE_CHANGE, ONSET_S, 12.0, 14.0, 1.0)
    assert pull_out_of(surroundings, change, "uv") == PullOut("not_passed", pytest.approx(15.0), 60.0)
    for intention in (Intention.HARD_BRAKE, Intention.RIGHT_LANE_CHANGE):
        assert pull_out_of(surroundings, replace(change, intention=intention), "uv") is None
    assert pull_out_of(surroundings, replace(change, mark="of another detector"), "uv") is None
    lefthand = Surroundings(replace(surroundings.recording, lefthand=True))
    assert pull_out_of(lefthand, replace(change, intention=Intention.RIGHT_LANE_CHANGE), "uv") is not None


def test_a_dropped_pull_out_that_no_car_can_drive_is_left_out_under_its_outcome() -> None:
    recording = traffic(40.0, 8.0)
    track = recording.tracks["tv"]
    shaken = np.where((np.arange(len(track)) // 100) % 2 == 0, 0.0, 0.25)
    rough = replace(recording, tracks={**recording.tracks, "tv": replace(track, y=track.y + shaken)})
    pairs = PairSettings(tv_kinds=("passenger",))
    plane = MotionSettings(max_shift_m=0.0)
    result = candidates(rough, label(rough, LabelSettings()), pairs, RecordSettings(), motion=plane)
    assert result.dropped_pull_outs == ()
    assert result.left_out["passed_did_not_return"] == 1
