"""Scores of alarms: recall, lead times and false alarms, pooled over episodes, with intervals over seeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.stats import chi2

from isacsim.arrays import Array, BoolArray, IntArray
from isacsim.seeding import stream
from labeling.events import Origin
from labeling.intentions import KNOWN
from models.live.alarms import Alarms, Levels, peaks, raised
from models.live.events import GROUPS
from models.live.matching import EventTable
from models.live.results import (
    COMMIT_IS,
    CurvePoint,
    EventScores,
    GroupScores,
    Interval,
    LeadTimes,
    RecallLost,
    TimeToCommit,
)
from models.live.settings import ScoringSettings
from models.live.store import LiveEpisode

BOUND = 0.95
"""Confidence of the upper bound of a rate of false alarms."""
TIMES_TO_COMMIT_S = (0.0, 0.2, 0.5, 0.8, 1.0, 1.5, 2.0, 3.0)
"""Where recall against time to commit is read, s."""


@dataclass(frozen=True)
class Outcome:
    """What came of the alarms in one episode.

    intention, group: of each event that counts, numbers in KNOWN and GROUPS, (e,). to_commit, to_onset: from its alarm
    to its commit and onset, s, NaN where it has none, (e,). false_intention, false_group: of each false alarm, (f,).
    hours: for which vehicles were predicted, by group, (3,).
    """

    intention: IntArray
    group: IntArray
    to_commit: Array
    to_onset: Array
    false_intention: IntArray
    false_group: IntArray
    hours: Array

    @property
    def predicted(self) -> BoolArray:
        """Which events had their alarm by the commit, (e,)."""
        return np.asarray(self.to_commit >= -1e-9)

    @property
    def alarmed(self) -> BoolArray:
        """Which events had an alarm, (e,)."""
        return np.isfinite(self.to_commit)

    def of(self, intention: int | None = None, group: Origin | None = None) -> Outcome:
        """Return the part of one intention, or group, or both."""
        events = np.ones(len(self.intention), dtype=bool)
        false = np.ones(len(self.false_intention), dtype=bool)
        hours = self.hours
        if intention is not None:
            events &= self.intention == intention
            false &= self.false_intention == intention
        if group is not None:
            number = GROUPS.index(group)
            events &= self.group == number
            false &= self.false_group == number
            hours = np.where(np.arange(len(GROUPS)) == number, hours, 0.0)
        return Outcome(
            self.intention[events], self.group[events], self.to_commit[events], self.to_onset[events],
            self.false_intention[false], self.false_group[false], hours,
        )  # fmt: skip


@dataclass(frozen=True)
class Truth:
    """The events of one episode, ready to be held against alarms. onset, commit, group: of those that count, (e,)."""

    episode: LiveEpisode
    table: EventTable
    onset: Array
    commit: Array
    group: IntArray

    @classmethod
    def of(cls, episode: LiveEpisode, before_onset_s: float) -> Truth:
        """Return the truth of an episode. before_onset_s: how long before onset an alarm may come, s."""
        counted = [event for event in episode.facts.events if event.left_out is None]
        return cls(
            episode,
            EventTable.of(episode.facts.events, episode.names, before_onset_s),
            np.array([event.onset for event in counted]),
            np.array([event.commit for event in counted]),
            np.array([GROUPS.index(event.group) for event in counted], dtype=np.int64),
        )

    def outcome(self, alarms: Alarms) -> Outcome:
        """Return what came of the alarms in the episode."""
        matching = self.table.match(alarms)
        hit = matching.event_alarm >= 0
        at = np.full(len(hit), np.nan)
        at[hit] = alarms.time_s[matching.event_alarm[hit]]
        group = self.episode.group
        shares = np.bincount(group, minlength=len(GROUPS)) * self.episode.facts.decision_s / 3600
        return Outcome(
            intention=self.table.intention,
            group=self.group,
            to_commit=self.commit - at,
            to_onset=self.onset - at,
            false_intention=alarms.intention[matching.false],
            false_group=group[alarms.row[matching.false]],
            hours=shares,
        )


def event_scores(
    outcomes: Sequence[Outcome], settings: ScoringSettings, key: str, commit_is: str | None = None
) -> EventScores:
    """Return the scores of alarms, pooled over the outcomes of several seeds. key: names the bootstrap's draw."""
    events = sum(len(outcome.intention) for outcome in outcomes)
    predicted = sum(int(outcome.predicted.sum()) for outcome in outcomes)
    alarmed = sum(int(outcome.alarmed.sum()) for outcome in outcomes)
    false = sum(len(outcome.false_intention) for outcome in outcomes)
    hours = float(sum(outcome.hours.sum() for outcome in outcomes))
    recall, precision = _ratio(predicted, events), _ratio(predicted, predicted + false)
    return EventScores(
        events=events,
        predicted=predicted,
        detected=alarmed - predicted,
        missed=events - alarmed,
        false_alarms=false,
        vehicle_hours=hours,
        precision=precision,
        recall=recall,
        f1=_f1(precision, recall),
        recall_with_detection=_ratio(alarmed, events),
        precision_with_detection=_ratio(alarmed, alarmed + false),
        recall_interval=_recall_interval(outcomes, settings, key),
        false_alarms_per_vehicle_hour=_ratio(false, hours),
        false_alarms_per_vehicle_hour_upper=_ratio(float(chi2.ppf(BOUND, 2 * (false + 1))) / 2, hours),
        lead_time_s=lead_times(np.concatenate([np.empty(0), *(outcome.to_commit for outcome in outcomes)])),
        lead_to_onset_s=lead_times(np.concatenate([np.empty(0), *(outcome.to_onset for outcome in outcomes)])),
        commit_is=commit_is,
    )


