"""What an operator asks, by hand: which alarms are in time, and which rates are kept."""

from __future__ import annotations

import numpy as np
import pytest

from isac_cosim.evaluation.in_traffic.alarms.alarms import Levels, raised
from isac_cosim.evaluation.in_traffic.measurement.headline import keeps_to_rate
from isac_cosim.evaluation.in_traffic.scores.scoring import Truth
from isac_cosim.labeling.intentions import KNOWN
from tests.support.minute_of_traffic import alarms, episode, event

MINUTE = episode(1, event("a", "hard_brake", 10), event("b", "left_lane_change", 40))
"""Commits come 1 s after onsets, ends 3 s after them."""


def test_only_what_is_asked_for_is_right_missed_or_false() -> None:
    brakes = Truth.of(MINUTE, 2.0).asking([0, 4])
    outcome = brakes.outcome(alarms((0, 0, 10.5)))
    assert (len(outcome.intention), outcome.predicted.sum(), len(outcome.false_intention)) == (1, 1, 0)
    level = Levels.of(MINUTE, np.zeros((len(MINUTE.time_s), len(KNOWN)), np.float32))
    assert set(raised(level, 0.0, 0.0).intention.tolist()) == set(range(len(KNOWN)))
    assert set(raised(level.asking(brakes.asked), 0.0, 0.0).intention.tolist()) == {0, 4}
    assert brakes.episode is MINUTE


@pytest.mark.parametrize(("at_s", "within_s", "in_time"), [(11.4, 0.5, True), (11.4, 0.0, False), (11.6, 0.5, False)])
def test_a_sudden_maneuver_may_be_named_a_little_after_its_commit(at_s: float, within_s: float, in_time: bool) -> None:
    outcome = Truth.of(MINUTE, 2.0).asking([0], within_s).outcome(alarms((0, 0, at_s)))
    assert outcome.predicted.tolist() == [in_time]
    assert outcome.to_commit.tolist() == pytest.approx([11.0 + within_s - at_s])
    assert not len(outcome.false_intention)


def test_an_event_that_ends_at_its_commit_may_be_named_after_it() -> None:
    brief = event("a", "hard_brake", 10).model_copy(update={"end": 11.0})
    truth = Truth.of(episode(1, brief), 2.0)
    assert truth.asking([0], 0.5).outcome(alarms((0, 0, 11.4))).predicted.tolist() == [True]
    assert len(truth.outcome(alarms((0, 0, 11.4))).false_intention) == 1


@pytest.mark.parametrize(
    ("measured", "kept"), [(1.0, True), (1.5, True), (1.6, False), (0.7, True), (0.6, False), (None, None)]
)
def test_a_rate_is_kept_within_a_factor_of_one_and_a_half(measured: float | None, kept: bool | None) -> None:
    assert keeps_to_rate(measured, 1.0) is kept
