"""Scores of alarms: recall, lead times and false alarms, pooled over episodes, with intervals over seeds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.stats import binomtest, chi2

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.evaluation.in_traffic.alarms.alarms import Alarms
from isac_cosim.evaluation.in_traffic.scores.matching import EventTable
from isac_cosim.evaluation.in_traffic.scores.results import COMMIT_IS, EventScores, GroupScores, LeadTimes, TimeToCommit
from isac_cosim.evaluation.in_traffic.settings import ScoringSettings
from isac_cosim.evaluation.in_traffic.streams.store import LiveEpisode
from isac_cosim.evaluation.statistics import Interval, jackknife_half_width
from isac_cosim.labeling.detectors.events import Origin
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.labeling.streams.events import GROUPS, NEAR_MISS

BOUND = 0.95
"""Confidence of the upper bound of a rate of false alarms."""
PAST_S = 3.0
"""A false alarm up to this long after the end of an event belongs to its aftermath, s."""
TIMES_TO_COMMIT_S = (0.0, 0.2, 0.5, 0.8, 1.0, 1.5, 2.0, 3.0)
"""Times to commit at which recall is reported, s."""


@dataclass(frozen=True)
class AlarmOutcome:
    """The outcome of the alarms in one episode.

    intention, group: of each event that counts, as numbers in KNOWN and GROUPS, (e,). to_commit, to_onset: time from
    its alarm to its commit and to its onset, s, NaN if it has no alarm, (e,). false_intention, false_group: of each
    false alarm, (f,). near_intention: of each alarm that would be false if near misses were not neutral, (m,). hours:
    vehicle-hours with predictions, by group, (3,).
    """

    intention: IntArray
    group: IntArray
    to_commit: Array
    to_onset: Array
    false_intention: IntArray
    false_group: IntArray
    near_intention: IntArray
    hours: Array

    @property
    def predicted(self) -> BoolArray:
        """Which events had their alarm by the commit, (e,)."""
        return np.asarray(self.to_commit >= -1e-9)

    @property
    def alarmed(self) -> BoolArray:
        """Which events had an alarm, (e,)."""
        return np.isfinite(self.to_commit)

    def of(self, intention: int | None = None, group: Origin | None = None) -> AlarmOutcome:
        """Return the part of an intention, of a group, or of an intention in a group."""
        events = np.ones(len(self.intention), dtype=bool)
        false = np.ones(len(self.false_intention), dtype=bool)
        near, hours = self.near_intention, self.hours
        if intention is not None:
            near = near[near == intention]
            events &= self.intention == intention
            false &= self.false_intention == intention
        if group is not None:
            number = GROUPS.index(group)
            events &= self.group == number
            false &= self.false_group == number
            hours = np.where(np.arange(len(GROUPS)) == number, hours, 0.0)
        return AlarmOutcome(
            self.intention[events], self.group[events], self.to_commit[events], self.to_onset[events],
            self.false_intention[false], self.false_group[false], near, hours,
        )  # fmt: skip


@dataclass(frozen=True)
class Truth:
    """An episode with its events, to score alarms against.

    onset, commit, group: of the events that count, (e,). asked: numbers of the intentions that alarms are raised for;
    None for all.
    """

    episode: LiveEpisode
    table: EventTable
    onset: Array
    commit: Array
    group: IntArray
    asked: tuple[int, ...] | None = None

    @classmethod
    def of(cls, episode: LiveEpisode, before_onset_s: float) -> Truth:
        """Return the truth of an episode. before_onset_s: how early before onset an alarm may come, s."""
        counted = [event for event in episode.facts.events if event.left_out is None]
        return cls(
            episode,
            EventTable.of(episode.facts.events, episode.names, before_onset_s),
            np.array([event.onset for event in counted]),
            np.array([event.commit for event in counted]),
            np.array([GROUPS.index(event.group) for event in counted], dtype=np.int64),
        )

    def asking(self, intentions: Sequence[int], after_commit_s: float = 0.0) -> Truth:
        """Return the truth for alarms of some intentions alone. The episode, on which trees are trained, stays whole.

        after_commit_s: how long after the commit an alarm still comes in time, s.
        """
        kept = np.isin(self.table.intention, intentions)
        commit = self.commit[kept] + after_commit_s
        table = replace(
            self.table,
            vehicle=self.table.vehicle[kept],
            intention=self.table.intention[kept],
            earliest=self.table.earliest[kept],
            latest=np.maximum(self.table.latest[kept], commit),
            commit=commit,
        )
        return Truth(self.episode, table, self.onset[kept], commit, self.group[kept], tuple(intentions))

    def outcome(self, alarms: Alarms) -> AlarmOutcome:
        """Return the outcome of alarms in the episode."""
        matching = self.table.match(alarms)
        hit = matching.event_alarm >= 0
        at = np.full(len(hit), np.nan)
        at[hit] = alarms.time_s[matching.event_alarm[hit]]
        return AlarmOutcome(
            intention=self.table.intention,
            group=self.group,
            to_commit=self.commit - at,
            to_onset=self.onset - at,
            false_intention=alarms.intention[matching.false],
            false_group=self.episode.group[alarms.row[matching.false]],
            near_intention=alarms.intention[matching.near_misses],
            hours=self._hours,
        )

    @cached_property
    def _hours(self) -> Array:
        """Vehicle-hours with predictions, by group, (3,)."""
        return np.bincount(self.episode.group, minlength=len(GROUPS)) * self.episode.facts.decision_s / 3600


def false_alarms_near(truth: Truth, alarms: Alarms, before_onset_s: float) -> Counter[str]:
    """Return the number of false alarms by what else happens to the vehicle, as `AlarmResult.false_alarms_near`.

    Neutral events count like the others, near misses do not. before_onset_s: how early before onset an alarm may come,
    s.
    """
    names = truth.episode.names
    times: dict[str, list[tuple[float, float]]] = {}
    for event in truth.episode.facts.events:
        if event.left_out == NEAR_MISS:
            continue
        times.setdefault(event.vehicle, []).append((event.onset, event.end))
    near: Counter[str] = Counter()
    for row in truth.table.match(alarms).false.tolist():
        at, spans = float(alarms.time_s[row]), times.get(names[int(alarms.vehicle[row])], [])
        if any(onset - before_onset_s - 1e-9 <= at <= end + 1e-9 for onset, end in spans):
            near["event"] += 1
        elif any(end < at <= end + PAST_S for _, end in spans):
            near["past_event"] += 1
        else:
            near["nothing"] += 1
    return near


def event_scores(
    outcomes: Sequence[AlarmOutcome], settings: ScoringSettings, commit_is: str | None = None
) -> EventScores:
    """Return the scores of alarms, pooled over the outcomes of several seeds."""
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
        recall_interval=_recall_interval(outcomes, settings),
        false_alarms_per_vehicle_hour=_ratio(false, hours),
        false_alarms_per_vehicle_hour_upper=_ratio(float(chi2.ppf(BOUND, 2 * (false + 1))) / 2, hours),
        lead_time_s=lead_times(np.concatenate([np.empty(0), *(outcome.to_commit for outcome in outcomes)])),
        lead_to_onset_s=lead_times(np.concatenate([np.empty(0), *(outcome.to_onset for outcome in outcomes)])),
        commit_is=commit_is,
    )


def group_scores(
    outcomes: Sequence[AlarmOutcome], settings: ScoringSettings, group: Origin | None = None
) -> GroupScores:
    """Return the scores of all intentions together and of each, for one group of events or for all of them."""
    by_intention = {
        intention.text: event_scores(
            [outcome.of(number, group) for outcome in outcomes], settings, COMMIT_IS[intention.text]
        )
        for number, intention in enumerate(KNOWN)
    }
    return GroupScores(
        over_all=event_scores([outcome.of(group=group) for outcome in outcomes], settings),
        by_intention=by_intention,
    )


def recall_by_intention(outcomes: Sequence[AlarmOutcome]) -> dict[str, float | None]:
    """Return the recall of each intention, pooled over the outcomes of several seeds; None without an event."""
    intention = np.concatenate([np.empty(0, np.int64), *(outcome.intention for outcome in outcomes)])
    predicted = np.concatenate([np.empty(0, bool), *(outcome.predicted for outcome in outcomes)])
    hits = np.bincount(intention[predicted], minlength=len(KNOWN))
    events = np.bincount(intention, minlength=len(KNOWN))
    return {known.text: _ratio(int(hits[k]), int(events[k])) for k, known in enumerate(KNOWN)}


def lead_times(values: Array) -> LeadTimes:
    """Return median and quartiles of lead times (s), (n,), without those that are NaN: events without an alarm."""
    kept = values[np.isfinite(values)]
    low, middle, high = np.quantile(kept, [0.25, 0.5, 0.75]).tolist() if len(kept) else (None, None, None)
    return LeadTimes(n=len(kept), lower_quartile=low, median=middle, upper_quartile=high)


def median_lead(parts: Sequence[Array]) -> float | None:
    """Return the median of lead times, s, in several parts; None without any."""
    return lead_times(np.concatenate([np.empty(0), *parts])).median


def by_time_to_commit(outcomes: Sequence[AlarmOutcome]) -> list[TimeToCommit]:
    """Return the recall at each of TIMES_TO_COMMIT_S: the share of events whose alarm came at least that early."""
    leads = np.concatenate([np.empty(0), *(outcome.to_commit for outcome in outcomes)])
    return [
        TimeToCommit(time_to_commit_s=time, recall=_ratio(int((leads >= time - 1e-9).sum()), len(leads)))
        for time in TIMES_TO_COMMIT_S
    ]


def recall_interval(predicted: float, events: float, left_out: Array, settings: ScoringSettings) -> Interval | None:
    """Return the interval of a recall over seeds, within 0 and 1; None with a single seed, or where it is undefined.

    predicted, events: counts of all seeds. left_out: the recall of all seeds but one, for each in turn, (seeds,).
    If no event was predicted, or every one, seeds do not differ. The interval is then the exact one of a binomial
    share (Clopper & Pearson 1934), as if events were independent.
    """
    interval = interval_over_seeds(predicted / events if events else np.nan, left_out, settings)
    if interval is None:
        return None
    if predicted in (0, events):
        exact = binomtest(int(predicted), int(events)).proportion_ci(settings.confidence)
        return Interval(low=float(exact.low), high=float(exact.high), seeds=interval.seeds)
    return interval.model_copy(update={"low": max(interval.low, 0.0), "high": min(interval.high, 1.0)})


def interval_over_seeds(value: float, left_out: Array, settings: ScoringSettings) -> Interval | None:
    """Return the t interval of the delete-one jackknife; None with a single seed, or where it is undefined.

    value: the statistic of all seeds. left_out: that of all seeds but one, for each in turn, (seeds,).
    """
    half_width = float(jackknife_half_width(left_out, settings.confidence))
    if not np.isfinite(value) or not np.isfinite(half_width):
        return None
    return Interval(low=value - half_width, high=value + half_width, seeds=len(left_out))


def _recall_interval(outcomes: Sequence[AlarmOutcome], settings: ScoringSettings) -> Interval | None:
    """Return the interval of the recall over the outcomes of several seeds."""
    predicted = np.array([outcome.predicted.sum() for outcome in outcomes], dtype=np.float64)
    events = np.array([len(outcome.intention) for outcome in outcomes], dtype=np.float64)
    if not events.sum():
        return None
    others = events.sum() - events
    left_out = np.divide(predicted.sum() - predicted, others, out=np.full(len(events), np.nan), where=others > 0)
    return recall_interval(predicted.sum(), events.sum(), left_out, settings)


def rate_interval(outcomes: Sequence[AlarmOutcome], settings: ScoringSettings) -> Interval | None:
    """Return the interval of the false alarms per vehicle-hour over the outcomes of several seeds, no less than 0.

    None with a single seed, or where the rate is undefined without one of them. Where no seed has a false alarm, seeds
    do not differ: the interval is then the exact one of a Poisson process (Garwood 1936).
    """
    false = np.array([len(outcome.false_intention) for outcome in outcomes], dtype=np.float64)
    hours = np.array([outcome.hours.sum() for outcome in outcomes], dtype=np.float64)
    others = hours.sum() - hours
    left_out = np.divide(false.sum() - false, others, out=np.full(len(hours), np.nan), where=others > 0)
    interval = interval_over_seeds(false.sum() / hours.sum() if hours.sum() else np.nan, left_out, settings)
    if interval is None:
        return None
    if not false.any():
        most = float(chi2.ppf((1 + settings.confidence) / 2, 2)) / 2
        return interval.model_copy(update={"high": most / float(hours.sum())})
    return interval.model_copy(update={"low": max(interval.low, 0.0)})


def _ratio(part: float, whole: float) -> float | None:
    return float(part / whole) if whole > 0 else None


def _f1(precision: float | None, recall: float | None) -> float | None:
    if precision is None or recall is None:
        return None if recall is None else 0.0
    return 2 * precision * recall / (precision + recall) if precision + recall > 0 else 0.0
