"""The seven intentions, their numbers on disk, and the event that carries one."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Intention(IntEnum):
    """An intention; the value is the dataset's `label`, the lower-case name its `intention`."""

    HARD_BRAKE = 0
    LEFT_LANE_CHANGE = 1
    RIGHT_LANE_CHANGE = 2
    OVERTAKE = 3
    HARD_ACCEL = 4
    EVASIVE_SWERVE = 5
    FOLLOWING = 6

    @property
    def text(self) -> str:
        return self.name.lower()


KNOWN = tuple(i for i in Intention if i is not Intention.FOLLOWING)
"""The six intentions that predictors are trained on; `following` is the unknown class."""

LANE_CHANGES = (Intention.LEFT_LANE_CHANGE, Intention.RIGHT_LANE_CHANGE)

PULLING_OUT = (Intention.LEFT_LANE_CHANGE, Intention.OVERTAKE)
"""What a left lane change can turn out to be."""


@dataclass(frozen=True)
class Event:
    """One labelled maneuver of one vehicle.

    onset: first motion; commit: marking crossed, threshold reached, or lateral peak; end: all s of simulation time.
    peak: the value that defines it, m/s2: acceleration along the road (braking negative), or across it (left positive).
    other: the vehicle it is about (the one overtaken, the leader followed), if any.
    motion_end: until when the vehicle's own motion belongs to the event, s: `end`, but for an overtake the end of the
        pulling-out, since an overtake ends with the return.
    mark: why a lane change is neither a plain one nor an overtake, if so (see `labeling.detectors.overtake`).
    """

    vehicle: str
    intention: Intention
    onset: float
    commit: float
    end: float
    peak: float
    other: str | None = None
    motion_end: float | None = None
    mark: str | None = None

    @property
    def busy_until(self) -> float:
        return self.end if self.motion_end is None else self.motion_end
