"""Demand for a network that has none: a population of drivers, and routes along its main roads.

A large network is not filled. Routes are made along its main corridors, one after the other, until about the wanted
number of vehicles is on the road at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import sumolib.net
from pydantic import Field

from isac_cosim.base.errors import InputError
from isac_cosim.base.seeding import stream
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.scenarios.sumo_files import cleaned
from isac_cosim.isacsim.scenarios.xml_files import one_line

IMPATIENT_SHARE = 0.2
"""Share of drivers who accelerate by more than 2.5 m/s2."""
HEADWAY_S, HEADWAY_SPREAD, HEADWAY_RANGE_S = 0.45, 0.4, (0.3, 1.6)
"""Median of the headways that drivers want, s, the standard deviation of their logarithm, and the limits, s. Near its
desired speed, a driver of the Intelligent Driver Model keeps about twice that: close followers then keep about the
1.1 s, sd 0.42, that Al-Obaedi 2019 measured on British motorways; docs/traffic.md has both."""
DECEL_MPS2, TRUCK_DECEL_MPS2 = (2.0, 3.5), (2.0, 3.0)
"""Ranges of the decelerations with which drivers stop where nothing surprises them, m/s2. Published: 1.67 in the
Intelligent Driver Model (Treiber, Hennecke and Helbing 2000), 3.0 for stops at signals (Institute of Transportation
Engineers), 3.4 as comfortable for most drivers (AASHTO, after Fambro, Fitzpatrick and Koppa 1997). Who has to, brakes
harder, up to emergencyDecel."""
SPEED_FACTOR, SPEED_FACTOR_SD, SPEED_FACTOR_RANGE = 0.98, 0.10, (0.75, 1.25)
"""Mean, standard deviation and limits of desired speeds, over the speed limit. Observed by the Department for Transport
in 2022, in free flow on British motorways: 45 % of cars above the limit, 8 % by more than a seventh of it; a normal
distribution of these shares has 0.99 and 0.11."""
KEEP_RIGHT, SPEED_GAIN = (0.1, 0.6), (0.2, 0.8)
"""Ranges of SUMO's lcKeepRight and lcSpeedGain, whose defaults are 1. They are chosen for lane changes as often as in
published observations (docs/traffic.md)."""
CHANGE_M, CHANGE_S, CHANGE_SD_S = 3.4, 5.6, 2.1
"""Width of a lane change, m, and the mean and standard deviation of its duration, s. Observed: 6.28 and 2.0 by Lee,
Olsen and Wierwille 2004 (naturalistic driving), 4.0 and 2.3 in the NGSIM recordings."""


OUTER_LANE = 0.6
"""Cars that enter in the outermost lane, where the trucks do, over those in each other lane."""
LANE_OVERLAP = 0.25
"""How far the range of drivers who enter in a lane reaches into those of the lanes beside it, in ranges."""
FAST_MPS = 25.0
"""Where the speed limit is this or more, drivers enter in the lane that suits their desired speed, m/s."""
SHORTEST_M = 200.0
"""Shortest corridor that traffic is made along, where there are longer ones, m."""


class DemandSettings(Settings):
    """How much traffic there is, and where."""

    vehicles: int = Field(120, ge=1, le=5000, description="approximate number of vehicles on the road at once")
    truck_share: float = Field(0.1, ge=0.0, le=1.0, description="share of trucks among the vehicles")
    corridor_m: float = Field(
        5000.0, ge=500.0, le=50_000.0, description="longest corridor that traffic is made along, m"
    )
    motorway_per_lane_h: float = Field(
        900.0, gt=0.0, le=3600, description="vehicles per hour and lane where the speed limit is 25 m/s or more"
    )
    arterial_per_lane_h: float = Field(
        500.0, gt=0.0, le=3600, description="vehicles per hour and lane where it is 16 to 25 m/s"
    )
    street_per_lane_h: float = Field(
        300.0, gt=0.0, le=3600, description="vehicles per hour and lane where it is below 16 m/s"
    )
    ramp_share: float = Field(
        0.1, ge=0.0, le=1.0, description="traffic on each side road, as a share of that on the corridor"
    )

    def per_lane_h(self, speed: float) -> float:
        """Return the traffic of a road by its speed limit, m/s: vehicles per hour and lane."""
        if speed >= FAST_MPS:
            return self.motorway_per_lane_h
        return self.arterial_per_lane_h if speed >= 16.0 else self.street_per_lane_h


def drivers(rng: np.random.Generator, cars: int = 60, trucks: int = 12) -> list[str]:
    """Return the vTypeDistributions `cars` and `trucks`, as lines of XML.

    All follow the Intelligent Driver Model, the smoothest of SUMO's models at 10 ms steps in the sublane model. They
    differ in acceleration (1.4-2.5 m/s2; one in five is impatient, with up to 3.6), deceleration (2-3.5 m/s2), headway,
    desired speed, the time that a lane change takes, eagerness to gain speed, and how strictly they keep to the outer
    lanes: SUMO's lcKeepRight keeps left in a network for left-hand traffic.
    """
    draw = rng.uniform
    common = 'carFollowModel="IDM" speedDev="0" latAlignment="center" probability="1"'
    lines = ['<vTypeDistribution id="cars">']
    for k in range(cars):
        accel = draw(2.6, 3.6) if rng.random() < IMPATIENT_SHARE else draw(1.4, 2.5)
        tau = np.clip(rng.lognormal(np.log(HEADWAY_S), HEADWAY_SPREAD), *HEADWAY_RANGE_S)
        speed_factor = np.clip(rng.normal(SPEED_FACTOR, SPEED_FACTOR_SD), *SPEED_FACTOR_RANGE)
        accel_lat, speed_lat = lane_change_motion(rng)
        lines.append(
            f'  <vType id="car{k}" vClass="passenger" {common} length="{draw(4.0, 5.0):.2f}" width="1.80" '
            f'minGap="2.0" accel="{accel:.2f}" decel="{draw(*DECEL_MPS2):.2f}" emergencyDecel="9.0" '
            f'tau="{tau:.2f}" maxSpeed="50" speedFactor="{speed_factor:.3f}" '
            f'maxSpeedLat="{speed_lat:.2f}" lcAccelLat="{accel_lat:.2f}" lcKeepRight="{draw(*KEEP_RIGHT):.2f}" '
            f'lcSpeedGain="{draw(*SPEED_GAIN):.2f}" lcStrategic="2" lcAssertive="{draw(1.0, 1.5):.2f}"/>'
        )
    lines += ["</vTypeDistribution>", '<vTypeDistribution id="trucks">']
    lines += [
        f'  <vType id="truck{k}" vClass="truck" {common} length="{draw(10.0, 16.5):.2f}" width="2.50" minGap="3.0" '
        f'accel="{draw(0.8, 1.3):.2f}" decel="{draw(*TRUCK_DECEL_MPS2):.2f}" emergencyDecel="7.0" '
        f'tau="{draw(1.4, 2.0):.2f}" maxSpeed="{draw(22.2, 25.0):.2f}" speedFactor="1" maxSpeedLat="0.8" '
        'lcAccelLat="0.6" lcKeepRight="20"/>'
        for k in range(trucks)
    ]
    return [*lines, "</vTypeDistribution>"]


def lane_change_motion(rng: np.random.Generator) -> tuple[float, float]:
    """Return a driver's lateral acceleration, m/s2, and lateral speed, m/s, in a lane change.

    SUMO moves a vehicle across at the speed v, with ramps at the acceleration a: a change over w takes w / v + v / a.
    The time is drawn, and v follows from it.
    """
    acceleration = float(rng.uniform(0.6, 1.6))
    spread = np.log1p((CHANGE_SD_S / CHANGE_S) ** 2) ** 0.5
    duration = float(np.clip(rng.lognormal(np.log(CHANGE_S) - spread**2 / 2.0, spread), 2.6, 11.0))
    root = max(duration**2 - 4.0 * CHANGE_M / acceleration, 0.0) ** 0.5
    return acceleration, acceleration * (duration - root) / 2.0


def by_lane(cars: Sequence[str], lanes: int) -> list[str]:
    """Return the vTypeDistributions `cars_lane0of3` to `cars_lane2of3` (for three lanes), as lines of XML.

    cars: lines of XML with the types. Slow drivers enter in the outer lanes, fast ones in the inner lanes; the ranges
    overlap. Drivers who enter anywhere would first change lanes until they are sorted.
    """
    types = [ElementTree.fromstring(line) for line in cars if line.lstrip().startswith('<vType id="car')]
    names = [one.attrib["id"] for one in sorted(types, key=lambda one: float(one.attrib["speedFactor"]))]
    share = len(names) / lanes
    ranges = [
        names[max(0, round((lane - LANE_OVERLAP) * share)) : round((lane + 1 + LANE_OVERLAP) * share)]
        for lane in range(lanes)
    ]
    return [
        f'<vTypeDistribution id="cars_lane{lane}of{lanes}" vTypes="{" ".join(drivers)}"/>'
        for lane, drivers in enumerate(ranges)
    ]


def flow(
    name: str, kind: str, route: str, per_hour: float, depart_speed: str = "desired", lane: str | int = "best_prob"
) -> str:
    """Return a flow of vehicles with exponentially distributed headways, as a line of XML. lane: where they enter."""
    return (
        f'<flow id="{name}" type="{kind}" route="{route}" begin="0" period="exp({per_hour / 3600:.6f})" '
        f'departLane="{lane}" departSpeed="{depart_speed}" departPos="base"/>'
    )


def flows_by_lane(name: str, route: str, per_hour: float, lanes: Sequence[int]) -> list[str]:
    """Return a flow of cars for each lane that they enter in, as lines of XML. lanes: by index, the outermost first."""
    shares = [OUTER_LANE, *[1.0] * (len(lanes) - 1)]
    return [
        flow(f"{name}_{k}", f"cars_lane{k}of{len(lanes)}", route, per_hour * share / sum(shares), lane=lane)
        for k, (lane, share) in enumerate(zip(lanes, shares, strict=True))
    ]


def make_demand(network: Path, settings: DemandSettings, seed: int) -> str:
    """Return the text of a route file for a network. Equal arguments give equal text.

    Raises InputError where the network cannot be read or has no road for cars.
    """
    try:
        with cleaned(network) as readable:
            net = sumolib.net.readNet(str(readable))
    except InputError:
        raise
    except Exception as error:  # the reader raises whatever its parser meets
        raise InputError(f"{network} cannot be read as a SUMO network ({one_line(error)}): fix the file") from None
    rng = stream("demand", seed)
    edges = [edge for edge in net.getEdges() if edge.allows("passenger")]
    if not edges:
        raise InputError(f"{network} has no road for cars: give another network")
    edges.sort(key=lambda e: (-e.getLaneNumber() * e.getSpeed(), -e.getLength(), rng.random()))
    corridors, covered = [], set[str]()
    for core in edges:
        if core.getID() not in covered:
            corridors.append(_corridor(core, settings.corridor_m, covered))
            covered |= {edge.getID() for edge in corridors[-1]}
    # Where all corridors are short, the longest one has to do.
    lengths = [sum(edge.getLength() for edge in corridor) for corridor in corridors]
    enough = min(SHORTEST_M, max(lengths))
    types, lines, by_lane_of = drivers(rng), list[str](), set[int]()
    expected, number = 0.0, 0
    for corridor, length in zip(corridors, lengths, strict=True):
        if expected >= settings.vehicles:
            break
        if length < enough:
            continue
        speed = sum(edge.getSpeed() * edge.getLength() for edge in corridor) / length
        volume = settings.per_lane_h(speed) * min(edge.getLaneNumber() for edge in corridor)
        for name, route, per_hour in _routes(corridor, volume, settings.ramp_share):
            lanes = _entered(route)
            lines += _flows(f"c{number}{name}", route, per_hour, settings.truck_share, lanes)
            by_lane_of |= {len(lanes)} - {0}
        expected += volume / 3600.0 * length / speed
        number += 1
    types += [line for count in sorted(by_lane_of) for line in by_lane(types, count)]
    return "<routes>\n  " + "\n  ".join([*types, *lines]) + "\n</routes>\n"


def _corridor(core: Any, longest_m: float, covered: set[str]) -> list[Any]:
    """Edges in driving order through a core edge, extended at both ends along the largest road."""
    corridor = [core]
    length = core.getLength()
    for forward in (True, False):
        reach = length + (longest_m - length) / (2.0 if forward else 1.0)
        while length < reach:
            end = corridor[-1] if forward else corridor[0]
            nexts = end.getOutgoing() if forward else end.getIncoming()
            taken = covered | {edge.getID() for edge in corridor}
            choices = [e for e in nexts if e.allows("passenger") and e.getID() not in taken and not _turns_back(end, e)]
            if not choices:
                break
            best = max(choices, key=lambda e: (min(e.getLaneNumber(), end.getLaneNumber()), e.getSpeed(), e.getID()))
            corridor = [*corridor, best] if forward else [best, *corridor]
            length += best.getLength()
    return corridor


def _turns_back(a: Any, b: Any) -> bool:
    return bool(a.getFromNode() is b.getToNode() and a.getToNode() is b.getFromNode())


def _routes(corridor: list[Any], volume: float, ramp_share: float) -> list[tuple[str, list[Any], float]]:
    """Name, edges and vehicles per hour of each route of a corridor: through, and from and to every side road."""
    inside = {edge.getID() for edge in corridor}
    routes = [("through", corridor, volume)]
    for k, edge in enumerate(corridor[1:], 1):
        for side in edge.getIncoming():
            if side.getID() not in inside and side.allows("passenger") and not _turns_back(side, edge):
                routes.append((f"in{k}_{len(routes)}", [side, *corridor[k:]], ramp_share * volume))
    for k, edge in enumerate(corridor[:-1], 1):
        for side in edge.getOutgoing():
            if side.getID() not in inside and side.allows("passenger") and not _turns_back(edge, side):
                routes.append((f"out{k}_{len(routes)}", [*corridor[:k], side], ramp_share * volume))
    return routes


def _entered(route: list[Any]) -> list[int]:
    """Return the lanes that drivers choose by their desired speed where a route begins; none where they do not."""
    first = route[0]
    lanes = [lane for lane in first.getLanes() if lane.allows("passenger")]
    if len(route) > 1:
        lanes = [lane for lane in lanes if any(way.getTo() is route[1] for way in lane.getOutgoing())]
    return [lane.getIndex() for lane in lanes] if first.getSpeed() >= FAST_MPS and len(lanes) > 1 else []


def _flows(name: str, route: list[Any], per_hour: float, truck_share: float, lanes: Sequence[int]) -> list[str]:
    """A route with its flow of cars and, where trucks may drive all of it, of trucks; lines of XML.

    lanes: those that drivers choose by their desired speed; none, where they do not.
    """
    trucks = truck_share if all(edge.allows("truck") for edge in route) else 0.0
    lines = [f'<route id="{name}" edges="{" ".join(edge.getID() for edge in route)}"/>']
    if trucks < 1.0 and lanes:
        lines += flows_by_lane(f"{name}_cars", name, (1.0 - trucks) * per_hour, lanes)
    elif trucks < 1.0:
        lines.append(flow(f"{name}_cars", "cars", name, (1.0 - trucks) * per_hour))
    if trucks > 0.0:
        lines.append(flow(f"{name}_trucks", "trucks", name, trucks * per_hour))
    return lines
