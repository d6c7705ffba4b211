"""What a running simulation shows, step by step, kept so that memory does not grow with simulated time.

States are gathered in one flat buffer a column, which is emptied every simulated minute: the rows of vehicles that
have left go to a temporary file, those of vehicles on the road wait for the rest. Tracks are views into that file.
"""

from __future__ import annotations

import tempfile
from array import array
from collections.abc import Callable, Iterable
from itertools import chain
from typing import Any

import numpy as np
import numpy.typing as npt

from isacsim.recording import Track
from isacsim.scenario import Scenario

COLUMNS = ("x", "y", "speed", "lane_pos", "lane_lat")
EMPTY_EVERY_S = 60.0


class StateLog:
    """The states of every vehicle of one simulation. sumo: the running libsumo module."""

    def __init__(self, scenario: Scenario, sumo: Any, step_s: float) -> None:
        vehicle = sumo.vehicle
        lane_number = {lane.id: k for k, lane in enumerate(scenario.lanes)}
        self._sumo = sumo
        self._origin = scenario.origin
        self._empty_every = round(EMPTY_EVERY_S / step_s)
        self._number: dict[str, int] = {}
        self._facts: list[tuple[str, float, float, int]] = []
        # One C-level loop a column is faster than a Python loop over vehicles.
        self._buffers: dict[str, tuple[array[Any], Callable[[tuple[str, ...]], Iterable[Any]]]] = {
            "vehicle": (array("q"), lambda ids: map(self._number.__getitem__, ids)),
            "position": (array("d"), lambda ids: chain.from_iterable(map(vehicle.getPosition, ids))),
            "speed": (array("d"), lambda ids: map(vehicle.getSpeed, ids)),
            "lane": (array("q"), lambda ids: map(lane_number.__getitem__, map(vehicle.getLaneID, ids))),
            "lane_pos": (array("d"), lambda ids: map(vehicle.getLanePosition, ids)),
            "lane_lat": (array("d"), lambda ids: map(vehicle.getLateralLanePosition, ids)),
        }
        self._steps = 0
        self._waiting: dict[int, list[npt.NDArray[np.float64]]] = {}
        self._file = tempfile.TemporaryFile(prefix="cosim-")  # noqa: SIM115 - closed when the log is
        self._blocks: dict[int, tuple[int, int]] = {}
        self._written = 0
        self.collided: set[str] = set()
        self.teleported: set[str] = set()

    def incidents(self) -> None:
        """Note the vehicles that collided or teleported in this step."""
        for collision in self._sumo.simulation.getCollisions():
            self.collided |= {collision.collider, collision.victim}
        self.teleported.update(self._sumo.simulation.getStartingTeleportIDList())

    def states(self, step: int) -> None:
        """Note the state of every vehicle on the road after this step."""
        vehicle = self._sumo.vehicle
        ids = vehicle.getIDList()
        for name in ids:
            if name not in self._number:
                self._number[name] = len(self._facts)
                self._facts.append(
                    (vehicle.getVehicleClass(name), vehicle.getLength(name), vehicle.getWidth(name), step)
                )
        for buffer, read in self._buffers.values():
            buffer.extend(read(ids))
        self._steps += 1
        if self._steps % self._empty_every == 0:
            self._empty({self._number[name] for name in ids})

    def tracks(self) -> dict[str, Track]:
        """Tracks by vehicle, in order of first appearance, without those that had an incident. Ends the log."""
        self._empty(set())
        self._file.flush()
        if not self._written:
            return {}
        rows = np.memmap(self._file, np.float64, "r", shape=(self._written,))
        tracks = {}
        for name, number in self._number.items():
            if name in self.collided or name in self.teleported:
                continue
            kind, length, width, first_step = self._facts[number]
            start, n = self._blocks[number]
            block = rows[start : start + n * (len(COLUMNS) + 1)].reshape(-1, n)
            tracks[name] = Track(
                vehicle=name,
                kind=kind,
                length_m=length,
                width_m=width,
                first_step=first_step,
                lane=np.asarray(block[-1].view(np.int64)),
                **{column: np.asarray(values) for column, values in zip(COLUMNS, block[:-1], strict=True)},
            )
        return tracks

    def _empty(self, present: set[int]) -> None:
        """Move the buffers' rows to the vehicles that they are of, and those of vehicles that have left to the file."""
        columns = {name: np.array(buffer) for name, (buffer, _) in self._buffers.items()}
        for buffer, _ in self._buffers.values():
            del buffer[:]
        vehicle = columns["vehicle"]
        x, y = columns["position"].reshape(-1, 2).T - np.reshape(self._origin, (2, 1))
        rows = np.stack(
            [x, y, columns["speed"], columns["lane_pos"], columns["lane_lat"], columns["lane"].view(np.float64)]
        )
        order = np.argsort(vehicle, kind="stable")
        numbers, starts = np.unique(vehicle[order], return_index=True)
        # Split at every start, the first included: without rows there is then no part at all.
        for number, mine in zip(numbers.tolist(), np.split(order, starts)[1:], strict=True):
            self._waiting.setdefault(number, []).append(rows[:, mine])
        for number in [each for each in self._waiting if each not in present]:
            block = np.concatenate(self._waiting.pop(number), axis=1)
            self._blocks[number] = (self._written, block.shape[1])
            self._file.write(np.ascontiguousarray(block).tobytes())
            self._written += block.size
