"""The right answer to each decision: in which interval before onset an intention lies, and whether a pull-out passes.

Overtakes, and pull-outs whose outcome is open, are changes to the faster side here: what becomes of a pull-out is
mostly decided after it has begun. Whether the TV passes the UV is a question of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.labeling.intentions import Intention
from isac_cosim.labeling.samples.pull_outs import DROPPED
from isac_cosim.labeling.streams.events import LiveEvent
from isac_cosim.models.hazards.answers import IGNORED, WITH_HAZARD

PASSES: dict[str, int] = {"passed_did_not_return": 1, "unresolved": IGNORED}
"""Whether pull-outs that are in no class pass the UV."""
assert set(PASSES) == set(DROPPED)


@dataclass(frozen=True)
class Targets:
    """The right answers to n decisions of a vehicle.

    interval: number of the interval before onset for each of WITH_HAZARD, or the number of horizons where none begins,
    or IGNORED, (n, 5). passing: 1 where a pull-out passes its UV, 0 where it does not, IGNORED elsewhere, (n,).
    """

    interval: IntArray
    passing: IntArray

    def positive(self, horizons: int) -> BoolArray:
        """Return at which decisions some intention begins within the last horizon or is under way, (n,)."""
        return np.asarray(((self.interval >= 0) & (self.interval < horizons)).any(axis=1))


def targets_of(
    events: Sequence[LiveEvent], time_s: Array, horizons_s: Sequence[float], change_out: Intention
) -> Targets:
    """Return the answers to decisions at some instants (s), (n,). events: of the vehicle. change_out: a pull-out."""
    none, reach_s = len(horizons_s), horizons_s[-1]
    interval = np.full((len(time_s), len(WITH_HAZARD)), none, np.int64)
    passing = np.full(len(time_s), IGNORED, np.int64)
    counted = [event for event in events if _counts(event)]
    for event in events:
        column = WITH_HAZARD.index(_asked(event, change_out))
        # What counts is ignored only after its commit; from before its onset until then it is positive, below.
        interval[_within(time_s, event.onset - reach_s, event.end), column] = IGNORED
    for event in counted:
        column = WITH_HAZARD.index(_asked(event, change_out))
        rows = _within(time_s, event.onset - reach_s, event.commit)
        until_s = np.maximum(event.onset - time_s[rows], 0.0)
        interval[rows, column] = np.minimum(np.searchsorted(np.asarray(horizons_s) + 1e-9, until_s), none - 1)
        if _asked(event, change_out) is change_out:
            passing[rows] = _passes(event)
    return Targets(interval, passing)


def _counts(event: LiveEvent) -> bool:
    """Return whether alarms for an event are right, with overtakes as changes of lane."""
    return event.left_out is None or event.left_out in DROPPED


def _asked(event: LiveEvent, change_out: Intention) -> Intention:
    return change_out if _is_pull_out(event) else Intention[event.intention.upper()]


def _passes(event: LiveEvent) -> int:
    return int(event.intention == Intention.OVERTAKE.text) if event.left_out is None else PASSES[event.left_out]


def _within(time_s: Array, first_s: float, last_s: float) -> BoolArray:
    return np.asarray((time_s >= first_s - 1e-9) & (time_s <= last_s + 1e-9))


def counted_intentions(event: LiveEvent, change_out: Intention) -> set[Intention]:
    """Return the intentions of WITH_HAZARD, and OVERTAKE, that an event is one more event to learn of."""
    if not _counts(event):
        return set()
    return {_asked(event, change_out)} | (
        {Intention.OVERTAKE} if _passes(event) == 1 and _is_pull_out(event) else set()
    )


def _is_pull_out(event: LiveEvent) -> bool:
    return event.intention == Intention.OVERTAKE.text or event.left_out in DROPPED
