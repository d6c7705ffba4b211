"""The seven intentions, their numbers on disk, and the event: one labelled maneuver."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from enum import IntEnum


class Intention(IntEnum):
    """An intention. Its value is the `label` in a dataset, its lower-case name the `intention`."""

    HARD_BRAKE = 0
    LEFT_LANE_CHANGE = 1
    RIGHT_LANE_CHANGE = 2
    OVERTAKE = 3
    HARD_ACCEL = 4
    EVASIVE_SWERVE = 5
    FOLLOWING = 6

    @property
    def text(self) -> str:
        """The name in datasets and reports, such as `hard_brake`."""
        return self.name.lower()


KNOWN = tuple(intention for intention in Intention if intention is not Intention.FOLLOWING)
"""The six intentions that predictors are trained on; `following` is the unknown class."""

LANE_CHANGES = (Intention.LEFT_LANE_CHANGE, Intention.RIGHT_LANE_CHANGE)


def outward(lefthand: bool) -> Intention:
    """Return the lane change by which an overtake pulls out: to the left, or to the right where traffic keeps left."""
    return Intention.RIGHT_LANE_CHANGE if lefthand else Intention.LEFT_LANE_CHANGE


def spoken(name: str) -> str:
    """Return a name such as `left_lane_change` as people write it."""
    return name.replace("_", " ")


def over_text(over: Collection[object] | None, classes: Collection[object]) -> str:
    """Return over which share of the intentions a macro-F1 is taken, where it is not taken over all of them.

    over: the intentions in the mean, None where that is not known. classes: all of them.
    """
    if over is None or len(over) == len(classes):
        return ""
    return f" over {len(over)} of {len(classes)} intentions"


@dataclass(frozen=True)
class Event:
    """One labelled maneuver of one vehicle.

    onset: first motion, traced back from the commit, s of simulation time.
    commit: the maneuver is decided, s: the marking is crossed, the threshold or the lateral peak reached.
    end: the maneuver is over, s.
    peak: the acceleration that defines it, m/s2: along the road (negative for braking), or across it (left positive).
    other: the vehicle that it refers to (the one overtaken, the leader followed), if any.
    motion_end: when the motion that belongs to the event ends, s, where that is before `end`: an overtake ends with the
    return, its motion with the pulling-out.
    mark: why the event becomes no sample, if so; for example, a lane change that passed a vehicle and did not
    return (see `labeling.detectors.overtake`).
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
        """When the motion that belongs to the event ends, s."""
        return self.end if self.motion_end is None else self.motion_end
