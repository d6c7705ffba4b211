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


@dataclass(frozen=True)
class Event:
    """One labelled maneuver of one vehicle.

    onset: first motion; commit: marking crossed, threshold reached, or lateral peak; end: all s of simulation time.
    peak: the value that defines it: acceleration in m/s2, or lateral acceleration in m/s2 for lateral maneuvers.
    other: the vehicle it is about (the one overtaken, the leader followed), if any.
    """

    vehicle: str
    intention: Intention
    onset: float
    commit: float
    end: float
    peak: float
    other: str | None = None
