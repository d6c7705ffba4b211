"""What is the right answer to a decision, by events whose times are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isac_cosim.labeling.intentions import Intention
from isac_cosim.labeling.streams.events import LiveEvent
from isac_cosim.models.hazards.answers import IGNORED, WITH_HAZARD
from isac_cosim.models.hazards.targets import counted_intentions, targets_of

HORIZONS = (0.5, 1.0, 2.0)
LEFT, BRAKE = WITH_HAZARD.index(Intention.LEFT_LANE_CHANGE), WITH_HAZARD.index(Intention.HARD_BRAKE)
TIMES = np.round(np.arange(0, 20, 0.1), 9)


def event(intention: str, onset: float, commit: float, end: float, left_out: str | None = None) -> LiveEvent:
    return LiveEvent(
        vehicle="a", intention=intention, onset=onset, commit=commit, end=end, group="natural", left_out=left_out
    )


def answers(*events: LiveEvent) -> dict[float, tuple[int, ...]]:
    targets = targets_of(events, TIMES, HORIZONS, Intention.LEFT_LANE_CHANGE)
    return dict(zip(TIMES.tolist(), map(tuple, targets.interval.tolist()), strict=True))


@pytest.mark.parametrize(
    ("time_s", "answer"),
    [(7.9, 3), (8.0, 2), (8.9, 2), (9.0, 1), (9.4, 1), (9.5, 0), (10.0, 0), (12.0, 0), (12.1, IGNORED), (15.1, 3)],
)
def test_the_interval_is_that_in_which_the_onset_lies(time_s: float, answer: int) -> None:
    """From onset to commit the intention is under way; what comes between commit and end is no lesson."""
    assert answers(event("left_lane_change", 10.0, 12.0, 15.0))[time_s][LEFT] == answer


@pytest.mark.parametrize("reason", ["near_miss", "no_uv", "not_watched"])
def test_neutral_events_teach_nothing(reason: str) -> None:
    of_time = answers(event("hard_brake", 10.0, 10.4, 12.0, reason))
    assert {of_time[t][BRAKE] for t in (8.0, 9.9, 12.0)} == {IGNORED}
    assert of_time[7.9][BRAKE] == of_time[12.1][BRAKE] == len(HORIZONS)
    assert of_time[9.9][LEFT] == len(HORIZONS)


def test_the_next_event_is_learnt_also_where_the_one_before_has_not_ended() -> None:
    of_time = answers(event("hard_brake", 5.0, 5.4, 12.0), event("hard_brake", 10.0, 10.4, 12.0))
    assert [of_time[t][BRAKE] for t in (5.4, 5.5, 8.0, 10.4, 10.5)] == [0, IGNORED, 2, 0, IGNORED]


@pytest.mark.parametrize(
    ("made", "passing"),
    [
        (event("overtake", 10.0, 12.0, 15.0), 1),
        (event("left_lane_change", 10.0, 12.0, 15.0), 0),
        (event("left_lane_change", 10.0, 12.0, 15.0, "passed_did_not_return"), 1),
        (event("left_lane_change", 10.0, 12.0, 15.0, "unresolved"), IGNORED),
    ],
)
def test_pull_outs_are_changes_of_lane_whatever_becomes_of_them(made: LiveEvent, passing: int) -> None:
    targets = targets_of([made], TIMES, HORIZONS, Intention.LEFT_LANE_CHANGE)
    at = TIMES.tolist().index(10.0)
    assert targets.interval[at, LEFT] == 0
    assert targets.passing[at] == passing
    assert targets.passing[TIMES < 7.9].tolist() == [IGNORED] * int((TIMES < 7.9).sum())
    expected = {Intention.LEFT_LANE_CHANGE} | ({Intention.OVERTAKE} if passing == 1 else set())
    assert counted_intentions(made, Intention.LEFT_LANE_CHANGE) == expected


def test_where_traffic_keeps_left_pull_outs_go_right() -> None:
    made = event("overtake", 10.0, 12.0, 15.0)
    targets = targets_of([made], TIMES, HORIZONS, Intention.RIGHT_LANE_CHANGE)
    assert (targets.interval[:, WITH_HAZARD.index(Intention.RIGHT_LANE_CHANGE)] < len(HORIZONS)).any()
    assert (targets.interval[:, LEFT] == len(HORIZONS)).all()


@given(
    onset=st.floats(3, 15),
    span=st.floats(0, 3),
    after=st.floats(0, 3),
    horizons=st.lists(st.floats(0.1, 3), min_size=1),
)
def test_every_decision_before_an_onset_has_its_interval(
    onset: float, span: float, after: float, horizons: list[float]
) -> None:
    """Against a walk through the definition, one decision and horizon at a time."""
    horizons = sorted(set(horizons))
    made = event("evasive_swerve", onset, onset + span, onset + span + after)
    targets = targets_of([made], TIMES, horizons, Intention.LEFT_LANE_CHANGE)
    column = WITH_HAZARD.index(Intention.EVASIVE_SWERVE)
    for time_s, answer in zip(TIMES.tolist(), targets.interval[:, column].tolist(), strict=True):
        until = onset - time_s
        if any(abs(abs(until) - edge) < 1e-6 for edge in (0.0, *horizons)) or abs(time_s - onset - span) < 1e-6:
            continue
        if time_s > onset + span:
            expected = IGNORED if time_s <= onset + span + after else len(horizons)
        else:
            expected = next((k for k, horizon in enumerate(horizons) if until < horizon), len(horizons))
        assert answer == expected or abs(time_s - onset - span - after) < 1e-6
