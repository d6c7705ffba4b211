"""Which alarm belongs to which event: one to one, within each vehicle and intention."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from isacsim.arrays import Array, IntArray
from labeling.intentions import KNOWN, Intention
from models.live.alarms import Alarms
from models.live.events import LiveEvent

ALSO = {
    Intention.OVERTAKE: (Intention.LEFT_LANE_CHANGE, Intention.RIGHT_LANE_CHANGE),
    Intention.LEFT_LANE_CHANGE: (Intention.OVERTAKE,),
    Intention.RIGHT_LANE_CHANGE: (Intention.OVERTAKE,),
}
"""What a neutral event of an intention may as well have been: a pulling-out whose outcome is open is either."""


@dataclass(frozen=True)
class Matching:
    """The events that count, and the alarms, of one episode.

    event_alarm: number of the alarm that belongs to each event, -1 if it was missed, (number of events,). false:
    numbers of the alarms that belong to no event, not even to a neutral one.
    """

    event_alarm: IntArray
    false: IntArray


def match(times: Array, earliest: Array, latest: Array) -> IntArray:
    """Match alarms to events, one to one: as many as possible, and of equally many the earliest alarms.

    times: of the alarms, s, (a,). earliest, latest: the time within which an alarm belongs to each event, s, (e,).
    Returns the number of each event's alarm, -1 where it has none, (e,).
    """
    event_alarm = np.full(len(earliest), -1, dtype=np.int64)
    if not len(times) or not len(earliest):
        return event_alarm
    fits = (times >= earliest[:, None] - 1e-9) & (times <= latest[:, None] + 1e-9)
    # The bonus for an early alarm stays below one match, all events together.
    late = (times - times.min()) / max(float(np.ptp(times)), 1e-9)
    bonus = (1 - late) / (len(earliest) + 1)
    rows, columns = linear_sum_assignment(np.where(fits, -1.0 - bonus, 0.0))
    matched = fits[rows, columns]
    event_alarm[rows[matched]] = columns[matched]
    return event_alarm


@dataclass(frozen=True)
class EventTable:
    """The events of one episode, ready for matching: those that count in the order given, and the neutral ones.

    vehicle, intention: numbers, (e,). earliest: when an alarm may come first, s, (e,). neutral_*: the same of neutral
    events, once for each intention that an alarm about them may name.
    """

    vehicle: IntArray
    intention: IntArray
    earliest: Array
    latest: Array
    neutral_vehicle: IntArray
    neutral_intention: IntArray
    neutral_earliest: Array
    neutral_latest: Array

    @classmethod
    def of(cls, events: tuple[LiveEvent, ...], names: tuple[str, ...], before_onset_s: float) -> EventTable:
        """Return the table of an episode's events.

        names: of the watched vehicles, by number. before_onset_s: how long before onset an alarm may come, s.
        """
        number = {name: k for k, name in enumerate(names)}
        counted: list[tuple[float, ...]] = []
        neutral: list[tuple[float, ...]] = []
        for event in events:
            intention = Intention[event.intention.upper()]
            times = (event.onset - before_onset_s, event.end)
            vehicle = number.get(event.vehicle, -1)
            if event.left_out is None:
                counted.append((vehicle, KNOWN.index(intention), *times))
            else:
                may_be = (intention, *ALSO.get(intention, ()))
                neutral += [(vehicle, KNOWN.index(other), *times) for other in may_be]
        columns = [np.array(rows, np.float64).reshape(-1, 4) for rows in (counted, neutral)]
        arrays = [
            (table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2], table[:, 3]) for table in columns
        ]
        return cls(*arrays[0], *arrays[1])

    def match(self, alarms: Alarms) -> Matching:
        """Match the alarms of the episode to its events."""
        event_alarm = np.full(len(self.vehicle), -1, dtype=np.int64)
        used = np.zeros(len(alarms), dtype=bool)
        keys = np.stack([self.vehicle, self.intention], axis=1)
        for vehicle, intention in np.unique(keys, axis=0).tolist() if len(alarms) else []:
            events = np.flatnonzero((keys == (vehicle, intention)).all(axis=1))
            candidates = np.flatnonzero((alarms.vehicle == vehicle) & (alarms.intention == intention))
            matched = match(alarms.time_s[candidates], self.earliest[events], self.latest[events])
            hit = matched >= 0
            event_alarm[events[hit]] = candidates[matched[hit]]
            used[candidates[matched[hit]]] = True
        for k in range(len(self.neutral_vehicle) if len(alarms) else 0):
            used |= (
                (alarms.vehicle == self.neutral_vehicle[k])
                & (alarms.intention == self.neutral_intention[k])
                & (alarms.time_s >= self.neutral_earliest[k] - 1e-9)
                & (alarms.time_s <= self.neutral_latest[k] + 1e-9)
            )
        return Matching(event_alarm, np.flatnonzero(~used))
