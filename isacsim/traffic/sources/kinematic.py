"""The kinematic motion source: scenes of one TV and one UV on a straight road, with parameters drawn from ranges.

This is the "parameterized kinematic model" by which ASI-BIP's authors generate their data (section IV-A); they give no
ranges, so those of `kinematic_settings` are this project's. SUMO plays no part but that its network
describes the road. A recording holds many scenes, one after the other, each with vehicles of its own.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError
from isac_cosim.base.seeding import stream
from isac_cosim.isacsim.scenarios import scenario
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.recordings.recording import GeneratedManeuver, LabelledRecording, Track
from isac_cosim.isacsim.traffic.sources.kinematic_scenes import (
    LANE_CHANGE_AFTER_S,
    PLANS,
    STEADY_LEAD_S,
    STEP_S,
    Motion,
    Scene,
    SceneDraw,
)
from isac_cosim.isacsim.traffic.sources.kinematic_settings import OVERLAP, KinematicSettings
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource
from isac_cosim.isacsim.traffic.sources.simulated import digest_of, inputs_of

SCENARIO = "straight_road"
"""The bundled scenario that is made for this source."""
LEAST_LANES = 4
"""The TV starts in neither outermost lane, so that every lane allows every maneuver."""
STRAIGHT_M = 0.05
"""A lane is straight where its centre line deviates by no more than this, m."""
SCENE_CPU_S = 0.003
"""Processor time of a scene, s: an episode of 104 scenes on one thread took 0.2 to 0.3 s."""
CAR_WIDTH_M = 1.8


@dataclass(frozen=True)
class StraightRoad:
    """A straight one-way road.

    start: of the centre line of the outermost lane, m, (2,). heading: unit vector, (2,). lanes: their numbers in
    `Scenario.lanes`, from the right. middle_m: distance along the road of the point nearest to the middle of the sites.
    """

    start: Array
    heading: Array
    lanes: tuple[int, ...]
    width_m: float
    length_m: float
    middle_m: float

    def points(self, along: Array, left: Array) -> Array:
        """Return points in the plane, (2, n), m. left: from the centre line of the outermost lane, m, (n,)."""
        leftward = np.array([-self.heading[1], self.heading[0]])
        return np.asarray(self.start[:, None] + np.outer(self.heading, along) + np.outer(leftward, left))


@dataclass(frozen=True)
class KinematicSource(MotionSource):
    """Motion from the parameterised kinematic model, with the label of every target vehicle."""

    kinematics: KinematicSettings
    sections: ClassVar = {"kinematics": KinematicSettings}
    worlds: ClassVar = {"kinematic-2": {}, "overlap-1": {"kinematics": OVERLAP}}
    own_scenarios = (SCENARIO,)

    def load(self, where: str) -> Scenario:
        """Return a scenario with a straight road. Raises InputError where it has none."""
        loaded = scenario.load(where)
        straight_road_of(loaded)
        return loaded

    def inputs(self, scenario: Scenario) -> Mapping[str, str]:
        return inputs_of(scenario)

    def digest(self, scenario: Scenario) -> str:
        return digest_of(scenario)

    def record(self, scenario: Scenario, seed: int) -> LabelledRecording:
        """Return the scenes of one seed, one after the other."""
        road = straight_road_of(scenario)
        known = [name for name in PLANS if name != "following"]
        order = known * self.kinematics.per_class + ["following"] * self.kinematics.following_scenes
        lead_s = max(self.kinematics.lead_s, STEADY_LEAD_S)
        slot_s = lead_s + max(LANE_CHANGE_AFTER_S, self.kinematics.settle_s + 6.0)
        tracks: dict[str, Track] = {}
        maneuvers: list[GeneratedManeuver] = []
        for k, intention in enumerate(order):
            scene, lane, middle_m = self._scene(scenario, road, seed, k, intention)
            onset = k * slot_s + lead_s
            first_step = round((onset + scene.times[0]) / STEP_S)
            for name, motion in (("tv", scene.tv), ("uv", scene.uv)):
                tracks[f"{name}{k}"] = _track(f"{name}{k}", motion, road, lane, middle_m, first_step)
            onset, commit, end = (round(onset + time, 6) for time in (0.0, scene.commit, scene.end))
            maneuvers.append(GeneratedManeuver(intention, f"tv{k}", f"uv{k}", onset, commit, end, scene.cause))
        return LabelledRecording(scenario.name, seed, STEP_S, scenario.lanes, tracks, maneuvers=tuple(maneuvers))

    def expected_cpu_s(self) -> float:
        return self.expected_samples() * SCENE_CPU_S

    def expected_samples(self) -> float:
        return (len(PLANS) - 1) * self.kinematics.per_class + self.kinematics.following_scenes

    def _scene(
        self, scenario: Scenario, road: StraightRoad, seed: int, k: int, intention: str
    ) -> tuple[Scene, int, float]:
        """Draw a scene until it keeps the limits; return it, the lane it starts in, and where on the road, m."""
        spread_m = self.kinematics.situation.position_spread_m
        for attempt in range(self.kinematics.limits.draws):
            rng = stream("kinematic", scenario.name, seed, intention, k, attempt)
            lane = int(rng.integers(1, len(road.lanes) - 1))
            middle_m = road.middle_m + float(rng.uniform(-spread_m, spread_m))
            scene = SceneDraw(intention, self.kinematics, road.width_m, rng).scene()
            if scene is not None and _fits(scene, road, middle_m):
                return scene, lane, middle_m
        draws = self.kinematics.limits.draws
        raise InputError(
            f"dataset.kinematics: none of {draws} drawn scenes of {intention} keeps the limits on "
            f"the road of {scenario.name}: widen the ranges, or use a longer road"
        )


def straight_road_of(scenario: Scenario) -> StraightRoad:
    """Return the longest straight road of a scenario that has enough lanes. Raises InputError where there is none."""
    by_edge: dict[str, list[int]] = defaultdict(list)
    for number, lane in enumerate(scenario.lanes):
        by_edge[lane.edge].append(number)
    roads = [sorted(numbers, key=lambda number: scenario.lanes[number].index) for numbers in by_edge.values()]
    suitable = [
        numbers
        for numbers in roads
        if len(numbers) >= LEAST_LANES and all(_is_straight(scenario.lanes[number]) for number in numbers)
    ]
    if not suitable or scenario.lefthand:
        raise InputError(
            f"{scenario.network}: the kinematic source needs a straight road with at least {LEAST_LANES} lanes in one "
            f"direction, and traffic that keeps right: use the bundled scenario {SCENARIO}"
        )
    numbers = max(suitable, key=lambda numbers: scenario.lanes[numbers[0]].length_m)
    outermost = scenario.lanes[numbers[0]]
    heading = (outermost.shape[-1] - outermost.shape[0]) / np.hypot(*(outermost.shape[-1] - outermost.shape[0]))
    middle = np.mean([(site.x, site.y) for site in scenario.sites], axis=0)
    return StraightRoad(
        start=outermost.shape[0],
        heading=heading,
        lanes=tuple(numbers),
        width_m=outermost.width_m,
        length_m=outermost.length_m,
        middle_m=float((middle - outermost.shape[0]) @ heading),
    )


def _is_straight(lane: Lane) -> bool:
    step = lane.shape[-1] - lane.shape[0]
    from_start = lane.shape - lane.shape[0]
    aside = step[0] * from_start[:, 1] - step[1] * from_start[:, 0]
    return bool(np.abs(aside).max() <= STRAIGHT_M * max(float(np.hypot(*step)), 1e-9))


def _fits(scene: Scene, road: StraightRoad, middle_m: float) -> bool:
    """Return whether both vehicles stay on the road. middle_m: where the TV is at onset, m along the road."""
    along = np.concatenate([scene.tv.along, scene.uv.along]) + middle_m
    return bool(along.min() > scene.tv.length_m and along.max() < road.length_m)


def _track(vehicle: str, motion: Motion, road: StraightRoad, lane: int, middle_m: float, first_step: int) -> Track:
    """Return the track of one vehicle that starts in a lane of the road, numbered from the right."""
    left = motion.left + lane * road.width_m
    along = motion.along + middle_m
    lanes = np.floor(left / road.width_m + 0.5).astype(np.int32)
    x, y = road.points(along, left)
    return Track(
        vehicle=vehicle,
        kind="passenger",
        length_m=motion.length_m,
        width_m=CAR_WIDTH_M,
        first_step=first_step,
        x=x,
        y=y,
        speed=motion.speed,
        lane=np.array(road.lanes, np.int32)[lanes],
        lane_pos=along,
        lane_lat=left - lanes * road.width_m,
    )
