"""Curves of recall against false alarms: what comes of the alarms at several thresholds, with intervals over seeds.

The alarms for one intention do not depend on the thresholds of the others. Their predictions and false alarms are
therefore counted by intention, and add up for any combination of thresholds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.in_traffic.alarms.alarms import Levels, peaks, raised
from isac_cosim.evaluation.in_traffic.scores.results import CurvePoint, RecallLost
from isac_cosim.evaluation.in_traffic.scores.scoring import (
    AlarmOutcome,
    Truth,
    event_scores,
    interval_over_seeds,
    recall_by_intention,
    recall_interval,
)
from isac_cosim.evaluation.in_traffic.settings import ScoringSettings, shown_threshold
from isac_cosim.evaluation.statistics import Interval
from isac_cosim.labeling.intentions import KNOWN


@dataclass(frozen=True)
class ThresholdSweep:
    """The outcomes of the alarms of several episodes at several settings of the thresholds.

    thresholds: from strict to lenient, one of each intention, infinite where an intention never raises an alarm,
    (t, 6). outcomes: t rows, with one outcome for each episode.
    """

    thresholds: Array
    outcomes: tuple[tuple[AlarmOutcome, ...], ...]

    @classmethod
    def of(
        cls,
        truths: Sequence[Truth],
        levels: Sequence[Levels],
        thresholds: Array,
        refractory_s: float,
        rise: float | None = None,
    ) -> ThresholdSweep:
        """Try thresholds on episodes.

        levels: confirmed, one for each episode. thresholds: (t, 6). refractory_s, rise: see `AlarmSettings`.
        """
        outcomes = tuple(
            tuple(
                truth.outcome(raised(level, row, refractory_s, rise))
                for truth, level in zip(truths, levels, strict=True)
            )
            for row in thresholds
        )
        return cls(thresholds, outcomes)

    @cached_property
    def by_intention(self) -> Array:
        """Counts by intention: predicted events and false alarms, (t, episodes, 6, 2)."""
        counts = np.zeros((len(self.outcomes), len(self.outcomes[0]) if self.outcomes else 0, len(KNOWN), 2))
        for row, outcomes in enumerate(self.outcomes):
            for place, outcome in enumerate(outcomes):
                predicted = outcome.intention[outcome.predicted]
                counts[row, place, :, 0] = np.bincount(predicted, minlength=len(KNOWN))
                counts[row, place, :, 1] = np.bincount(outcome.false_intention, minlength=len(KNOWN))
        return counts

    @cached_property
    def counts(self) -> Array:
        """Counts over all intentions: events, predicted events, false alarms, and the hours, (t, episodes, 4)."""
        counts = np.zeros((*self.by_intention.shape[:2], 4))
        counts[..., 1:3] = self.by_intention.sum(axis=2)
        if self.outcomes:
            counts[..., 0] = [len(outcome.intention) for outcome in self.outcomes[0]]
            counts[..., 3] = [outcome.hours.sum() for outcome in self.outcomes[0]]
        return counts

    def rates(self) -> Array:
        """Return the false alarms per vehicle-hour at each row of thresholds, (t,); infinite without any hour."""
        return _rates(self.counts.sum(axis=1))

    def recalls(self) -> Array:
        """Return the recall at each row of thresholds, (t,); 0 without any event."""
        return _recalls(self.counts.sum(axis=1))

    def f1(self) -> Array:
        """Return the F1 of prediction at each row of thresholds, (t,); 0 without any event."""
        events, predicted, false, _ = self.counts.sum(axis=1).T
        return np.asarray(2 * predicted / np.maximum(predicted + false + events, 1))

    def best(self, rate: float) -> int | None:
        """Return the row of the highest recall at no more than `rate` false alarms per vehicle-hour, None if none."""
        return _best(self.counts.sum(axis=1), rate)

    def point(self, rate: float, settings: ScoringSettings) -> CurvePoint:
        """Return the curve at a rate of false alarms per vehicle-hour."""
        best = self.best(rate)
        outcomes = () if best is None else self.outcomes[best]
        scores = event_scores(outcomes, settings)
        events = len(self.outcomes) and sum(len(outcome.intention) for outcome in self.outcomes[0])
        silent = None if not events else 0.0  # If no threshold is that quiet, no alarm at all is.
        return CurvePoint(
            false_alarms_per_vehicle_hour=rate,
            measured=scores.false_alarms_per_vehicle_hour,
            threshold=None if best is None else shown_threshold(self.thresholds[best]),
            recall=silent if best is None else scores.recall,
            recall_interval=None if best is None else self._interval(rate, settings),
            recall_with_detection=silent if best is None else scores.recall_with_detection,
            median_lead_s=scores.lead_time_s.median,
            by_intention=recall_by_intention(outcomes),
        )

    def _interval(self, rate: float, settings: ScoringSettings) -> Interval | None:
        """Return the interval of the recall at a rate over seeds; the thresholds are found anew without each seed."""
        total = self.counts.sum(axis=1)
        best = _best(total, rate)
        assert best is not None
        left_out = left_out_counts(self.counts)
        recalls = np.array([recall_at(counts, rate) for counts in left_out])
        return recall_interval(total[best, 1], total[best, 0], recalls, settings)


def recall_lost(truth: ThresholdSweep, sensed: ThresholdSweep, settings: ScoringSettings) -> list[RecallLost]:
    """Return what sensing costs in recall at each rate, from the curves of the same seeds on true and sensed motion.

    The interval leaves the same seeds out of both, so that traffic that is hard for both does not widen it.
    """
    left_out = list(zip(left_out_counts(truth.counts), left_out_counts(sensed.counts), strict=True))
    costs = []
    for rate in settings.false_alarms_per_vehicle_hour:
        recalls = [recall_at(sweep.counts.sum(axis=1), rate) for sweep in (truth, sensed)]
        lost = np.array([recall_at(of_truth, rate) - recall_at(of_sensed, rate) for of_truth, of_sensed in left_out])
        costs.append(
            RecallLost(
                false_alarms_per_vehicle_hour=rate,
                truth=recalls[0],
                sensed=recalls[1],
                lost=recalls[0] - recalls[1],
                interval=interval_over_seeds(recalls[0] - recalls[1], lost, settings),
            )
        )
    return costs


def left_out_counts(counts: Array) -> Array:
    """Return the counts of all episodes but one, for each in turn; counts: (t, episodes, c). Returns (episodes, t, c).

    A single episode leaves nothing, which gives no interval.
    """
    if counts.shape[1] < 2:
        return np.empty((0, counts.shape[0], counts.shape[2]))
    return np.asarray(counts.sum(axis=1) - counts.transpose(1, 0, 2))


def recall_at(counts: Array, rate: float) -> float:
    """Return the highest recall at a rate; counts: events, predicted events, false alarms and hours, (t, 4)."""
    best = _best(counts, rate)
    return 0.0 if best is None else float(_recalls(counts)[best])


def candidate_thresholds(levels: Sequence[Levels], count: int, intentions: Sequence[int] | None = None) -> Array:
    """Return thresholds between which the number of alarms changes about evenly in its logarithm, falling, (t,).

    levels: confirmed, of several episodes. count: the most thresholds to return. intentions: numbers of those whose
    levels matter; all by default.
    """
    values = np.sort(np.concatenate([np.empty(0, np.float32), *(peaks(level, intentions) for level in levels)]))[::-1]
    if not len(values):
        return np.empty(0)
    ranks = np.unique(np.rint(np.geomspace(1, len(values), count)).astype(np.int64)) - 1
    return np.unique(values[ranks].astype(np.float64))[::-1]


def _best(counts: Array, rate: float) -> int | None:
    """Return the row of the best thresholds; counts: events, predicted events, false alarms and hours, (t, 4)."""
    allowed = np.flatnonzero(_rates(counts) <= rate + 1e-9)
    if not len(allowed):
        return None
    recalls = _recalls(counts)[allowed]
    return int(allowed[np.flatnonzero(recalls == recalls.max())[0]])


def _rates(counts: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(counts[:, 3] > 0, counts[:, 2] / counts[:, 3], np.inf)


def _recalls(counts: Array) -> Array:
    return np.asarray(counts[:, 1] / np.maximum(counts[:, 0], 1))