def group_scores(
    outcomes: Sequence[Outcome], settings: ScoringSettings, key: str, group: Origin | None = None
) -> GroupScores:
    """Return the scores over all intentions and of each, of one group of events or of all."""
    by_intention = {
        intention.text: event_scores(
            [outcome.of(number, group) for outcome in outcomes], settings, key, COMMIT_IS[intention.text]
        )
        for number, intention in enumerate(KNOWN)
    }
    return GroupScores(
        over_all=event_scores([outcome.of(group=group) for outcome in outcomes], settings, key),
        by_intention=by_intention,
    )


def lead_times(values: Array) -> LeadTimes:
    """Return median and quartiles of lead times, s, (n,); NaN stands for an event without an alarm."""
    kept = values[np.isfinite(values)]
    low, middle, high = np.quantile(kept, [0.25, 0.5, 0.75]).tolist() if len(kept) else (None, None, None)
    return LeadTimes(n=len(kept), lower_quartile=low, median=middle, upper_quartile=high)


def by_time_to_commit(outcomes: Sequence[Outcome]) -> list[TimeToCommit]:
    """Return the share of events that had their alarm at least so long before the commit, for some times."""
    leads = np.concatenate([np.empty(0), *(outcome.to_commit for outcome in outcomes)])
    return [
        TimeToCommit(time_to_commit_s=time, recall=_ratio(int((leads >= time - 1e-9).sum()), len(leads)))
        for time in TIMES_TO_COMMIT_S
    ]


@dataclass(frozen=True)
class Sweep:
    """What came of the alarms of several episodes at several thresholds.

    thresholds: falling, (t,). outcomes: of every threshold, one of each episode.
    """

    thresholds: Array
    outcomes: tuple[tuple[Outcome, ...], ...]

    @classmethod
    def of(cls, truths: Sequence[Truth], levels: Sequence[Levels], refractory_s: float, count: int) -> Sweep:
        """Try thresholds on episodes. levels: confirmed, of each episode. count: how many thresholds to try."""
        thresholds = candidate_thresholds(levels, count)
        outcomes = tuple(
            tuple(
                truth.outcome(raised(level, threshold, refractory_s))
                for truth, level in zip(truths, levels, strict=True)
            )
            for threshold in thresholds.tolist()
        )
        return cls(thresholds, outcomes)

    def rates(self) -> Array:
        """Return the false alarms per vehicle-hour at each threshold, (t,); infinite without any hour."""
        return _rates(self.counts.sum(axis=1))

    def recalls(self) -> Array:
        """Return the recall at each threshold, (t,); 0 without any event."""
        return _recalls(self.counts.sum(axis=1))

    def best(self, rate: float) -> int | None:
        """Return the threshold, by number, of the highest recall at no more than a rate of false alarms."""
        return _best(self.counts.sum(axis=1), rate)

    def f1(self) -> Array:
        """Return the F1 of prediction at each threshold, (t,); 0 without any event."""
        events, predicted, false, _ = self.counts.sum(axis=1).T
        return np.asarray(2 * predicted / np.maximum(predicted + false + events, 1))

    def point(self, rate: float, settings: ScoringSettings, key: str) -> CurvePoint:
        """Return the curve at a rate of false alarms per vehicle-hour. key: names the bootstrap's draw."""
        best = self.best(rate)
        outcomes = () if best is None else self.outcomes[best]
        scores = event_scores(outcomes, settings, key)
        events = len(self.outcomes) and sum(len(outcome.intention) for outcome in self.outcomes[0])
        none = None if not events else 0.0  # No threshold is that quiet: silence is.
        return CurvePoint(
            false_alarms_per_vehicle_hour=rate,
            measured=scores.false_alarms_per_vehicle_hour,
            threshold=None if best is None else float(self.thresholds[best]),
            recall=none if best is None else scores.recall,
            recall_interval=None if best is None else self._interval(rate, settings, key),
            recall_with_detection=none if best is None else scores.recall_with_detection,
            median_lead_s=scores.lead_time_s.median,
            by_intention={
                intention.text: event_scores([outcome.of(k) for outcome in outcomes], settings, key).recall
                for k, intention in enumerate(KNOWN)
            },
        )

    @cached_property
    def counts(self) -> Array:
        """The numbers of events, predictions and false alarms, and the hours, (t, episodes, 4)."""
        rows = [
            [(len(o.intention), o.predicted.sum(), len(o.false_intention), o.hours.sum()) for o in outcomes]
            for outcomes in self.outcomes
        ]
        return np.array(rows, dtype=np.float64).reshape(
            len(self.outcomes), len(self.outcomes[0]) if self.outcomes else 0, 4
        )

    def _interval(self, rate: float, settings: ScoringSettings, key: str) -> Interval | None:
        """Return the interval of the recall at a rate over seeds; the threshold is found anew for each resample."""
        counts = self.counts
        drawn = _resamples(counts.shape[1], settings, key)
        if drawn is None:
            return None
        return _interval(np.array([_recall_at(counts[:, rows].sum(axis=1), rate) for rows in drawn]), settings)


