"""Recall against false alarms, by hand: two seeds with known events and levels."""

from __future__ import annotations

import numpy as np
import pytest

from isac_cosim.evaluation.in_traffic.alarms.alarms import Levels
from isac_cosim.evaluation.in_traffic.scores.curves import (
    ThresholdSweep,
    candidate_thresholds,
    left_out_counts,
    recall_at,
    recall_lost,
)
from isac_cosim.evaluation.in_traffic.scores.scoring import Truth, recall_interval
from tests.support.minute_of_traffic import FIRST, SECOND, SETTINGS, levels


def shared(truths: list[Truth], of: list[Levels]) -> ThresholdSweep:
    """The sweep of thresholds that all intentions share."""
    return ThresholdSweep.of(truths, of, np.tile(candidate_thresholds(of, 50)[:, None], 6), 2.0)


def test_the_curve_trades_recall_for_false_alarms() -> None:
    """At 0.9 one event and no false alarm; at 0.7 also a false alarm; at 0.5 every event and two false alarms."""
    truths = [Truth.of(FIRST, 2.0), Truth.of(SECOND, 2.0)]
    of = [
        levels(FIRST, {(0, 0, 10.5): 0.9, (1, 3, 20.0): 0.7, (1, 1, 40.5): 0.5}),
        levels(SECOND, {(0, 0, 20.5): 0.6, (0, 0, 40.5): 0.5, (0, 4, 55.0): 0.55}),
    ]
    sweep = shared(truths, of)
    for rate, recall, threshold in ((10.0, 0.25, 0.9), (15.0, 0.5, 0.6), (30.0, 1.0, 0.5)):
        point = sweep.point(rate, SETTINGS)
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
    truth, sensed = (shared(truths, part) for part in (of_truth, of_sensed))
    costs = {cost.false_alarms_per_vehicle_hour: cost for cost in recall_lost(truth, sensed, SETTINGS)}
    # At 1 an hour the false alarm of the second seed forbids the only threshold.
    assert (costs[1.0].truth, costs[1.0].sensed, costs[1.0].lost) == (0.5, 0.0, 0.5)
    interval = costs[1.0].interval
    assert interval is not None
    # By hand: without the second seed nothing is lost, without the first one all that truth predicts, half the events.
    half_width = 12.706 * np.sqrt(1 / 2 * (0.25**2 + 0.25**2))
    assert interval.seeds == 2
    assert (interval.low, interval.high) == pytest.approx((0.5 - half_width, 0.5 + half_width), abs=1e-3)
    assert [cost.lost for cost in recall_lost(truth, truth, SETTINGS)] == [0.0] * 5


def test_no_threshold_is_quiet_enough_for_a_rate_below_the_first_false_alarm() -> None:
    truths = [Truth.of(FIRST, 2.0)]
    sweep = shared(truths, [levels(FIRST, {(0, 4, 50.0): 0.9, (0, 0, 10.5): 0.5})])
    point = sweep.point(1.0, SETTINGS)
    assert (point.recall, point.threshold, point.measured) == (0.0, None, None)


def simulated_counts(rng: np.random.Generator, seeds: int) -> np.ndarray:
    """Counts at 80 thresholds of seeds that differ in how hard they are, (80, seeds, 4)."""
    thresholds = np.linspace(4.5, -1, 80)[:, None]
    counts = np.zeros((80, seeds, 4))
    counts[..., 3] = 1.75
    for seed in range(seeds):
        events = rng.normal(1.0 + rng.normal(0, 0.3), 1, rng.poisson(120))
        false = rng.normal(rng.normal(0, 0.15), 1, rng.poisson(525))
        counts[:, seed, 0] = len(events)
        counts[:, seed, 1] = (events >= thresholds).sum(axis=1)
        counts[:, seed, 2] = (false >= thresholds).sum(axis=1)
    return counts


@pytest.mark.slow
@pytest.mark.parametrize("rate", [1.0, 10.0])
def test_the_interval_of_a_curve_covers_the_recall_of_endless_traffic(rate: float) -> None:
    """The threshold is found anew without each seed; with it fixed, or by a percentile bootstrap, fewer cover."""
    rng = np.random.default_rng(1)
    expected = recall_at(simulated_counts(rng, 2000).sum(axis=1), rate)
    covered = 0
    for _ in range(400):
        counts = simulated_counts(rng, 10)
        total = counts.sum(axis=1)
        left_out = np.array([recall_at(part, rate) for part in left_out_counts(counts)])
        interval = recall_interval(recall_at(total, rate) * total[0, 0], total[0, 0], left_out, SETTINGS)
        assert interval is not None
        covered += interval.low <= expected <= interval.high
    assert 0.91 <= covered / 400 <= 0.99
