"""Alarms chosen on development seeds: one threshold for all intentions, or one for separate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from isac_cosim.evaluation.in_traffic.alarms.alarms import Levels, alarms
from isac_cosim.evaluation.in_traffic.measurement.choosing import Combination, Options
from isac_cosim.evaluation.in_traffic.scores.scoring import Truth, event_scores
from isac_cosim.evaluation.in_traffic.settings import AlarmSettings, ChoiceSettings
from isac_cosim.labeling.intentions import KNOWN
from tests.support.minute_of_traffic import COUNT, SETTINGS, episode, event

TEMPLATE = AlarmSettings(method="reject", threshold=0.0)
BRAKE, LEFT, RIGHT = (
    [known.text for known in KNOWN].index(name) for name in ("hard_brake", "left_lane_change", "right_lane_change")
)
HOUR = 30
"""False alarms per vehicle-hour of one false alarm in the two vehicle-minutes of an episode."""


@pytest.fixture(scope="module")
def truths() -> list[Truth]:
    """Three hard brakes and three lane changes of one vehicle."""
    events = [event("a", "hard_brake", 5 + 10 * k) for k in range(3)]
    events += [event("a", "left_lane_change", 35 + 8 * k) for k in range(3)]
    return [Truth.of(episode(1, *events), 2.0)]


@pytest.fixture(scope="module")
def levels(truths: list[Truth]) -> list[Levels]:
    """Hard brakes stand out at a low level; the level of lane changes is high for false alarms, too.

    A shared threshold below the hard brakes raises the three false alarms for lane changes.
    """
    level = np.zeros((2 * COUNT, len(KNOWN)), np.float32)
    for number, onset in enumerate((5, 15, 25)):
        level[10 * onset + 5, BRAKE] = 0.30 + 0.01 * number
    for number, onset in enumerate((35, 43, 51)):
        level[10 * onset + 5, LEFT] = 0.90 + 0.01 * number
    for number, time in enumerate((10, 20, 30)):
        level[COUNT + 10 * time, LEFT] = 0.60 + 0.01 * number
    # A pause every 4 s, so that each spike is a peak of its own, from which thresholds are tried.
    of_episode = Levels.of(truths[0].episode, level)
    return [replace(of_episode, begins=np.arange(2 * COUNT) % 40 == 0)]


def choice(**settings: object) -> ChoiceSettings:
    return ChoiceSettings.model_validate({"least_events": 1, **settings})


def test_a_threshold_for_each_intention_predicts_what_a_shared_one_cannot(
    truths: list[Truth], levels: list[Levels]
) -> None:
    combination = Combination.of(truths, levels, TEMPLATE, choice())
    shared, separate = (combination.choose(2 * HOUR, sharing) for sharing in ("shared", "separate"))
    assert shared is not None
    assert separate is not None
    assert (shared.score, separate.score) == (0.5, 1.0)
    assert (shared.alarms.threshold, separate.alarms.threshold) == (
        pytest.approx(0.9),
        pytest.approx({"hard_brake": 0.3, "left_lane_change": 0.9}),
    )
    scores = event_scores([truths[0].outcome(alarms(levels[0], separate.alarms))], SETTINGS)
    assert (scores.recall, scores.false_alarms) == (1.0, 0)


def test_at_every_rate_the_counts_of_the_choice_are_those_of_its_alarms(
    truths: list[Truth], levels: list[Levels]
) -> None:
    """With levels at random: what is added up intention by intention is what the alarms give together."""
    rng = np.random.default_rng(4)
    noisy = [replace(levels[0], level=(levels[0].level + 0.5 * rng.random(levels[0].level.shape)).astype(np.float32))]
    combination = Combination.of(truths, noisy, TEMPLATE, choice(thresholds=30))
    before = -1.0
    for rate in (HOUR, 2 * HOUR, 3 * HOUR):
        separate = combination.choose(rate, "separate")
        assert separate is not None
        if separate.path is None:
            continue
        scores = event_scores([truths[0].outcome(alarms(noisy[0], separate.alarms))], SETTINGS)
        assert scores.recall == pytest.approx(separate.score)
        assert scores.false_alarms_per_vehicle_hour is not None
        assert scores.false_alarms_per_vehicle_hour <= rate + 1e-9
        assert separate.score >= before
        before = separate.score
    assert before > 0


def test_without_enough_events_all_intentions_share_a_threshold(truths: list[Truth], levels: list[Levels]) -> None:
    combination = Combination.of(truths, levels, TEMPLATE, choice(least_events=4))
    for rate in (0.5 * HOUR, HOUR, 3 * HOUR):
        shared, separate = (combination.choose(rate, sharing) for sharing in ("shared", "separate"))
        assert shared is not None
        assert separate is not None
        assert separate.alarms == shared.alarms
    assert shared.score == 1.0


def test_the_path_is_what_growing_budgets_choose(truths: list[Truth], levels: list[Levels]) -> None:
    separate = Combination.of(truths, levels, TEMPLATE, choice()).choose(2 * HOUR, "separate")
    assert separate is not None
    assert separate.path is not None
    # Each of the two thresholds counts as one false alarm, although it has none.
    assert separate.path[:, BRAKE] == pytest.approx([0.3, 0.3])
    assert separate.path[:, LEFT] == pytest.approx([np.inf, 0.9])
    assert np.isinf(separate.path[:, RIGHT]).all()


def test_alarms_that_no_threshold_keeps_quiet_have_the_highest_f1(truths: list[Truth], levels: list[Levels]) -> None:
    loud = levels[0].level.copy()
    loud[COUNT + 500, LEFT] = 2.0
    loud[:COUNT, BRAKE] = 0.0
    combination = Combination.of(truths, [replace(levels[0], level=loud)], TEMPLATE, choice())
    for sharing in ("shared", "separate"):
        chosen = combination.choose(0.1 * HOUR, sharing)
        assert chosen is not None
        assert not chosen.quiet
        assert chosen.alarms.threshold == pytest.approx(0.9)


def test_the_better_combination_is_chosen(truths: list[Truth], levels: list[Levels]) -> None:
    silent = [replace(levels[0], level=np.zeros_like(levels[0].level))]
    parts = [
        Combination.of(truths, of, TEMPLATE.model_copy(update={"k": k}), choice())
        for k, of in ((1, silent), (2, levels))
    ]
    chosen = Options(tuple(parts)).choose(0.5 * HOUR, "separate")
    assert chosen is not None
    assert chosen.alarms.k == 2
    assert Options(()).choose(1.0, "separate") is None