def recall_lost(truth: Sweep, sensed: Sweep, settings: ScoringSettings) -> list[RecallLost]:
    """Return what sensing costs in recall at each rate, from the curves of the same seeds on true and sensed motion.

    Both resample the same seeds, so that the traffic that is hard for both does not widen the interval.
    """
    drawn = _resamples(truth.counts.shape[1], settings, "recall lost")
    costs = []
    for rate in settings.false_alarms_per_vehicle_hour:
        recalls = [_recall_at(sweep.counts.sum(axis=1), rate) for sweep in (truth, sensed)]
        lost = [] if drawn is None else [_lost(truth.counts[:, rows], sensed.counts[:, rows], rate) for rows in drawn]
        costs.append(
            RecallLost(
                false_alarms_per_vehicle_hour=rate,
                truth=recalls[0],
                sensed=recalls[1],
                lost=recalls[0] - recalls[1],
                interval=_interval(np.array(lost), settings),
            )
        )
    return costs


def _lost(truth: Array, sensed: Array, rate: float) -> float:
    """Return the difference of the recalls at a rate; counts of both: (t, seeds, 4)."""
    return _recall_at(truth.sum(axis=1), rate) - _recall_at(sensed.sum(axis=1), rate)


def _recall_at(counts: Array, rate: float) -> float:
    """Return the highest recall at a rate; counts: of events, predictions, false alarms and hours, (t, 4)."""
    best = _best(counts, rate)
    return 0.0 if best is None else float(_recalls(counts)[best])


def candidate_thresholds(levels: Sequence[Levels], count: int) -> Array:
    """Return thresholds between which the number of alarms changes about evenly in its logarithm, falling, (t,)."""
    values = np.sort(np.concatenate([np.empty(0, np.float32), *(peaks(level) for level in levels)]))[::-1]
    if not len(values):
        return np.empty(0)
    ranks = np.unique(np.rint(np.geomspace(1, len(values), count)).astype(np.int64)) - 1
    return np.unique(values[ranks].astype(np.float64))[::-1]


def _best(counts: Array, rate: float) -> int | None:
    """Return the number of the best threshold; counts: of events, predictions, false alarms and hours, (t, 4)."""
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


def _recall_interval(outcomes: Sequence[Outcome], settings: ScoringSettings, key: str) -> Interval | None:
    drawn = _resamples(len(outcomes), settings, key)
    if drawn is None:
        return None
    predicted = np.array([outcome.predicted.sum() for outcome in outcomes], dtype=np.float64)
    events = np.array([len(outcome.intention) for outcome in outcomes], dtype=np.float64)
    total = events[drawn].sum(axis=1)
    return _interval(predicted[drawn].sum(axis=1)[total > 0] / total[total > 0], settings)


def _resamples(count: int, settings: ScoringSettings, key: str) -> IntArray | None:
    """Return bootstrap resamples of `count` seeds, (resamples, count); None with fewer than two seeds."""
    if count < 2:
        return None
    return stream("live bootstrap", key, count).integers(0, count, (settings.resamples, count))


def _interval(values: Array, settings: ScoringSettings) -> Interval | None:
    if not len(values):
        return None
    tail = (1 - settings.confidence) / 2
    low, high = np.quantile(values, [tail, 1 - tail]).tolist()
    return Interval(low=low, high=high)


def _ratio(part: float, whole: float) -> float | None:
    return float(part / whole) if whole > 0 else None


def _f1(precision: float | None, recall: float | None) -> float | None:
    if precision is None or recall is None:
        return None if recall is None else 0.0
    return 2 * precision * recall / (precision + recall) if precision + recall > 0 else 0.0
