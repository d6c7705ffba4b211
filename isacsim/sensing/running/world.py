"""The world that the network senses while SUMO runs: every vehicle's conditioned motion, piece by piece.

The world's clock trails SUMO's by the conditioning kernel's lag. Drivers sway within their lane as in a recording; near
a marking the sway fades by the distance to it, because a running simulation does not know that a lane change is coming.
The corners of the road are not rounded, which takes the whole way of a vehicle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from isac_cosim.base.arrays import Array
from isac_cosim.base.seeding import stream
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.sensing.passages import Piece
from isac_cosim.isacsim.sensing.running.conditioning import Kernel, conditioned
from isac_cosim.isacsim.traffic.drivers.sway import GRID_S, ROOM_SHARE, SwaySettings, wandering
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.isacsim.traffic.road_coordinates import lane_headings, smooth_step
from isac_cosim.isacsim.traffic.sources.sumo import Moment, TrafficSettings

X, Y, SPEED, LANE, LANE_POS, LANE_LAT = range(6)
"""Columns of the raw states."""


@dataclass(frozen=True)
class Vehicle:
    """What does not change about a vehicle. kind: SUMO vehicle class."""

    name: str
    kind: str
    length_m: float
    width_m: float


class World:
    """Reads the states of a running simulation, and conditions them.

    kernel: of the conditioning. decision_s: length of a piece, s. rates_hz: of the TV's and the UV's states.
    """

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        traffic: TrafficSettings,
        kernel: Kernel,
        decision_s: float,
        rates_hz: tuple[float, float],
    ) -> None:
        self._scenario, self._seed, self._traffic, self._kernel = scenario, seed, traffic, kernel
        self._steps = round(decision_s / traffic.step_s)
        self._keep = kernel.behind_rows + kernel.ahead_rows + self._steps
        # Rows of a piece's instants among the rows that are kept.
        self._weights = [
            kernel.weights(
                kernel.behind_rows + (np.arange(round(decision_s * rate)) + 1) / (rate * traffic.step_s), self._keep + 1
            )
            for rate in rates_hz
        ]
        self._lane_number = {lane.id: k for k, lane in enumerate(scenario.lanes)}
        self._frames: list[tuple[list[str], Array]] = []
        self._raw: dict[str, Array] = {}
        self._sway: dict[str, _Sway] = {}
        self._routes: dict[str, tuple[Sequence[str], int]] = {}
        self._vehicles: dict[str, Vehicle] = {}
        self._step: int | None = None

    def read(self, moment: Moment) -> Piece | None:
        """Read the states at a moment; returns the piece of motion that it completes, if it completes one."""
        sumo = moment.sumo
        get = sumo.vehicle
        names = [name for name in get.getIDList() if not get.isStoppedParking(name)]
        block = np.empty((len(names), 6))
        for row, name in enumerate(names):
            if name not in self._vehicles:
                self._vehicles[name] = Vehicle(
                    name, str(get.getVehicleClass(name)), float(get.getLength(name)), float(get.getWidth(name))
                )
            x, y = get.getPosition(name)
            lane = self._lane_number.get(get.getLaneID(name), -1)
            place, aside = get.getLanePosition(name), get.getLateralLanePosition(name)
            block[row] = x, y, get.getSpeed(name), lane, place, aside
        block[:, X] -= self._scenario.origin[0]
        block[:, Y] -= self._scenario.origin[1]
        if self._scenario.lefthand:
            block[:, LANE_LAT] *= -1.0
        self._frames.append((names, block))
        self._step = round(moment.time_s / self._traffic.step_s)
        if self._step % self._steps or len(self._frames) < 2:
            return None
        self._routes = {name: (get.getRoute(name), get.getRouteIndex(name)) for name in names}
        return self._piece()

    def _piece(self) -> Piece:
        """Sort the frames by vehicle, and condition the motion of those whose past is long enough."""
        assert self._step is not None
        self._sort()
        whole = [name for name, raw in self._raw.items() if len(raw) == self._keep + 1]
        positions = np.stack([self._raw[name][:, :2].T for name in whole]) if whole else np.empty((0, 2, 1))
        tv, uv = (
            conditioned(positions, weights) if whole else np.empty((0, 6, weights.shape[1]))
            for weights in self._weights
        )
        end = self._step - self._kernel.ahead_rows
        return Piece(end * self._traffic.step_s, tuple(whole), tv, uv, self._lanes(end))

    def _sort(self) -> None:
        """Append the frames to the rows of each vehicle; one that is missing from a frame begins anew."""
        index = [{name: row for row, name in enumerate(names)} for names, _ in self._frames]
        last = index[-1]
        rows: dict[str, Array] = {}
        for name in last:
            present = [k for k, names in enumerate(index) if name in names]
            unbroken = len(present) == len(index)
            first = 0 if unbroken else next(k for k in range(len(index), 0, -1) if name not in index[k - 1])
            fresh = np.stack([self._frames[k][1][index[k][name]] for k in range(first, len(index))])
            in_lanes = fresh[:, LANE] >= 0  # a vehicle that SUMO teleports is in no lane
            if not in_lanes.all():
                continue
            self._add_sway(name, fresh)
            before = self._raw.get(name) if unbroken else None
            rows[name] = (fresh if before is None else np.concatenate([before, fresh]))[-self._keep - 1 :]
        self._raw = rows
        self._frames.clear()

    def _add_sway(self, name: str, rows: Array) -> None:
        """Move new rows sideways, in place."""
        settings = self._traffic.sway
        if settings.sd_m[1] == 0.0:
            return
        lanes, lane = self._scenario.lanes, rows[:, LANE].astype(np.int64)
        width_m = lanes[int(lane[0])].width_m
        if name not in self._sway:
            rng = stream("sway", self._scenario.name, self._seed, name)
            longest_s = self._traffic.run_in_s + self._traffic.duration_s
            self._sway[name] = _Sway.of(self._vehicles[name].width_m, width_m, settings, rng, longest_s)
        offset = self._sway[name].offsets(rows, width_m, self._traffic.step_s, settings)
        offset = -offset if self._scenario.lefthand else offset
        sideways = 1j * lane_headings(lanes, lane, rows[:, LANE_POS]) * offset
        rows[:, X] += sideways.real
        rows[:, Y] += sideways.imag
        rows[:, LANE_LAT] += offset

    def _lanes(self, step: int) -> Recording:
        """Return a recording of one step, which says who was in which lane."""
        back = self._kernel.ahead_rows + 1
        tracks = {}
        for name, raw in self._raw.items():
            if len(raw) < back:
                continue
            x, y, speed, lane, place, aside = (raw[-back : len(raw) - back + 1, column] for column in range(6))
            vehicle = self._vehicles[name]
            tracks[name] = Track(
                name, vehicle.kind, vehicle.length_m, vehicle.width_m, step, x, y, speed, lane.astype(np.int64), place,
                aside, self._onward(name, int(lane[0])),
            )  # fmt: skip
        return Recording(
            self._scenario.name, self._seed, self._traffic.step_s, self._scenario.lanes, tracks,
            lefthand=self._scenario.lefthand,
        )  # fmt: skip

    def _onward(self, name: str, lane: int) -> tuple[str, ...]:
        """Return the edges that a vehicle had still to drive when it was in a lane, a moment before SUMO's time."""
        route, index = self._routes[name]
        edge, inside = self._scenario.lanes[lane], False
        while edge.edge.startswith(":") and edge.successors:
            edge, inside = self._scenario.lanes[self._lane_number[edge.successors[0]]], True
        place = next((k for k in range(min(index + 1, len(route) - 1), -1, -1) if route[k] == edge.edge), max(index, 0))
        return tuple(route[place if inside else place + 1 :])


