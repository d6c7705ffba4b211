"""Matches alarms to events one to one, within each vehicle and intention."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import linear_sum_assignment

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.evaluation.in_traffic.alarms.alarms import Alarms
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.labeling.streams.events import NEAR_MISS, LiveEvent

ALSO = {
    Intention.OVERTAKE: (Intention.LEFT_LANE_CHANGE, Intention.RIGHT_LANE_CHANGE),
    Intention.LEFT_LANE_CHANGE: (Intention.OVERTAKE,),
    Intention.RIGHT_LANE_CHANGE: (Intention.OVERTAKE,),
}
"""Other intentions that a neutral event may have had: a pulling-out with an open outcome may be any of them."""


@dataclass(frozen=True)
class Matching:
    """The matched events and alarms of one episode.

    event_alarm: number of the alarm that belongs to each event that counts, -1 for a missed event, (e,). false: numbers
    of the alarms that belong to no event, neither to one that counts nor to a neutral one. near_misses: numbers of the
    alarms that would be false if near misses were not neutral.
    """

    event_alarm: IntArray
    false: IntArray
    near_misses: IntArray


def match(times: Array, earliest: Array, latest: Array, commit: Array) -> IntArray:
    """Match as many alarms to events as possible, one to one; of these, as many as possible by the commit.

    Where there still is a choice, the earliest alarms are matched.
    times: of the alarms, s, (a,). earliest, latest: when an alarm for each event may come, s, (e,). commit: of each
    event, s, (e,).
    Returns the number of each event's alarm, -1 if it has none, (e,).
    """
    event_alarm = np.full(len(earliest), -1, dtype=np.int64)
    if not len(times) or not len(earliest):
        return event_alarm
    fits = (times >= earliest[:, None] - 1e-9) & (times <= latest[:, None] + 1e-9)
    if len(earliest) == 1:
        fitting = np.flatnonzero(fits[0])
        if len(fitting):
            event_alarm[0] = fitting[times[fitting].argmin()]
        return event_alarm
    # The bonus of all alarms by the commit together stays below one match, that of all early alarms below one of these.
    share = 1.0 / (len(earliest) + 1)
    late = (times - times.min()) / max(float(np.ptp(times)), 1e-9)
    bonus = share * ((times <= commit[:, None] + 1e-9) + share * (1 - late))
    rows, columns = linear_sum_assignment(np.where(fits, -1.0 - bonus, 0.0))
    matched = fits[rows, columns]
    event_alarm[rows[matched]] = columns[matched]
    return event_alarm


@dataclass(frozen=True)
class EventTable:
    """The events of one episode as arrays: those that count, in the order given, and the neutral ones.

    vehicle, intention: numbers, (e,). earliest, latest: when an alarm may come, s, (e,). commit: s, (e,). neutral_*:
    the same of neutral events, with a row for each intention that an alarm for the event may name. near_miss: which
    neutral events are near misses.
    """

    vehicle: IntArray
    intention: IntArray
    earliest: Array
    latest: Array
    commit: Array
    neutral_vehicle: IntArray
    neutral_intention: IntArray
    neutral_earliest: Array
    neutral_latest: Array
    near_miss: BoolArray

    @classmethod
    def of(cls, events: tuple[LiveEvent, ...], names: tuple[str, ...], before_onset_s: float) -> EventTable:
        """Return the table of an episode's events.

        names: of the watched vehicles, in the order of their numbers. before_onset_s: how early before onset an alarm
        may come, s.
        """
        number = {name: k for k, name in enumerate(names)}
        counted: list[tuple[float, ...]] = []
        neutral: list[tuple[float, ...]] = []
        near_miss: list[bool] = []
        for event in events:
            intention = Intention[event.intention.upper()]
            times = (event.onset - before_onset_s, event.end, event.commit)
            vehicle = number.get(event.vehicle, -1)
            if event.left_out is None:
                counted.append((vehicle, KNOWN.index(intention), *times))
            else:
                may_be = (intention, *ALSO.get(intention, ()))
                neutral += [(vehicle, KNOWN.index(other), *times) for other in may_be]
                near_miss += [event.left_out == NEAR_MISS] * len(may_be)
        columns = [np.array(rows, np.float64).reshape(-1, 5) for rows in (counted, neutral)]
        who, who_neutral = (table[:, 0].astype(np.int64) for table in columns)
        what, what_neutral = (table[:, 1].astype(np.int64) for table in columns)
        (earliest, latest, commit), (earliest_neutral, latest_neutral, _) = (table[:, 2:].T for table in columns)
        return cls(
            vehicle=who,
            intention=what,
            earliest=earliest,
            latest=latest,
            commit=commit,
            neutral_vehicle=who_neutral,
            neutral_intention=what_neutral,
            neutral_earliest=earliest_neutral,
            neutral_latest=latest_neutral,
            near_miss=np.array(near_miss, bool),
        )

    def match(self, alarms: Alarms) -> Matching:
        """Match the alarms of the episode to its events."""
        event_alarm = np.full(len(self.vehicle), -1, dtype=np.int64)
        used = np.zeros(len(alarms), dtype=bool)
        order, slices = _by_key(alarms, self._keys)
        for key, (begin, end) in slices.items():
            events, candidates = self._events[key], order[begin:end]
            spans = (self.earliest[events], self.latest[events], self.commit[events])
            matched = match(alarms.time_s[candidates], *spans)
            hit = matched >= 0
            event_alarm[events[hit]] = candidates[matched[hit]]
            used[candidates[matched[hit]]] = True
        nearly = np.zeros(len(alarms), dtype=bool)
        order, slices = _by_key(alarms, self._neutral_keys)
        for key, (begin, end) in slices.items():
            events, candidates = self._neutral_events[key], order[begin:end]
            time_s = alarms.time_s[candidates][:, None]
            within = (time_s >= self.neutral_earliest[events] - 1e-9) & (time_s <= self.neutral_latest[events] + 1e-9)
            used[candidates[(within & ~self.near_miss[events]).any(axis=1)]] = True
            nearly[candidates[within.any(axis=1)]] = True
        return Matching(event_alarm, np.flatnonzero(~used & ~nearly), np.flatnonzero(~used & nearly))

    @cached_property
    def _events(self) -> dict[int, IntArray]:
        """The events that count, by the key of their vehicle and intention."""
        return _grouped(_keys(self.vehicle, self.intention))

    @cached_property
    def _neutral_events(self) -> dict[int, IntArray]:
        """The neutral events, by the key of their vehicle and intention."""
        return _grouped(_keys(self.neutral_vehicle, self.neutral_intention))

    @cached_property
    def _keys(self) -> IntArray:
        return np.array(list(self._events), np.int64)

    @cached_property
    def _neutral_keys(self) -> IntArray:
        return np.array(list(self._neutral_events), np.int64)


def _keys(vehicle: IntArray, intention: IntArray) -> IntArray:
    """Return a number for each pair of vehicle and intention, (n,)."""
    return np.asarray(vehicle * len(KNOWN) + intention)


def _grouped(keys: IntArray) -> dict[int, IntArray]:
    """Return the places of each key, in order."""
    return {key: np.flatnonzero(keys == key) for key in np.unique(keys).tolist()}


def _by_key(alarms: Alarms, keys: IntArray) -> tuple[IntArray, dict[int, tuple[int, int]]]:
    """Sort alarms by key; return their order, and where in it the alarms of each key begin and end, if it has any."""
    of_alarms = _keys(alarms.vehicle, alarms.intention)
    order = np.argsort(of_alarms, kind="stable")
    begin, end = (np.searchsorted(of_alarms[order], keys, side) for side in ("left", "right"))
    some = np.flatnonzero(end > begin)
    spans = zip(begin[some].tolist(), end[some].tolist(), strict=True)
    return order, dict(zip(keys[some].tolist(), spans, strict=True))
