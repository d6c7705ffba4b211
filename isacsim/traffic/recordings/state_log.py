"""The states of a simulation, stored so that memory does not grow with simulated time.

SUMO writes the states of all vehicles, in full double precision, to a temporary Parquet file, which takes slightly less
time than getting them from libsumo. After the simulation, the file is read in batches. Rows of vehicles that have left
the road go to a second temporary file; rows of the others wait in memory for the rest. Tracks are views into the second
file.

Both files lose their names once they are open, so nothing is left behind however the process ends. That needs a
system on which an open file can be removed: Linux or macOS, not Windows.
"""

from __future__ import annotations

import tempfile
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from isac_cosim.base import landlock
from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError
from isac_cosim.base.temporary import temporary_error, writing_temporary
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.recordings.recording import Track

Numbers = npt.NDArray[np.integer[Any]]

COLUMNS = {
    "x": "vehicle_x",
    "y": "vehicle_y",
    "speed": "vehicle_speed",
    "lane_pos": "vehicle_pos",
    "lane_lat": "vehicle_posLat",
}
"""SUMO's name of each numeric column of a track. A block has these rows in this order, then the lane's index."""
ROWS = len(COLUMNS) + 1
LATERAL = list(COLUMNS).index("lane_lat")
TIME, VEHICLE, LANE = "timestep_time", "vehicle_id", "vehicle_lane"
BATCH_ROWS = 100_000


class StateLog(ABC):
    """What is kept of one simulation: the states of every vehicle, its incidents, and its stays beside the road.

    first: the step whose outcome is the first to be recorded. parking: vehicles that began to stand beside the road in
    the latest step. collided, teleported: those to which that has happened.
    """

    def __init__(self, scenario: Scenario, step_s: float, first: int) -> None:
        self._scenario = scenario
        self._step_s = step_s
        self._first = first
        self._facts: dict[str, tuple[str, float, float, float]] = {}
        self._parked: dict[str, list[tuple[int, int | None]]] = {}
        # Of the latest step: who departed, began to teleport, began to park, and is about to return to the road.
        self._departed: Sequence[str] = ()
        self._teleporting: Sequence[str] = ()
        self.parking: Sequence[str] = ()
        self._returning: Sequence[str] = ()
        self.collided: set[str] = set()
        self.teleported: set[str] = set()

    @abstractmethod
    def options(self, folder: Path) -> dict[str, str]:
        """Return the options to start SUMO with. folder: for files that exist while SUMO starts."""

    @abstractmethod
    def attach(self) -> None:
        """Prepare to record. Call once SUMO has started."""

    @abstractmethod
    def blocks(self) -> Iterator[tuple[str, int, Array]]:
        """Yield name, first step and states (6, n) of each vehicle that has any, in order of first appearance.

        The rows are those of `COLUMNS`, and the lane's index as an integer of the same bits. Call after SUMO has ended.
        """

    @property
    def departed(self) -> Mapping[str, str]:
        """The SUMO vehicle class of each vehicle that has departed."""
        return {name: kind for name, (kind, *_) in self._facts.items()}

    def finish(self, sumo: Any) -> None:  # noqa: B027 - most logs have nothing left to do
        """Take what is missing of the last step. Call after it, while SUMO is still running."""

    @abstractmethod
    def close(self) -> None:
        """Close the files. Tracks that have been returned stay valid, and no others can be had any more."""

    def step(self, sumo: Any, commanded: Collection[str] = ()) -> None:
        """Note which vehicles departed, parked, collided or teleported in this step.

        sumo: the running libsumo module. commanded: the vehicles that may be moved by commands in the next step.
        """
        # libsumo itself, because the Python around it takes as long again.
        direct, vehicle = sumo._libsumo, sumo.vehicle
        self._departed = direct.simulation_getDepartedIDList()
        for name in self._departed:
            size = vehicle.getLength(name), vehicle.getWidth(name)
            # When it was due: it may have waited for room.
            due = vehicle.getDeparture(name) - vehicle.getDepartDelay(name)
            self._facts[name] = (vehicle.getVehicleClass(name), *size, round(due, 3))
        for collision in direct.simulation_getCollisions():
            self.collided |= {collision.collider, collision.victim}
        self.parking = direct.simulation_getParkingStartingVehiclesIDList()
        self._returning = direct.simulation_getParkingEndingVehiclesIDList()
        if self.parking or self._returning:
            self._note_parking(sumo)
        self._teleporting = direct.simulation_getStartingTeleportIDList()
        self.teleported.update(self._teleporting)

    def _note_parking(self, sumo: Any) -> None:
        step = round(sumo.simulation.getTime() / self._step_s)
        for name in self.parking:
            self._parked.setdefault(name, []).append((step, None))
        for name in self._returning:  # SUMO reports it in the last step in which the vehicle is still beside the road
            if name in self._parked:
                self._parked[name][-1] = (self._parked[name][-1][0], step + 1)

    def parked(self, tracks: Mapping[str, Track]) -> dict[str, tuple[tuple[int, int], ...]]:
        """Return the stays beside the road of the vehicles that have one within their track, as in `Recording`."""
        stays = {}
        for name, track in tracks.items():
            end = track.first_step + len(track)
            spans = [(first, end if after is None else after) for first, after in self._parked.get(name, ())]
            stays[name] = tuple((a, min(b, end)) for a, b in spans if a < end and b > track.first_step)
        return {name: spans for name, spans in stays.items() if spans}

    def tracks(self) -> dict[str, Track]:
        """Return tracks by vehicle, in order of first appearance, without vehicles that had an incident.

        Call once, after SUMO has ended. The files are closed.
        """
        tracks = {}
        with closing(self):
            for name, first_step, block in self.blocks():
                if name in self.collided or name in self.teleported:
                    continue
                kind, length, width, departed = self._facts[name]
                tracks[name] = Track(
                    vehicle=name,
                    kind=kind,
                    length_m=length,
                    width_m=width,
                    first_step=first_step,
                    onward=None,
                    departed=departed,
                    bystander=False,
                    lane=np.asarray(block[-1].view(np.int64)),
                    **{column: np.asarray(values) for column, values in zip(COLUMNS, block[:-1], strict=True)},
                )
        return tracks


