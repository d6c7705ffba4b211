"""What a closed loop measured, typed: what it adds to `metrics.json`.

Figures are those of `evaluation.closed_loop.safety.FIGURES`; one is None (`null`) where it is undefined.
"""

from __future__ import annotations

from isac_cosim.base.settings import Settings
from isac_cosim.evaluation.closed_loop.settings import Arm, ClosedLoopSettings
from isac_cosim.evaluation.in_traffic.scores.results import TrafficResult
from isac_cosim.evaluation.statistics import Interval


class ArmDifference(Settings):
    """How much an arm differs from `none` on the same seeds.

    value: arm minus none. relative: that over the figure of none. The intervals are t intervals of the delete-one
    jackknife over seeds, of 95 %; None with a single seed.
    """

    value: float | None
    interval: Interval | None
    relative: float | None
    relative_interval: Interval | None


class ArmResult(Settings):
    """One arm over all measured seeds.

    what: what it is. alarms: raised. advisories: sent; fates: what became of them. predicted_hours: vehicle-hours in
    which the network predicted. collided: vehicles that collided, none of which is in the figures. first_advisory_s:
    when the first was sent, s of simulation time, by seed; until then, the traffic is that of `none`.
    after_alarms: figures of the vehicles near an alarm, for some time after it, the same vehicles and times in every
    arm. all_traffic: of all vehicles all the time. difference: from `none`, of `after_alarms`.
    difference_collided: from `none`, of the number of vehicles that collide in a seed. collided_advised: how many of
    those that collided followed an advisory, before or after it. Both are None in earlier results.
    """

    what: str
    alarms: int
    advisories: int
    fates: dict[str, int]
    predicted_hours: float
    collided: int
    first_advisory_s: dict[str, float]
    after_alarms: dict[str, float | None]
    all_traffic: dict[str, float | None]
    difference: dict[str, ArmDifference]
    difference_all_traffic: dict[str, ArmDifference]
    difference_collided: ArmDifference | None = None
    collided_advised: int | None = None


class ClosedLoopLatency(Settings):
    """What passes between an event on the road and the driver's answer to an advisory, s.

    sensing_s: how far the sensed world trails the simulation (`isacsim.sensing.running.conditioning`). network_s: from
    the alarm to its display in the vehicle. reaction_s: from there to the driver's first motion, lowest and highest.
    """

    sensing_s: float
    network_s: float
    reaction_s: tuple[float, float]


class ClosedLoopFacts(Settings):
    """What holds for all arms.

    settings: of the loop. scored_vehicle_hours: in `after_alarms` of the arm `none`. placebo_equals_none: whether the
    traffic of both is the same to the last bit, as it has to be. seeds: measured.
    """

    settings: ClosedLoopSettings
    latency: ClosedLoopLatency
    scored_vehicle_hours: float
    placebo_equals_none: bool
    seeds: int


class ClosedLoopResult(TrafficResult):
    """The content of `metrics.json`: the open loop, and the arms of the closed one."""

    arms: dict[Arm, ArmResult]
    closed_loop: ClosedLoopFacts
