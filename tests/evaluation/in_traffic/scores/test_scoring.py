"""Scores by hand: two seeds with known events and alarms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t as student_t

from isac_cosim.evaluation.in_traffic.alarms.background import (
    IGNORED,
    NONE,
    BackgroundTrees,
    training_rows,
    window_labels,
)
from isac_cosim.evaluation.in_traffic.measurement.measuring import measure_random, no_alarms, truths_of
from isac_cosim.evaluation.in_traffic.scores import scoring
from isac_cosim.evaluation.in_traffic.scores.scoring import (
    Truth,
    event_scores,
    false_alarms_near,
    lead_times,
    rate_interval,
    recall_interval,
)
from isac_cosim.evaluation.in_traffic.settings import BackgroundSettings, LiveSettings
from isac_cosim.evaluation.in_traffic.streams.store import RUN
from isac_cosim.labeling.intentions import KNOWN
from tests.support.minute_of_traffic import COUNT, FIRST, SECOND, SETTINGS, alarms, episode, event


@pytest.fixture
def outcomes() -> list[scoring.AlarmOutcome]:
    """Predicted 0.5 s and 2 s before the commit; detected 1 s after it; one missed; three false alarms."""
    first = Truth.of(FIRST, 2.0).outcome(alarms((0, 0, 10.5), (1, 1, 42.0), (1, 1, 50.0)))
    second = Truth.of(SECOND, 2.0).outcome(alarms((0, 0, 19.0), (1, 0, 5.0), (0, 2, 30.0), (0, 0, 50.0)))
    return [first, second]


def test_the_numbers_are_those_counted_by_hand(outcomes: list[scoring.AlarmOutcome]) -> None:
    scores = event_scores(outcomes, SETTINGS)
    assert (scores.events, scores.predicted, scores.detected, scores.missed) == (4, 2, 1, 1)
    assert scores.false_alarms == 3
    assert scores.vehicle_hours == pytest.approx(4 / 60)
    assert (scores.recall, scores.recall_with_detection) == (0.5, 0.75)
    assert scores.precision == pytest.approx(2 / 5)
    assert scores.precision_with_detection == pytest.approx(3 / 6)
    assert scores.f1 == pytest.approx(2 * 0.4 * 0.5 / 0.9)
    assert scores.false_alarms_per_vehicle_hour == pytest.approx(45.0)
    assert scores.lead_time_s.model_dump() == pytest.approx(
        {"n": 3, "lower_quartile": -0.25, "median": 0.5, "upper_quartile": 1.25}
    )
    assert scores.lead_to_onset_s.median == pytest.approx(-0.5)


def test_an_alarm_for_a_near_miss_is_neither_right_nor_false_and_is_counted_apart() -> None:
    """A near miss of a hard brake at 30 s; the alarm for a swerve at that time stays false."""
    minute = episode(1, event("a", "hard_brake", 10), event("a", "hard_brake", 30, left_out="near_miss"))
    (neutral,) = truths_of([minute], SETTINGS)
    (counted,) = truths_of([minute], SETTINGS.model_copy(update={"near_misses": "false"}))
    raised = alarms((0, 0, 10.5), (0, 0, 30.5), (0, 5, 30.5))
    assert [outcome.near_intention.tolist() for outcome in (neutral.outcome(raised), counted.outcome(raised))] == [
        [0], []
    ]  # fmt: skip
    assert neutral.outcome(raised).false_intention.tolist() == [5]
    assert sorted(counted.outcome(raised).false_intention.tolist()) == [0, 5]
    assert neutral.outcome(raised).of(intention=5).near_intention.tolist() == []
    labels = (
        window_labels(neutral.episode, BackgroundSettings(), 2.0),
        window_labels(counted.episode, BackgroundSettings(), 2.0),
    )
    assert [label[305] for label in labels] == [IGNORED, NONE]


def test_the_interval_of_a_recall_is_that_of_the_jackknife_over_seeds() -> None:
    """Three seeds with 1 of 4, 3 of 6 and 6 of 10 events predicted; by hand."""
    left_out = np.array([9 / 16, 7 / 14, 4 / 10])
    half_width = student_t.ppf(0.975, 2) * np.sqrt(2 / 3 * ((left_out - left_out.mean()) ** 2).sum())
    interval = recall_interval(10, 20, left_out, SETTINGS)
    assert interval is not None
    assert (interval.low, interval.high) == pytest.approx((0.5 - half_width, 0.5 + half_width))
    assert interval.seeds == 3
    narrower = recall_interval(10, 20, left_out, SETTINGS.model_copy(update={"confidence": 0.5}))
    assert narrower is not None
    assert narrower.high - 0.5 == pytest.approx(half_width * student_t.ppf(0.75, 2) / student_t.ppf(0.975, 2))


@pytest.mark.parametrize(("predicted", "low", "high"), [(0, 0.0, 0.168), (20, 0.832, 1.0)])
def test_without_any_hit_or_miss_the_interval_is_that_of_a_binomial_share(
    predicted: int, low: float, high: float
) -> None:
    """0 of 20: at a recall of 0.168, 0 events are predicted in 2.5 % of all cases."""
    interval = recall_interval(predicted, 20, np.full(4, predicted / 20), SETTINGS)
    assert interval is not None
    assert (interval.low, interval.high) == pytest.approx((low, high), abs=1e-3)
    assert pytest.approx(0.025, abs=1e-3) == (1 - 0.168) ** 20


def test_an_interval_stays_within_0_and_1_and_needs_two_seeds_with_events() -> None:
    interval = recall_interval(1, 20, np.array([0.0, 0.1]), SETTINGS)
    assert interval is not None
    assert (interval.low, interval.high) == (0.0, pytest.approx(0.05 + 12.706 * 0.05, abs=1e-3))
    assert recall_interval(1, 20, np.array([np.nan, 0.1]), SETTINGS) is None
    one = Truth.of(FIRST, 2.0).outcome(alarms((0, 0, 10.5)))
    nothing = Truth.of(episode(3), 2.0).outcome(alarms())
    for outcomes in ([one], [one, nothing]):
        assert event_scores(outcomes, SETTINGS).recall_interval is None


def test_the_interval_of_a_rate_is_that_of_the_jackknife_over_seeds() -> None:
    """Three seeds with 0, 1 and 3 false alarms in a minute of two vehicles each; by hand."""
    false = [alarms(), alarms((0, 5, 50)), alarms((0, 5, 50), (1, 5, 20), (0, 3, 30))]
    outcomes = [Truth.of(episode(seed), 2.0).outcome(raised) for seed, raised in enumerate(false)]
    hours = 2 / 60
    left_out = np.array([4, 3, 1]) / (2 * hours)
    half_width = student_t.ppf(0.975, 2) * np.sqrt(2 / 3 * ((left_out - left_out.mean()) ** 2).sum())
    interval = rate_interval(outcomes, SETTINGS)
    assert interval is not None
    assert half_width > 4 / (3 * hours)  # No rate is below 0.
    assert (interval.low, interval.high) == pytest.approx((0.0, 4 / (3 * hours) + half_width))
    assert interval.seeds == 3
    assert rate_interval(outcomes[:1], SETTINGS) is None


def test_without_any_false_alarm_the_interval_is_that_of_a_poisson_process() -> None:
    outcomes = [Truth.of(episode(seed), 2.0).outcome(alarms()) for seed in (1, 2)]
    interval = rate_interval(outcomes, SETTINGS)
    assert interval is not None
    assert interval.low == 0.0
    assert np.exp(-interval.high * 4 / 60) == pytest.approx(0.025)  # No alarm in so many hours at this rate.


def test_intentions_and_origins_are_counted_apart(outcomes: list[scoring.AlarmOutcome]) -> None:
    every = scoring.group_scores(outcomes, SETTINGS)
    brake, left = every.by_intention["hard_brake"], every.by_intention["left_lane_change"]
    assert (brake.events, brake.predicted, brake.false_alarms) == (3, 2, 1)
    assert (left.events, left.detected, left.false_alarms) == (1, 1, 1)
    assert sum(scores.events for scores in every.by_intention.values()) == every.over_all.events
    assert sum(scores.false_alarms for scores in every.by_intention.values()) == every.over_all.false_alarms
    natural = scoring.group_scores(outcomes, SETTINGS, "natural").over_all
    commanded = scoring.group_scores(outcomes, SETTINGS, "commanded").over_all
    reaction = scoring.group_scores(outcomes, SETTINGS, "reaction").over_all
    assert (natural.events, reaction.events, commanded.events) == (3, 0, 1)
    assert reaction.vehicle_hours == 0
    assert (natural.false_alarms, commanded.false_alarms) == (2, 1)
    assert natural.vehicle_hours == pytest.approx(3 / 60)
    assert commanded.vehicle_hours == pytest.approx(1 / 60)


def test_recall_against_time_to_commit_falls(outcomes: list[scoring.AlarmOutcome]) -> None:
    points = {point.time_to_commit_s: point.recall for point in scoring.by_time_to_commit(outcomes)}
    assert points == {0.0: 0.5, 0.2: 0.5, 0.5: 0.5, 0.8: 0.25, 1.0: 0.25, 1.5: 0.25, 2.0: 0.25, 3.0: 0.0}


def test_the_upper_bound_of_no_false_alarm_is_three_over_the_hours() -> None:
    """FACTS of Poisson statistics: none in 2 hours still allows 1.5 an hour."""
    quiet = Truth.of(FIRST, 2.0).outcome(alarms())
    two_hours = scoring.AlarmOutcome(**{**quiet.__dict__, "hours": np.array([2.0, 0.0])})
    bound = event_scores([two_hours], SETTINGS).false_alarms_per_vehicle_hour_upper
    assert bound == pytest.approx(1.5, abs=0.01)


def test_without_events_nothing_is_divided_by_zero() -> None:
    nothing = episode(3)
    scores = event_scores([Truth.of(nothing, 2.0).outcome(alarms((0, 0, 1.0)))], SETTINGS)
    assert (scores.recall, scores.f1, scores.precision, scores.recall_interval) == (None, None, 0.0, None)
    assert lead_times(np.array([np.nan])).median is None


def test_random_alarms_come_as_often_for_every_intention() -> None:
    truths = [Truth.of(FIRST, 2.0), Truth.of(SECOND, 2.0)]
    like = no_alarms(truths, LiveSettings(scoring=SETTINGS), "toy")
    raised = (alarms((0, 0, 10.5), (1, 1, 42.0), (1, 1, 50.0)), alarms((0, 2, 30.0)))
    drawn = measure_random(truths, replace(like, alarms=raised), LiveSettings(scoring=SETTINGS))
    counts = [np.bincount(of_episode.intention, minlength=6).tolist() for of_episode in drawn.alarms]
    assert counts == [[1, 2, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0]]
    assert drawn.result.over_all.predicted + drawn.result.over_all.detected <= 1


@pytest.mark.parametrize(("until", "late"), [("commit", IGNORED), ("end", 0)])
def test_windows_are_labelled_for_the_answer_none(until: str, late: int) -> None:
    """The first event has its onset at 20 s, its commit at 21 s and its end at 23 s."""
    label = window_labels(SECOND, BackgroundSettings.model_validate({"until": until}), 2.0)
    of_a = dict(zip(SECOND.time_s[:COUNT].tolist(), label[:COUNT].tolist(), strict=True))
    assert (of_a[17.9], of_a[18.1], of_a[19.6], of_a[21.0]) == (NONE, IGNORED, 0, 0)
    assert (of_a[21.1], of_a[23.0], of_a[23.1]) == (late, late, NONE)
    assert set(label[COUNT + 30 : COUNT + 81].tolist()) == {IGNORED}
    rows, labels, weights = training_rows(SECOND, BackgroundSettings.model_validate({"until": until}), 2.0)
    assert (labels == 0).sum() == (label == 0).sum()
    # Five runs of background, each with up to one interval more or less.
    assert weights[labels == NONE].sum() == pytest.approx((label == NONE).sum(), abs=5 * 10)
    assert (label[rows] == labels).all()


def test_trees_that_know_none_are_silent_where_nothing_happens() -> None:
    """The first feature is made to say when something happens; levels are its log-odds."""
    for one in (FIRST, SECOND):
        label = window_labels(one, BackgroundSettings(), 2.0)
        one.answers[RUN].features[:, 0] = label == 0
    settings = BackgroundSettings(rounds=20)
    background = BackgroundTrees.fit([SECOND], settings, 2.0)
    assert background is not None
    level = background.levels(FIRST)
    during = window_labels(FIRST, settings, 2.0) == 0
    assert level[during, 0].min() > 0 > level[~during, 0].max()
    assert np.isneginf(level[:, 1:]).all()
    assert BackgroundTrees.fit([episode(5)], settings, 2.0) is None


def test_false_alarms_are_sorted_by_what_else_happens_to_the_vehicle() -> None:
    minute = episode(
        4, event("a", "hard_brake", 10), event("a", "left_lane_change", 40, left_out="jump"),
        event("b", "hard_accel", 20),
    )  # fmt: skip
    brake, left, right = (
        k for k, known in enumerate(KNOWN) if known.text in ("hard_brake", "left_lane_change", "right_lane_change")
    )
    raised = alarms(
        (0, brake, 10.5), (0, right, 8.5), (0, brake, 12.5), (0, right, 15.0), (0, right, 17.0), (0, right, 41.0),
        (0, left, 41.0), (1, left, 5.0), (1, left, 23.5),
    )  # fmt: skip
    truth = Truth.of(minute, 2.0)
    near = false_alarms_near(truth, raised, 2.0)
    # The first alarm is right and the one for the neutral event is neither; all others are false.
    assert near == {"event": 3, "past_event": 2, "nothing": 2}
    assert near.total() == len(truth.outcome(raised).false_intention)