class EveryStepLog(StateLog):
    """Takes the state of every vehicle at every step from the file that SUMO writes."""

    def __init__(self, scenario: Scenario, step_s: float, first: int) -> None:
        super().__init__(scenario, step_s, first)
        self._path = Path()
        self._states: IO[bytes] | None = None

    def options(self, folder: Path) -> dict[str, str]:
        """Return the options to start SUMO with. Its file is in the given folder until `attach` is called."""
        self._path = folder / "states.parquet"
        return {
            "fcd-output": str(self._path),
            "fcd-output.attributes": "x,y,speed,lane,pos,posLat",
            "fcd-output.skip-empty": "true",
            "device.fcd.begin": f"{self._first * self._step_s:.3f}",
            "device.fcd.probability": "1",
            "person-device.fcd.probability": "0",
            # With SUMO's default of 2 digits, most columns have single precision; with 16, all have double.
            "precision": "16",
        }

    def attach(self) -> None:
        """Open SUMO's file and remove its name. Call once SUMO has started."""
        self._states = self._path.open("rb")
        self._path.unlink()

    def close(self) -> None:
        """Close SUMO's file."""
        if self._states is not None:
            self._states.close()

    def step(self, sumo: Any, commanded: Collection[str] = ()) -> None:
        """Note what happened, as every log does. Raises InputError for a vehicle that SUMO does not write."""
        super().step(sumo, commanded)
        for name in self._departed:
            if sumo.vehicle.getParameter(name, "has.fcd.device") != "true":
                raise InputError(
                    f"{self._scenario.name}: vehicle {name} has the parameter has.fcd.device = false, so it cannot be "
                    "recorded: remove the parameter"
                )

    def blocks(self) -> Iterator[tuple[str, int, Array]]:
        """Yield the states of each vehicle; only when SUMO has ended is its file complete."""
        with closing(RowSorter()) as sorter:
            for rows in self._batches():
                sorter.add(*rows)
            yield from sorter.blocks()

    def _batches(self) -> Iterator[tuple[list[str], Numbers, Numbers, Array]]:
        """The arguments of `RowSorter.add`, for one batch of the file's rows after the other."""
        assert self._states is not None, "the log was never attached"
        lane_number = {lane.id: k for k, lane in enumerate(self._scenario.lanes)}
        try:
            names = pq.read_schema(self._states).names
        except pa.ArrowInvalid:  # SUMO does not say that it could not write
            raise temporary_error("SUMO could not finish its file of states") from None
        if VEHICLE not in names:  # no vehicle was ever on the road
            return
        file = pq.ParquetFile(self._states, read_dictionary=[VEHICLE, LANE])
        wanted = [TIME, VEHICLE, LANE, *COLUMNS.values()]
        for batch in file.iter_batches(BATCH_ROWS, columns=wanted, use_threads=False):
            lanes, vehicles = batch.column(LANE), batch.column(VEHICLE)
            numbers = np.array([lane_number[lane] for lane in lanes.dictionary.to_pylist()], np.int64)
            rows = [_values(batch.column(name)) for name in COLUMNS.values()]
            block = np.stack([*rows, numbers[_values(lanes.indices)].view(np.float64)])
            block[:2] -= np.reshape(self._scenario.origin, (2, 1))
            if self._scenario.lefthand:  # SUMO's lateral positions are positive towards the inner lanes
                block[LATERAL] *= -1.0
            # SUMO gives the outcome of a step the time at which the step began.
            steps = np.rint(_values(batch.column(TIME)) / self._step_s).astype(np.int64) + 1
            yield vehicles.dictionary.to_pylist(), _values(vehicles.indices), steps, block


