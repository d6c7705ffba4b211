"""Scores by hand: two seeds with known events and alarms."""

from __future__ import annotations

import numpy as np
import pytest

from labeling.intentions import KNOWN
from models.live import scoring
from models.live.alarms import Alarms, Levels
from models.live.background import IGNORED, NONE, Background, training_rows, window_labels
from models.live.events import GROUPS, LiveEvent
from models.live.measuring import measure_random, no_alarms
from models.live.predictions import Answers
from models.live.scoring import Sweep, Truth, event_scores, lead_times, recall_lost
from models.live.settings import BackgroundSettings, LiveSettings, ScoringSettings
from models.live.store import RUN, EpisodeFacts, LiveEpisode

SETTINGS = ScoringSettings(resamples=200)
COUNT = 600
"""Predictions of each vehicle: one minute."""


def episode(seed: int, *events: LiveEvent) -> LiveEpisode:
    """One minute of two vehicles, a and b; b is under command in the second half."""
    facts = EpisodeFacts(
        fingerprint="", scenario="toy", seed=seed, decision_s=0.1, simulated_s=60.0, vehicles=2, instants=2 * COUNT,
        uncovered={}, covered_km=3.0, events=events,
    )  # fmt: skip
    time_s = np.tile(np.round(np.arange(COUNT) * 0.1, 9), 2)
    vehicle = np.repeat(np.arange(2), COUNT)
    rng = np.random.default_rng(seed)
    group = np.where((vehicle == 1) & (time_s >= 30), GROUPS.index("commanded"), 0)
    probabilities = rng.dirichlet(np.ones(len(KNOWN)), 2 * COUNT).astype(np.float32)
    answers = Answers(probabilities, probabilities.max(axis=1), rng.random((2 * COUNT, 3)).astype(np.float32))
    return LiveEpisode(facts, ("a", "b"), vehicle, time_s, group, {RUN: answers})


def event(vehicle: str, intention: str, onset: float, group: str = "natural", left_out: str | None = None) -> LiveEvent:
    return LiveEvent.model_validate(
        {"vehicle": vehicle, "intention": intention, "onset": onset, "commit": onset + 1, "end": onset + 3,
         "group": group, "left_out": left_out}
    )  # fmt: skip


def alarms(*rows: tuple[int, int, float]) -> Alarms:
    """Alarms as (vehicle, intention, time)."""
    vehicle, intention = (np.array([row[k] for row in rows], np.int64) for k in (0, 1))
    time_s = np.array([row[2] for row in rows], np.float64)
    return Alarms(intention, vehicle * COUNT + np.rint(time_s * 10).astype(np.int64), vehicle, time_s)


FIRST = episode(1, event("a", "hard_brake", 10), event("b", "left_lane_change", 40, "commanded"))
SECOND = episode(
    2, event("a", "hard_brake", 20), event("a", "hard_brake", 40), event("b", "hard_brake", 5, left_out="jump")
)


@pytest.fixture
def outcomes() -> list[scoring.Outcome]:
    """Predicted 0.5 s and 2 s before the commit; detected 1 s after it; one missed; three false alarms."""
    first = Truth.of(FIRST, 2.0).outcome(alarms((0, 0, 10.5), (1, 1, 42.0), (1, 1, 50.0)))
    second = Truth.of(SECOND, 2.0).outcome(alarms((0, 0, 19.0), (1, 0, 5.0), (0, 2, 30.0), (0, 0, 50.0)))
    return [first, second]


def test_the_numbers_are_those_counted_by_hand(outcomes: list[scoring.Outcome]) -> None:
    scores = event_scores(outcomes, SETTINGS, "toy")
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


