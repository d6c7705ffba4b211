"""A recording: the 100 Hz states of all vehicles of one scenario and seed, as SUMO reported them.

The states are raw and must not be differentiated. `isacsim.traffic.motion` conditions them first.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import nan
from typing import Any

import numpy as np
import numpy.typing as npt

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.recordings.traffic_facts import TrafficFacts


@dataclass(frozen=True)
class Track:
    """The states of one vehicle. Row k is at time (first_step + k) * step_s of the recording.

    vehicle: SUMO id. kind: SUMO vehicle class ("passenger", "truck", ...).
    x, y: front bumper centre in the scenario's plane, m, shape (n,) as all that follow. speed: along the lane, m/s.
    lane: index of the lane in `Recording.lanes`. lane_pos: position of the front bumper along that lane, m.
    lane_lat: offset of the vehicle from the lane's centre line, positive to the left in the plane, m.
    onward: the edges outside of junctions that the vehicle had still to drive when the recording ended, in order, the
    latest one that it drove or earlier ones possibly among them; none for one that arrived before. None if not known.
    departed: when the demand lets the vehicle depart, s of simulation time; NaN if not known.
    bystander: the vehicle is there for others, as their leader or in their way, but is neither target nor connected:
    another recording has it, too.
    """

    vehicle: str
    kind: str
    length_m: float
    width_m: float
    first_step: int
    x: Array
    y: Array
    speed: Array
    lane: npt.NDArray[np.integer[Any]]
    lane_pos: Array
    lane_lat: Array
    onward: tuple[str, ...] | None = None
    departed: float = nan
    bystander: bool = False

    def __len__(self) -> int:
        return len(self.x)


@dataclass(frozen=True)
class Command:
    """A vehicle was under command from start to end, s. For provenance only: labels never depend on it.

    cause: what in the traffic the driver reacted to; empty for a command without a cause. ttc_s: time to collision when
    the driver began to move, s; None where there is nothing to collide with.
    """

    vehicle: str
    maneuver: str
    start: float
    end: float
    cause: str = ""
    ttc_s: float | None = None


@dataclass(frozen=True)
class Incidents:
    """Ids of vehicles that collided or teleported, which are left out of every sample."""

    collided: tuple[str, ...] = ()
    teleported: tuple[str, ...] = ()


@dataclass(frozen=True)
class Recording:
    """The states of all vehicles of one scenario and seed. Vehicles in `incidents` have no track.

    tracks: by vehicle. facts: what became of the demand in the simulation; None where the motion is not SUMO's.
    lefthand: whether traffic keeps left (see `Scenario`); it does not change what left means in a track.
    parked: for each vehicle that stood beside the road, its stays there: first step, and step after the last. Its track
    goes on meanwhile, but it is in no lane and nobody's leader.
    """

    scenario: str
    seed: int
    step_s: float
    lanes: tuple[Lane, ...]
    tracks: dict[str, Track]
    commands: tuple[Command, ...] = ()
    incidents: Incidents = field(default_factory=Incidents)
    facts: TrafficFacts | None = None
    lefthand: bool = False
    parked: dict[str, tuple[tuple[int, int], ...]] = field(default_factory=dict)

    @cached_property
    def lane_number(self) -> dict[str, int]:
        """Index of each lane in `lanes`, by its id."""
        return {lane.id: k for k, lane in enumerate(self.lanes)}

    @cached_property
    def commands_to(self) -> dict[str, list[Command]]:
        """The commands to each vehicle that had any, in the order of `commands`."""
        by_vehicle: dict[str, list[Command]] = {}
        for command in self.commands:
            by_vehicle.setdefault(command.vehicle, []).append(command)
        return by_vehicle

    @property
    def lasts_s(self) -> float:
        """Time that was simulated, or from the first state of any vehicle to a step after the last one, s."""
        if self.facts is not None:
            return round(self.facts.to_s - self.facts.from_s, 6)
        ends = [(track.first_step, track.first_step + len(track)) for track in self.tracks.values()]
        return round((max(end for _, end in ends) - min(start for start, _ in ends)) * self.step_s, 6) if ends else 0.0

    def is_parked(self, vehicle: str, first_step: int, last_step: int) -> bool:
        """Return whether a vehicle stands beside the road at any of the steps from the first to the last."""
        stays = self.parked.get(vehicle)
        return stays is not None and any(start <= last_step and first_step < after for start, after in stays)

    def times(self, track: Track) -> Array:
        """Return the simulation time of each row of a track, s, shape (n,)."""
        return np.asarray((track.first_step + np.arange(len(track))) * self.step_s)


COLUMNS = ("x", "y", "speed", "lane", "lane_pos", "lane_lat")
"""The columns of a track."""


@dataclass(frozen=True)
class GeneratedManeuver:
    """One maneuver that a motion source generated, with the pair of vehicles that it is about.

    intention: its name in datasets, such as `hard_brake`. tv, uv: ids of the target vehicle, which does it, and of the
    own vehicle. onset, commit, end: first motion, decision and end of the maneuver, s of simulation time, as in
    `labeling.intentions.Event`. cause: what the target vehicle reacts to; empty if it acts on its own accord.
    """

    intention: str
    tv: str
    uv: str
    onset: float
    commit: float
    end: float
    cause: str = ""


@dataclass(frozen=True)
class LabelledRecording(Recording):
    """A recording with the maneuvers that its source generated.

    Each maneuver becomes one sample with the generated label. The detectors run as well, to be compared with these
    labels (`labeling.samples.generated_labels`).
    """

    maneuvers: tuple[GeneratedManeuver, ...] = ()
