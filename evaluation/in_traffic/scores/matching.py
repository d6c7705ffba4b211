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
        of_alarms = _keys(alarms.vehicle, alarms.intention)
        order = np.lexsort((alarms.time_s, of_alarms))
        of_alarms, time_s = of_alarms[order], alarms.time_s[order]
        event, place = _fitting(of_alarms, time_s, self._key, self.earliest, self.latest)
        # An event alone with its vehicle and intention takes the first alarm that fits.
        alone = self._alone[event]
        lone, first = np.unique(event[alone], return_index=True)
        event_alarm[lone] = order[place[alone][first]]
        for key in np.unique(self._key[event[~alone]]).tolist():
            events, candidates = np.flatnonzero(self._key == key), np.flatnonzero(of_alarms == key)
            matched = match(time_s[candidates], self.earliest[events], self.latest[events], self.commit[events])
            hit = matched >= 0
            event_alarm[events[hit]] = order[candidates[matched[hit]]]
        used, nearly = np.zeros(len(alarms), dtype=bool), np.zeros(len(alarms), dtype=bool)
        used[event_alarm[event_alarm >= 0]] = True
        event, place = _fitting(of_alarms, time_s, self._neutral_key, self.neutral_earliest, self.neutral_latest)
        used[order[place[~self.near_miss[event]]]] = True
        nearly[order[place]] = True
        return Matching(event_alarm, np.flatnonzero(~used & ~nearly), np.flatnonzero(~used & nearly))

    @cached_property
    def _key(self) -> IntArray:
        return _keys(self.vehicle, self.intention)

    @cached_property
    def _neutral_key(self) -> IntArray:
        return _keys(self.neutral_vehicle, self.neutral_intention)

    @cached_property
    def _alone(self) -> BoolArray:
        """Whether no other event that counts has the same vehicle and intention, (e,)."""
        _, which, count = np.unique(self._key, return_inverse=True, return_counts=True)
        return np.asarray(count[which] == 1)


def _keys(vehicle: IntArray, intention: IntArray) -> IntArray:
    """Return a number for each pair of vehicle and intention, (n,)."""
    return np.asarray(vehicle * len(KNOWN) + intention)


def _fitting(
    of_alarms: IntArray, time_s: Array, of_events: IntArray, earliest: Array, latest: Array
) -> tuple[IntArray, IntArray]:
    """Return the pairs of an event and an alarm that fit: of the same key, and in time, (p,) each, by event and time.

    of_alarms, time_s: key and time of each alarm, sorted by both, (a,). of_events: key of each event, (e,).
    """
    begin, end = (np.searchsorted(of_alarms, of_events, side) for side in ("left", "right"))
    event = np.repeat(np.arange(len(of_events)), end - begin)
    place = np.arange(len(event)) - np.repeat(np.cumsum(end - begin) - end, end - begin)
    fits = (time_s[place] >= earliest[event] - 1e-9) & (time_s[place] <= latest[event] + 1e-9)
    return event[fits], place[fits]
