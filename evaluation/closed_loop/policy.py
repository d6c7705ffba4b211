"""The advisory policy: who is told what on an alarm.

A maneuver endangers those who drive where it leads. On an alarm about a TV the network instructs connected vehicles
near its path:

    hard_brake                      the vehicle behind slows
    left_lane_change, overtake      the vehicle alongside or behind in the lane to the left opens the gap; the vehicle
                                    behind holds its lane
    right_lane_change               the vehicle alongside or behind in the lane to the right opens the gap
    evasive_swerve                  the vehicle behind slows, those alongside or behind on both sides open the gap
    hard_accel                      the vehicle ahead holds its lane

Where traffic keeps left, left and right change places.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from isac_cosim.evaluation.in_traffic.alarms.stream import Alarm
from isac_cosim.labeling.road.lane_graph import LaneGraph
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.samples.uv_choice import PairSettings, connected

Instruction = Literal["open_gap", "slow", "hold_lane"]
INSTRUCTIONS: tuple[Instruction, ...] = ("open_gap", "slow", "hold_lane")
Place = Literal["behind", "ahead", "left", "right"]
"""Where a vehicle is, seen from the TV; left and right are alongside or behind in the next lane."""
POLICY: dict[str, tuple[tuple[Place, Instruction], ...]] = {
    "hard_brake": (("behind", "slow"),),
    "left_lane_change": (("left", "open_gap"), ("behind", "hold_lane")),
    "overtake": (("left", "open_gap"), ("behind", "hold_lane")),
    "right_lane_change": (("right", "open_gap"),),
    "evasive_swerve": (("behind", "slow"), ("left", "open_gap"), ("right", "open_gap")),
    "hard_accel": (("ahead", "hold_lane"),),
}
"""Where traffic keeps right."""
MIRRORED: dict[str, str] = {"left_lane_change": "right_lane_change", "right_lane_change": "left_lane_change"}
MIRRORED_PLACES: dict[Place, Place] = {"left": "right", "right": "left"}


@dataclass(frozen=True)
class Advisory:
    """An instruction to a vehicle. time_s: when the network sends it, s of simulation time."""

    vehicle: str
    instruction: Instruction
    time_s: float
    alarm: Alarm | None = None


def advisories(
    alarm: Alarm, surroundings: Surroundings, pairs: PairSettings, range_m: float, time_s: float
) -> list[Advisory]:
    """Return what is sent on an alarm. surroundings: at the time of the alarm. time_s: when it is sent, s."""
    recording = surroundings.recording
    sent = []
    for place, instruction in instructions(alarm.intention, recording.lefthand):
        vehicle = vehicle_at(surroundings, alarm.tv, place, alarm.time_s, range_m)
        if vehicle is not None and connected(recording, recording.tracks[vehicle], pairs):
            sent.append(Advisory(vehicle, instruction, time_s, alarm))
    return sent


def instructions(intention: str, lefthand: bool) -> list[tuple[Place, Instruction]]:
    """Return the places that an alarm concerns, with an instruction for each. lefthand: whether traffic keeps left."""
    if not lefthand:
        return list(POLICY[intention])
    mirrored = POLICY[MIRRORED.get(intention, intention)]
    return [(MIRRORED_PLACES.get(place, place), instruction) for place, instruction in mirrored]


def vehicle_at(surroundings: Surroundings, tv: str, place: Place, time_s: float, range_m: float) -> str | None:
    """Return the nearest vehicle at a place around a TV, or None. range_m: farthest gap, m."""
    if not surroundings.has(tv, time_s, time_s):
        return None
    if place == "ahead":
        leader = surroundings.leader(tv, time_s, range_m)
        return leader.vehicle if leader else None
    if place == "behind":
        gaps = {}
        for track in surroundings.present(time_s):
            leader = surroundings.leader(track.vehicle, time_s, range_m)
            if leader is not None and leader.vehicle == tv:
                gaps[track.vehicle] = leader.gap_m
        return min(gaps, key=lambda name: (gaps[name], name), default=None)
    return _beside(surroundings, tv, 1 if place == "left" else -1, time_s, range_m)


def _beside(surroundings: Surroundings, tv: str, leftward: int, time_s: float, range_m: float) -> str | None:
    """Return the first vehicle alongside or behind in the lane to the left (1) or right (-1), or that leads into it.

    Lanes that lead into the TV's own lane as well are not searched: who drives there is behind the TV.
    """
    recording, graph = surroundings.recording, surroundings.graph
    track, step = recording.tracks[tv], surroundings.step(time_s)
    lane, place = int(track.lane[step - track.first_step]), float(track.lane_pos[step - track.first_step])
    beside = [k for k in graph.on_edge[graph.lanes[lane].edge] if graph.levels(lane, k) == leftward]
    own = _upstream(graph, [lane], place, range_m)
    starts = {k: start for k, start in _upstream(graph, beside, place, range_m).items() if k not in own}
    behind = {}
    for other in surroundings.present(time_s):
        row = step - other.first_step
        start = starts.get(int(other.lane[row]))
        if start is not None and -track.length_m < start - float(other.lane_pos[row]) <= range_m:
            behind[other.vehicle] = start - float(other.lane_pos[row])
    return min(behind, key=lambda name: (behind[name], name), default=None)


def _upstream(graph: LaneGraph, lanes: Iterable[int], place_m: float, range_m: float) -> dict[int, float]:
    """Return some lanes and those that lead into them, each with the way from its start to a place in the former, m.

    place_m: along the former, m. range_m: lanes that end farther from the place are left out, m.
    """
    starts = dict.fromkeys(lanes, place_m)
    open_ = list(starts)
    while open_:
        k = open_.pop()
        for before in graph.predecessors[k]:
            start_m = starts[k] + graph.lanes[before].length_m
            if starts[k] < range_m and start_m < starts.get(before, float("inf")):
                starts[before] = start_m
                open_.append(before)
    return starts