@dataclass
class _Sway:
    """One driver's sway. passed_s: time that the driver has swayed, slower at low speed."""

    path: CubicSpline
    sd_m: float
    passed_s: float = 0.0

    @classmethod
    def of(
        cls, width_m: float, lane_width_m: float, settings: SwaySettings, rng: np.random.Generator, longest_s: float
    ) -> _Sway:
        """Return the sway that a recording gives the vehicle, before it fades near markings."""
        room = max(0.0, (lane_width_m - width_m) / 2.0)
        sd = min(float(rng.uniform(*settings.sd_m)), ROOM_SHARE * room)
        grid = np.arange(0.0, longest_s + 2.0 * GRID_S, GRID_S)
        return cls(CubicSpline(grid, wandering(len(grid), GRID_S, settings.lags_s, rng)), sd)

    def offsets(self, rows: Array, lane_width_m: float, step_s: float, settings: SwaySettings) -> Array:
        """Return the offsets at the next rows, m, (n,), left positive."""
        swayed = self.passed_s + np.cumsum(np.clip(rows[:, SPEED] / settings.full_mps, 0.0, 1.0)) * step_s
        self.passed_s = float(swayed[-1])
        to_marking = np.clip(1.0 - 2.0 * np.abs(rows[:, LANE_LAT]) / lane_width_m, 0.0, 1.0)
        return np.asarray(self.sd_m * smooth_step(to_marking) * self.path(swayed))