def _values(column: Any) -> npt.NDArray[Any]:
    """The numbers of a column. Its own `to_numpy` takes a quarter of a second to import pandas."""
    return np.asarray(np.from_dlpack(column))


@dataclass
class _Vehicle:
    """The rows of one vehicle: waiting in memory, or at a place in the file (index of the first value, rows)."""

    first_step: int
    last_step: int = 0
    waiting: list[Array] = field(default_factory=list)
    place: tuple[int, int] = (0, 0)


class BlockFile:
    """A temporary file of blocks of states, which come back as views into it."""

    def __init__(self) -> None:
        with writing_temporary():
            self._file = tempfile.TemporaryFile(prefix="cosim-", dir=landlock.folder())  # noqa: SIM115 - closed by `close`
        self._written = 0

    def close(self) -> None:
        """Close the file. Views into it stay valid, and keep its content until the last one is gone."""
        self._file.close()

    def write(self, block: Array) -> tuple[int, int]:
        """Append a block, shape (6, n). Returns its place: the index of its first value, and n."""
        place = self._written, block.shape[1]
        with writing_temporary():
            self._file.write(np.ascontiguousarray(block).data)
        self._written += block.size
        return place

    def views(self, places: Iterable[tuple[int, int]]) -> Iterator[Array]:
        """Yield the blocks of some places, shape (6, n). Call once everything is written."""
        with writing_temporary():
            self._file.flush()
        values = np.empty(0)
        if self._written:
            # As a plain array, because slices of a memory map take longer.
            values = np.memmap(self._file, np.float64, "r+", shape=(self._written,)).view(np.ndarray)
        for start, n in places:
            yield values[start : start + n * ROWS].reshape(ROWS, n)


class RowSorter:
    """Collects rows that come step by step, and stores them by vehicle in a temporary file."""

    def __init__(self) -> None:
        self._vehicles: dict[str, _Vehicle] = {}
        self._present: set[str] = set()
        self._file = BlockFile()

    def close(self) -> None:
        """Close the temporary file. Blocks that have been yielded stay valid."""
        self._file.close()

    def add(self, names: Sequence[str], which: Numbers, steps: Numbers, block: Array) -> None:
        """Add rows: block[:, k] is the state of vehicle names[which[k]] at steps[k].

        names: (v,). which, steps: (n,). block: (6, n). Steps must not decrease, neither here nor from call to call.
        Vehicles without a row in the last complete step have left the road, and are written to the file.
        """
        order = np.argsort(which, kind="stable")
        present, starts = np.unique(which[order], return_index=True)
        rows_of = np.split(order, starts[1:])
        for k in np.argsort(order[starts]):
            name, rows = names[present[k]], rows_of[k]
            vehicle = self._vehicles.setdefault(name, _Vehicle(first_step=int(steps[rows[0]])))
            vehicle.last_step = int(steps[rows[-1]])
            vehicle.waiting.append(block[:, rows])
            self._present.add(name)
        self._write({name for name in self._present if self._vehicles[name].last_step < steps[-1] - 1})

    def blocks(self) -> Iterator[tuple[str, int, Array]]:
        """Yield name, first step and block (6, n) of each vehicle, in order of first appearance. Call last."""
        self._write(set(self._present))
        views = self._file.views(vehicle.place for vehicle in self._vehicles.values())
        for (name, vehicle), block in zip(self._vehicles.items(), views, strict=True):
            yield name, vehicle.first_step, block

    @property
    def waiting_rows(self) -> int:
        """Number of rows in memory."""
        return sum(part.shape[1] for name in self._present for part in self._vehicles[name].waiting)

    def _write(self, gone: set[str]) -> None:
        for name in gone:
            vehicle = self._vehicles[name]
            vehicle.place = self._file.write(np.concatenate(vehicle.waiting, axis=1))
            vehicle.waiting.clear()
        self._present -= gone