def test_intentions_and_origins_are_counted_apart(outcomes: list[scoring.Outcome]) -> None:
    every = scoring.group_scores(outcomes, SETTINGS, "toy")
    brake, left = every.by_intention["hard_brake"], every.by_intention["left_lane_change"]
    assert (brake.events, brake.predicted, brake.false_alarms) == (3, 2, 1)
    assert (left.events, left.detected, left.false_alarms) == (1, 1, 1)
    assert sum(scores.events for scores in every.by_intention.values()) == every.over_all.events
    assert sum(scores.false_alarms for scores in every.by_intention.values()) == every.over_all.false_alarms
    natural = scoring.group_scores(outcomes, SETTINGS, "toy", "natural").over_all
    commanded = scoring.group_scores(outcomes, SETTINGS, "toy", "commanded").over_all
    reaction = scoring.group_scores(outcomes, SETTINGS, "toy", "reaction").over_all
    assert (natural.events, reaction.events, commanded.events) == (3, 0, 1)
    assert reaction.vehicle_hours == 0
    assert (natural.false_alarms, commanded.false_alarms) == (2, 1)
    assert natural.vehicle_hours == pytest.approx(3 / 60)
    assert commanded.vehicle_hours == pytest.approx(1 / 60)


def test_recall_against_time_to_commit_falls(outcomes: list[scoring.Outcome]) -> None:
    points = {point.time_to_commit_s: point.recall for point in scoring.by_time_to_commit(outcomes)}
    assert points == {0.0: 0.5, 0.2: 0.5, 0.5: 0.5, 0.8: 0.25, 1.0: 0.25, 1.5: 0.25, 2.0: 0.25, 3.0: 0.0}


def test_the_upper_bound_of_no_false_alarm_is_three_over_the_hours() -> None:
    """FACTS of Poisson statistics: none in 2 hours still allows 1.5 an hour."""
    quiet = Truth.of(FIRST, 2.0).outcome(alarms())
    two_hours = scoring.Outcome(**{**quiet.__dict__, "hours": np.array([2.0, 0.0])})
    bound = event_scores([two_hours], SETTINGS, "toy").false_alarms_per_vehicle_hour_upper
    assert bound == pytest.approx(1.5, abs=0.01)


def test_without_events_nothing_is_divided_by_zero() -> None:
    nothing = episode(3)
    scores = event_scores([Truth.of(nothing, 2.0).outcome(alarms((0, 0, 1.0)))], SETTINGS, "toy")
    assert (scores.recall, scores.f1, scores.precision, scores.recall_interval) == (None, None, 0.0, None)
    assert lead_times(np.array([np.nan])).median is None


def levels(of: LiveEpisode, spikes: dict[tuple[int, int, float], float]) -> Levels:
    """Levels that are 0 but for spikes at (vehicle, intention, time)."""
    level = np.zeros((len(of.time_s), len(KNOWN)), np.float32)
    for (vehicle, intention, time), value in spikes.items():
        level[vehicle * COUNT + round(time * 10), intention] = value
    return Levels.of(of, level)


def test_the_curve_trades_recall_for_false_alarms() -> None:
    """At 0.9 one event and no false alarm; at 0.7 also a false alarm; at 0.5 every event and two false alarms."""
    truths = [Truth.of(FIRST, 2.0), Truth.of(SECOND, 2.0)]
    of = [
        levels(FIRST, {(0, 0, 10.5): 0.9, (1, 3, 20.0): 0.7, (1, 1, 40.5): 0.5}),
        levels(SECOND, {(0, 0, 20.5): 0.6, (0, 0, 40.5): 0.5, (0, 4, 55.0): 0.55}),
    ]
    sweep = Sweep.of(truths, of, 2.0, 50)
    for rate, recall, threshold in ((10.0, 0.25, 0.9), (15.0, 0.5, 0.6), (30.0, 1.0, 0.5)):
        point = sweep.point(rate, SETTINGS, "toy")
        assert point.recall == pytest.approx(recall)
        assert point.threshold == pytest.approx(threshold)
        assert point.measured is not None
        assert point.measured <= rate + 1e-9
        assert point.recall_interval is not None
        assert point.recall_interval.low <= recall <= point.recall_interval.high


