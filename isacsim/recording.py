"""A recording: the 100 Hz states of all vehicles of one scenario and seed, as SUMO reported them.

States are raw. Nothing downstream may differentiate them: `isacsim.motion` conditions them first.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Lane:
    """One lane of the network, junction-internal ones included.

    index: 0 is the rightmost lane of its edge. shape: centre line, (n, 2), m, in the scenario's plane.
    successors: ids of the lanes that continue this one (through junctions: the internal lane first).
    """

    id: str
    edge: str
    index: int
    width_m: float
    length_m: float
    shape: Array
    successors: tuple[str, ...]


@dataclass(frozen=True)
class Track:
    """The states of one vehicle; row k is at time (first_step + k) * step_s of the recording.

    x, y: front bumper centre in the scenario's plane, m, shape (n,). speed: along the lane, m/s.
    lane: position of the lane in `Recording.lanes`. lane_pos: of the front bumper along that lane, m.
    lane_lat: offset of the vehicle from the lane's centre line, left positive, m.
    kind: SUMO vehicle class ("passenger", "truck", ...).
    """

    vehicle: str
    kind: str
    length_m: float
    width_m: float
    first_step: int
    x: Array
    y: Array
    speed: Array
    lane: npt.NDArray[np.int32]
    lane_pos: Array
    lane_lat: Array

    def __len__(self) -> int:
        return len(self.x)


@dataclass(frozen=True)
class Command:
    """That a vehicle was under command from start to end, s. Provenance only: labels never depend on it."""

    vehicle: str
    maneuver: str
    start: float
    end: float


@dataclass(frozen=True)
class Incidents:
    """What SUMO reported that keeps a vehicle out of every sample: ids of vehicles that collided or teleported."""

    collided: tuple[str, ...] = ()
    teleported: tuple[str, ...] = ()


@dataclass(frozen=True)
class Recording:
    """All vehicles' states of one scenario and seed. Vehicles in `incidents` have no track."""

    scenario: str
    seed: int
    step_s: float
    lanes: tuple[Lane, ...]
    tracks: dict[str, Track]
    commands: tuple[Command, ...] = ()
    incidents: Incidents = field(default_factory=Incidents)

    @cached_property
    def lane_number(self) -> dict[str, int]:
        """Position of each lane id in `lanes`."""
        return {lane.id: k for k, lane in enumerate(self.lanes)}

    def times(self, track: Track) -> Array:
        """Simulation time of each row of a track, s, shape (n,)."""
        return np.asarray((track.first_step + np.arange(len(track))) * self.step_s)
