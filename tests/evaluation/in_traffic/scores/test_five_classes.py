"""Overtakes and lane changes as one intention: what counts as right, and that nothing else changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from isac_cosim.evaluation.in_traffic.alarms.alarms import reject_levels
from isac_cosim.evaluation.in_traffic.alarms.background import window_labels
from isac_cosim.evaluation.in_traffic.scores.five_classes import as_five
from isac_cosim.evaluation.in_traffic.scores.scoring import Truth
from isac_cosim.evaluation.in_traffic.settings import BackgroundSettings
from isac_cosim.evaluation.in_traffic.streams.store import RUN
from isac_cosim.labeling.intentions import KNOWN, Intention
from tests.support.minute_of_traffic import COUNT, alarms, episode, event

BRAKE, LEFT, RIGHT, OVERTAKE = (
    KNOWN.index(known)
    for known in (
        Intention.HARD_BRAKE,
        Intention.LEFT_LANE_CHANGE,
        Intention.RIGHT_LANE_CHANGE,
        Intention.OVERTAKE,
    )
)
BEFORE_ONSET_S = 2.0
MINUTE = episode(
    3, event("a", "overtake", 10), event("a", "left_lane_change", 30), event("b", "right_lane_change", 20),
    event("b", "left_lane_change", 50, left_out="unresolved"),
)  # fmt: skip
SIX = Truth.of(MINUTE, BEFORE_ONSET_S)


@pytest.mark.parametrize(("lefthand", "change", "other"), [(False, LEFT, RIGHT), (True, RIGHT, LEFT)])
def test_an_alarm_for_the_lane_change_that_an_overtake_begins_with_is_right(
    lefthand: bool, change: int, other: int
) -> None:
    five = as_five(SIX, lefthand, BEFORE_ONSET_S)
    alarm, wrong_side = alarms((0, change, 10.5)), alarms((0, other, 10.5))
    assert (SIX.outcome(alarm).predicted.sum(), len(SIX.outcome(alarm).false_intention)) == (0, 1)
    assert (five.outcome(alarm).predicted.sum(), len(five.outcome(alarm).false_intention)) == (1, 0)
    assert len(five.outcome(wrong_side).false_intention) == 1
    assert sorted(five.table.intention) == sorted([change, LEFT, RIGHT, change])


def test_other_events_and_neutral_ones_stay_as_they_are() -> None:
    five = as_five(SIX, False, BEFORE_ONSET_S)
    for alarm in (alarms((0, LEFT, 30.5)), alarms((1, RIGHT, 20.5)), alarms((1, RIGHT, 5.5)), alarms((1, BRAKE, 5.0))):
        before, after = SIX.outcome(alarm), five.outcome(alarm)
        assert before.predicted.sum() == after.predicted.sum()
        assert len(before.false_intention) == len(after.false_intention)


@pytest.mark.parametrize(("lefthand", "change"), [(False, LEFT), (True, RIGHT)])
@pytest.mark.parametrize("outcome", ["unresolved", "passed_did_not_return"])
def test_a_pull_out_with_an_open_outcome_is_a_lane_change(outcome: str, lefthand: bool, change: int) -> None:
    of_change = KNOWN[change].text
    open_ended = Truth.of(episode(3, event("b", of_change, 50, left_out=outcome)), BEFORE_ONSET_S)
    assert not len(open_ended.table.intention)
    five = as_five(open_ended, lefthand, BEFORE_ONSET_S)
    assert five.outcome(alarms((1, change, 50.5))).predicted.tolist() == [True]
    labelled = window_labels(five.episode, BackgroundSettings(), BEFORE_ONSET_S).reshape(2, COUNT)[1]
    assert labelled[505] == change
    unwatched = Truth.of(episode(3, event("b", of_change, 50, left_out="not_watched")), BEFORE_ONSET_S)
    assert not len(as_five(unwatched, lefthand, BEFORE_ONSET_S).table.intention)


def test_the_probabilities_of_both_add_up_and_the_overtake_is_never_the_likeliest() -> None:
    five = as_five(SIX, False, BEFORE_ONSET_S)
    before, after = MINUTE.answers[RUN], five.episode.answers[RUN]
    np.testing.assert_allclose(after.probabilities.sum(axis=1), before.probabilities.sum(axis=1), rtol=1e-6)
    np.testing.assert_allclose(after.probabilities[:, LEFT], before.probabilities[:, [LEFT, OVERTAKE]].sum(axis=1))
    np.testing.assert_array_equal(after.probabilities[:, BRAKE], before.probabilities[:, BRAKE])
    assert (reject_levels(after, 0.0)[:, OVERTAKE] == -np.inf).all()
    np.testing.assert_array_equal(after.score, before.score)
    np.testing.assert_array_equal(MINUTE.answers[RUN].probabilities, before.probabilities)


def test_a_change_that_six_intentions_split_in_two_becomes_the_likeliest() -> None:
    probabilities = np.full((2 * COUNT, len(KNOWN)), 0.05, np.float32)
    probabilities[:, [LEFT, OVERTAKE, BRAKE]] = 0.27, 0.27, 0.31
    answers = {RUN: replace(MINUTE.answers[RUN], probabilities=probabilities)}
    split = Truth.of(replace(MINUTE, answers=answers), BEFORE_ONSET_S)
    merged = as_five(split, False, BEFORE_ONSET_S).episode.answers[RUN]
    assert np.isfinite(reject_levels(answers[RUN], 0.3)).any(axis=0).nonzero()[0].tolist() == [BRAKE]
    assert np.isfinite(reject_levels(merged, 0.3)).any(axis=0).nonzero()[0].tolist() == [LEFT]