def test_what_sensing_costs_is_the_difference_of_the_curves() -> None:
    truths = [Truth.of(FIRST, 2.0), Truth.of(SECOND, 2.0)]
    of_truth = [levels(FIRST, {(0, 0, 10.5): 0.9}), levels(SECOND, {(0, 0, 20.5): 0.9})]
    of_sensed = [levels(FIRST, {(0, 0, 10.5): 0.9}), levels(SECOND, {(0, 4, 55.0): 0.9})]
    truth, sensed = (Sweep.of(truths, part, 2.0, 50) for part in (of_truth, of_sensed))
    costs = {cost.false_alarms_per_vehicle_hour: cost for cost in recall_lost(truth, sensed, SETTINGS)}
    # At 1 an hour the false alarm of the second seed forbids the only threshold.
    assert (costs[1.0].truth, costs[1.0].sensed, costs[1.0].lost) == (0.5, 0.0, 0.5)
    interval = costs[1.0].interval
    assert interval is not None
    # By hand: a resample of the first seed alone loses nothing; any other loses the half that truth finds.
    assert (interval.low, interval.high) == pytest.approx((0.0, 0.5))
    assert [cost.lost for cost in recall_lost(truth, truth, SETTINGS)] == [0.0] * 5


def test_no_threshold_is_quiet_enough_for_a_rate_below_the_first_false_alarm() -> None:
    truths = [Truth.of(FIRST, 2.0)]
    sweep = Sweep.of(truths, [levels(FIRST, {(0, 4, 50.0): 0.9, (0, 0, 10.5): 0.5})], 2.0, 50)
    point = sweep.point(1.0, SETTINGS, "toy")
    assert (point.recall, point.threshold, point.measured) == (0.0, None, None)


def test_random_alarms_come_as_often_for_every_intention() -> None:
    truths = [Truth.of(FIRST, 2.0), Truth.of(SECOND, 2.0)]
    like = no_alarms(truths, LiveSettings(scoring=SETTINGS), "toy")
    raised = (alarms((0, 0, 10.5), (1, 1, 42.0), (1, 1, 50.0)), alarms((0, 2, 30.0)))
    drawn = measure_random(truths, type(like)(like.result, like.outcomes, raised, None), LiveSettings(scoring=SETTINGS))
    counts = [np.bincount(of_episode.intention, minlength=6).tolist() for of_episode in drawn.alarms]
    assert counts == [[1, 2, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0]]
    assert drawn.result.over_all.predicted + drawn.result.over_all.detected <= 1


def test_windows_are_labelled_for_the_answer_none() -> None:
    label = window_labels(SECOND, BackgroundSettings(), 2.0)
    of_a = dict(zip(SECOND.time_s[:COUNT].tolist(), label[:COUNT].tolist(), strict=True))
    assert (of_a[17.9], of_a[18.1], of_a[19.6], of_a[23.0], of_a[23.1]) == (NONE, IGNORED, 0, 0, NONE)
    assert set(label[COUNT + 30 : COUNT + 81].tolist()) == {IGNORED}
    rows, labels, weights = training_rows(SECOND, BackgroundSettings(), 2.0)
    assert (labels == 0).sum() == (label == 0).sum()
    # Five runs of background, each with up to one interval more or less.
    assert weights[labels == NONE].sum() == pytest.approx((label == NONE).sum(), abs=5 * 5)
    assert (label[rows] == labels).all()


def test_trees_that_know_none_are_silent_where_nothing_happens() -> None:
    """The first feature is made to say when something happens; levels are its log-odds."""
    for one in (FIRST, SECOND):
        label = window_labels(one, BackgroundSettings(), 2.0)
        one.answers[RUN].features[:, 0] = label == 0
    settings = BackgroundSettings(rounds=20)
    background = Background.fit([SECOND], settings, 2.0)
    assert background is not None
    level = background.levels(FIRST)
    during = window_labels(FIRST, settings, 2.0) == 0
    assert level[during, 0].min() > 0 > level[~during, 0].max()
    assert np.isneginf(level[:, 1:]).all()
    assert Background.fit([episode(5)], settings, 2.0) is None
