"""Alarms that were chosen on one minute of traffic, measured on another."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from isac_cosim.evaluation.in_traffic.measurement.choosing import options_of, reject_candidates
from isac_cosim.evaluation.in_traffic.measurement.measuring import AnswerLevels, MeasuredAlarms, measure, measure_random
from isac_cosim.evaluation.in_traffic.scores.scoring import Truth
from isac_cosim.evaluation.in_traffic.settings import LiveSettings
from isac_cosim.evaluation.in_traffic.streams.predictions import Answers
from isac_cosim.evaluation.in_traffic.streams.store import RUN
from isac_cosim.labeling.intentions import KNOWN
from tests.support.minute_of_traffic import COUNT, episode, event

BRAKE, LEFT = (KNOWN.index(known) for known in KNOWN if known.text in ("hard_brake", "left_lane_change"))
RATE = 60.0
"""False alarms per vehicle-hour: two in the two vehicle-minutes of an episode."""


def truth(seed: int, false_brakes: int) -> Truth:
    """A hard brake and a lane change, the lane change at a high score; and false alarms for lane changes below it."""
    minute = episode(seed, event("a", "hard_brake", 10), event("a", "left_lane_change", 40))
    probabilities = np.full((2 * COUNT, len(KNOWN)), 0.1, np.float32)
    score = np.zeros(2 * COUNT, np.float32)
    spikes = [(105, BRAKE, 1.0), (405, LEFT, 3.0), *((COUNT + row, LEFT, 2.0) for row in (100, 300, 500))]
    for row, intention, value in (*spikes, *((COUNT + 50 * k, BRAKE, 1.0) for k in range(1, 1 + false_brakes))):
        probabilities[row, intention], score[row] = 0.5, value
    answers = Answers(probabilities, score, np.empty((2 * COUNT, 0), np.float32))
    return Truth.of(replace(minute, answers={RUN: answers}), 2.0)


def settings(sharing: Literal["shared", "separate"]) -> LiveSettings:
    choice = {"threshold": sharing, "least_events": 1, "false_alarms_per_vehicle_hour": RATE, "confirmations": [(1, 1)]}
    scoring = {"false_alarms_per_vehicle_hour": [0.5 * RATE, RATE]}
    return LiveSettings.model_validate({"choice": {**choice, "least_probabilities": [0.3]}, "scoring": scoring})


def measured(sharing: Literal["shared", "separate"]) -> MeasuredAlarms:
    live = settings(sharing)
    development = [truth(1, 0)]
    options = options_of(development, reject_candidates(development, RUN, live.choice), live.choice)
    result = measure(AnswerLevels([truth(2, 0), truth(3, 1)], RUN), options, live, "toy")
    assert result is not None
    return result


def test_thresholds_of_their_own_predict_more_at_the_same_rate() -> None:
    shared, separate = measured("shared").result, measured("separate").result
    assert (shared.over_all.recall, separate.over_all.recall) == (0.5, 1.0)
    assert separate.over_all.false_alarms == 1
    assert separate.alarms is not None
    assert separate.alarms.threshold == {"hard_brake": 1.0, "left_lane_change": 3.0}


@pytest.mark.parametrize("sharing", ["shared", "separate"])
def test_both_ways_are_measured_at_every_rate(sharing: Literal["shared", "separate"]) -> None:
    result = measured(sharing).result
    assert [point.false_alarms_per_vehicle_hour for point in result.frozen_at["separate"]] == [0.5 * RATE, RATE]
    frozen = result.frozen_at[sharing][1]
    assert frozen.alarms == result.alarms
    assert (frozen.recall, frozen.recall_interval) == (result.over_all.recall, result.over_all.recall_interval)
    assert frozen.measured == result.over_all.false_alarms_per_vehicle_hour
    assert frozen.by_intention["hard_brake"] == result.by_intention["hard_brake"].recall
    assert result.frozen_at == measured("separate").result.frozen_at


def test_the_curve_follows_the_path_of_the_development_seeds() -> None:
    separate = measured("separate")
    assert separate.chosen is not None
    assert separate.sweep is not None
    np.testing.assert_array_equal(separate.sweep.thresholds, separate.chosen.path)
    point = separate.result.recall_at[1]
    assert (point.recall, point.threshold) == (1.0, {"hard_brake": 1.0, "left_lane_change": 3.0})
    assert point.measured == pytest.approx(0.25 * RATE)


def test_random_alarms_come_as_often_as_those_of_each_threshold() -> None:
    separate = measured("separate")
    drawn = measure_random([truth(2, 0), truth(3, 1)], separate, settings("separate"))
    counts = [
        [np.bincount(alarms.intention, minlength=len(KNOWN)).tolist() for alarms in of.alarms]
        for of in (drawn, separate)
    ]
    assert counts[0] == counts[1]
