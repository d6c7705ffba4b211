"""The states of a simulation, taken as often as it takes to know every step, and no oftener.

The states of all vehicles are taken from libsumo once per action step, and `sampled_states` rebuilds those in between.
A vehicle that is commanded is sampled more often. That costs far less than having SUMO write every state
(docs/performance.md); having it write those at action steps would cost more as well.
"""

from __future__ import annotations

from array import array
from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.recordings.sampled_road import Road
from isac_cosim.isacsim.traffic.recordings.sampled_states import LANE, Samples, at_every_step
from isac_cosim.isacsim.traffic.recordings.state_log import LATERAL, ROWS, BlockFile, StateLog

COMMANDED_STEPS = 4
"""Steps between two samples of a commanded vehicle."""
SAMPLES_AT_ONCE = 50_000
"""About so many samples are rebuilt at once."""
SELDOM = "1e-300"
"""Probability that a vehicle has a device that is not used. With 0, SUMO would not draw, and others would draw anew."""
STOPS_BESIDE = 1 | 64
"""The flags of a stop beside the road, or in a parking area."""


class SampledLog(StateLog):
    """Takes the states of all vehicles at an interval, and more often of those that are commanded.

    interval_s: longest time between two samples of a vehicle, s. Most drivers must not decide more often; those who do
    are sampled like commanded ones.
    """

    def __init__(self, scenario: Scenario, step_s: float, first: int, interval_s: float) -> None:
        super().__init__(scenario, step_s, first)
        self._interval = int(interval_s / step_s + 1e-9)
        self._road = Road(scenario.lanes)
        self._lanes = {lane.id: float(k) for k, lane in enumerate(scenario.lanes)} | {"": float(NOBODY)}
        # Vehicles have numbers. Of each: name; step of a decision, and steps between two; last step if it has left.
        self._numbers: defaultdict[str, int] = defaultdict(lambda: NOBODY)
        self._names: list[str] = []
        self._actions: list[tuple[int, int]] = []
        self._last_steps: dict[str, int] = {}
        self._taken = Taken()
        # Until when vehicles are sampled more often, those who always are, and those who are commanded in this step.
        self._until: dict[str, float] = {}
        self._hasty: set[str] = set()
        self._commanded: set[str] = set()
        # Of vehicles that will stop beside the road: lateral position, m. Of those that stand there: number of lane.
        self._lateral: dict[str, float] = {}
        self._beside: dict[str, float] = {}
        self._file = BlockFile()
        self._places: list[tuple[int, int]] = []
        self._rebuilt: list[tuple[str, int, int, slice]] = []

    def options(self, folder: Path) -> dict[str, str]:
        """Return the options with which SUMO draws who gets which device as it does for `EveryStepLog`."""
        return {"device.fcd.probability": SELDOM, "person-device.fcd.probability": "0", "precision": "16"}

    def attach(self) -> None:
        """Do nothing: there is nothing to prepare."""

    def close(self) -> None:
        """Close the temporary file."""
        self._file.close()

    def step(self, sumo: Any, commanded: Collection[str] = ()) -> None:
        """Note what happened, as every log does, and take the samples that are due."""
        returned = self._returning
        super().step(sumo, commanded)
        arrived = sumo._libsumo.simulation_getArrivedIDList()
        if self._departed or self.parking or self._lateral or self._beside:
            self._note_beside(sumo, arrived, returned)
        step = round(sumo._libsumo.simulation_getTime() / self._step_s)
        if step <= self._first:
            return
        for name in (*arrived, *self._teleporting):
            self._last_steps[name] = step - 1
            self._until.pop(name, None)
        begins = step == self._first + 1
        for name in sumo.vehicle.getIDList() if begins else self._departed:
            self._begin(sumo, name, step)
        if returned:
            self._take(sumo, [name for name in returned if name not in self._last_steps], step, False)
        if self._commanded != commanded:
            self._note_commanded(sumo, set(commanded), step)
        if self._until and step % COMMANDED_STEPS == 0:
            self._take_often(sumo, step)
        if (step - self._first - 1) % self._interval == 0:
            self._take_all(sumo, step)

    def finish(self, sumo: Any) -> None:
        """Sample all vehicles at the last step."""
        step = round(sumo.simulation.getTime() / self._step_s)
        names = [name for name in sumo.vehicle.getIDList() if name not in self._last_steps]
        self._take(sumo, names, step, False)
        self._last_steps.update(dict.fromkeys(names, step))

    def blocks(self) -> Iterator[tuple[str, int, Array]]:
        """Yield the states of each vehicle. Call when the last samples have been taken."""
        for name in self._names:
            self._last_steps.setdefault(name, 0)
        self._rebuild()
        views = list(self._file.views(self._places))
        for name, first_step, group, rows in sorted(self._rebuilt, key=lambda vehicle: (vehicle[1], vehicle[0])):
            yield name, first_step, views[group][:, rows]

    def _begin(self, sumo: Any, name: str, step: int) -> None:
        """Note when a driver decides, and take the first sample of the vehicle."""
        action_steps = max(1, round(sumo.vehicle.getActionStepLength(name) / self._step_s))
        self._numbers[name] = len(self._names)
        self._names.append(name)
        self._actions.append((round(sumo.vehicle.getLastActionTime(name) / self._step_s), action_steps))
        hasty = action_steps < self._interval
        self._take(sumo, (name,), step, hasty)
        if hasty:
            self._hasty.add(name)
            self._until[name] = np.inf

    def _note_commanded(self, sumo: Any, now: set[str], step: int) -> None:
        """Sample those more often who are commanded now, and those who were, for another while."""
        for name in self._commanded - now:
            if name in self._until and name not in self._hasty:
                self._until[name] = step - 1 + self._interval
        # A vehicle that has just left is commanded no more, but the director does not know that yet.
        for name in now - self._commanded - self._last_steps.keys():
            if name not in self._until:
                self._take(sumo, (name,), step, True)
            self._until[name] = np.inf
        self._commanded = now

    def _note_beside(self, sumo: Any, arrived: Sequence[str], returned: Sequence[str]) -> None:
        """Keep of vehicles that stop beside the road what libsumo does not say of those that stand there.

        A vehicle does not move sideways in the step in which it begins to stand there.
        """
        for name in self._departed:
            if any(stop.stopFlags & STOPS_BESIDE for stop in sumo.vehicle.getStops(name)):
                self._lateral[name] = 0.0
        for name in (*arrived, *self._teleporting):
            self._lateral.pop(name, None)
            self._beside.pop(name, None)
        for name in returned:
            self._beside.pop(name, None)
        for name in self.parking:
            self._beside[name] = self._lanes[sumo.vehicle.getStops(name, 1)[0].lane]
        for name in self._lateral:
            if name not in self._beside:
                self._lateral[name] = sumo.vehicle.getLateralLanePosition(name)

    def _take_often(self, sumo: Any, step: int) -> None:
        """Sample the vehicles that are sampled more often, some of them for the last time."""
        ended = [name for name, until in self._until.items() if until <= step]
        for name in ended:
            del self._until[name]
        if self._until:
            self._take(sumo, tuple(self._until), step, True)
        if ended:
            self._take(sumo, ended, step, False)

    def _take_all(self, sumo: Any, step: int) -> None:
        """Sample all vehicles, also those beside the road, and rebuild states where many samples wait for that."""
        names = sumo.vehicle.getIDList()
        self._take(sumo, names, step, False)
        for name, lane in self._beside.items():
            if name in names:
                place = names.index(name) - len(names)
                self._taken.lane[place], self._taken.lane_lat[place] = lane, self._lateral.get(name, 0.0)
        if self._taken.due:
            self._rebuild()

    def _take(self, sumo: Any, names: Sequence[str], step: int, commanded: bool) -> None:
        """Take states from libsumo. It gives no lane to a vehicle that is not on the road."""
        # As in `StateLog.step`, libsumo itself.
        direct, taken = sumo._libsumo, self._taken
        taken.takings.append((step, len(names), commanded))
        taken.whose.extend(map(self._numbers.__getitem__, names))
        taken.points.extend(chain.from_iterable(map(direct.vehicle_getPosition, names)))
        taken.speed.extend(map(direct.vehicle_getSpeed, names))
        taken.lane_pos.extend(map(direct.vehicle_getLanePosition, names))
        taken.lane_lat.extend(map(direct.vehicle_getLateralLanePosition, names))
        taken.lane.extend(map(self._lanes.__getitem__, map(direct.vehicle_getLaneID, names)))

    def _rebuild(self) -> None:
        """Rebuild the states of vehicles that have left the road, and keep the samples of the others.

        A vehicle that had an incident has no track; there are no laws for how it moved.
        """
        rows = self._taken.rows(self._scenario)
        incidents = self.collided | self.teleported
        # The last element is that of `NOBODY`.
        wanted = np.array([*(name not in incidents for name in self._names), False])
        left = np.array([*(name in self._last_steps for name in self._names), False])
        self._taken = Taken(rows.of(np.flatnonzero((wanted & ~left)[rows.whose])))
        rows = self._with_stays(rows, wanted & left).by_vehicle(wanted & left)
        numbers, starts, counts = np.unique(rows.whose, return_index=True, return_counts=True)
        groups = np.flatnonzero(np.diff(starts // SAMPLES_AT_ONCE, prepend=-1))
        for group, after in pairwise((*groups.tolist(), len(numbers))):
            samples = rows.between(int(starts[group]), int(starts[after - 1] + counts[after - 1]))
            self._store(samples, numbers[group:after], counts[group:after])

    def _store(self, rows: SampledRows, numbers: IntArray, counts: IntArray) -> None:
        """Rebuild the states of some vehicles, given all their samples, and write them to a file."""
        acted, action_steps = np.array([self._actions[number] for number in numbers]).T
        names = [self._names[number] for number in numbers]
        ends = np.cumsum(counts)
        first_steps, latest = rows.steps[ends - counts], rows.steps[ends - 1]
        last_steps = np.maximum([self._last_steps[name] for name in names], latest)
        samples = Samples.of(rows.steps, rows.states, rows.commanded, counts, acted, action_steps, last_steps)
        block = at_every_step(samples, self._road, self._step_s)
        block[LANE] = block[LANE].astype(np.int64).view(np.float64)
        stops = np.cumsum(last_steps + 1 - first_steps).tolist()
        for name, first_step, start, stop in zip(names, first_steps.tolist(), (0, *stops), stops, strict=False):
            self._rebuilt.append((name, first_step, len(self._places), slice(start, stop)))
        self._places.append(self._file.write(block))

    def _with_stays(self, rows: SampledRows, wanted: BoolArray) -> SampledRows:
        """Return samples and, of wanted vehicles (v,), those of the first and the last step of stays beside the road.

        A vehicle that parks is beside the road at once, and stands.
        """
        added: list[tuple[int, int]] = []
        for name in self._parked:
            number = self._numbers.get(name, NOBODY)
            own = np.flatnonzero(rows.whose == number) if wanted[number] else np.empty(0, np.int64)
            own = own[(rows.steps[own] - self._first - 1) % self._interval == 0]
            steps = rows.steps[own]
            for first, after in self._parked[name]:
                inside = own[(steps >= first) & (steps < (np.inf if after is None else after))]
                if len(inside):
                    if first >= steps[0]:
                        added.append((first, int(inside[0])))
                    if after is not None:
                        added.append((after - 1, int(inside[-1])))
        return rows.with_copies(*np.array(added).T) if added else rows


MANY = 100_000
"""So many samples wait, and as many as were kept the last time."""
NOBODY = -1
"""The number of a vehicle that is not recorded, and of a lane where there is none."""


@dataclass(frozen=True)
class SampledRows:
    """Samples: numbers of the vehicles, steps, whether the vehicle is commanded then, (n,) each, and states, (6, n).

    Of a vehicle and step that has several, the first is meant.
    """

    whose: IntArray
    steps: IntArray
    commanded: BoolArray
    states: Array

    @classmethod
    def none(cls) -> SampledRows:
        """Return no samples."""
        return cls(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0, np.bool_), np.empty((ROWS, 0)))

    def of(self, which: IntArray) -> SampledRows:
        """Return some of the samples, by their numbers (m,)."""
        return SampledRows(self.whose[which], self.steps[which], self.commanded[which], self.states.take(which, axis=1))

    def between(self, start: int, stop: int) -> SampledRows:
        """Return samples that follow one another."""
        part = slice(start, stop)
        return SampledRows(self.whose[part], self.steps[part], self.commanded[part], self.states[:, part])

    def and_then(self, others: SampledRows) -> SampledRows:
        """Return these samples and others."""
        if not len(self.whose):
            return others
        return SampledRows(
            np.concatenate([self.whose, others.whose]),
            np.concatenate([self.steps, others.steps]),
            np.concatenate([self.commanded, others.commanded]),
            np.concatenate([self.states, others.states], axis=1),
        )

    def with_copies(self, steps: IntArray, of: IntArray) -> SampledRows:
        """Return these samples and, of steps (m,), the states that some of the samples (m,) have, without commands."""
        copied = self.of(of)
        return self.and_then(SampledRows(copied.whose, steps, np.zeros(len(of), np.bool_), copied.states))

    def by_vehicle(self, wanted: BoolArray) -> SampledRows:
        """Return the samples of wanted vehicles (v,), one vehicle after the other, of each in the order of steps."""
        which = np.flatnonzero(wanted[self.whose])
        order = which[np.lexsort((self.steps[which], self.whose[which]))]
        whose, steps = self.whose[order], self.steps[order]
        again = np.flatnonzero((whose[1:] == whose[:-1]) & (steps[1:] == steps[:-1])) + 1
        return self.of(np.delete(order, again))


@dataclass(frozen=True)
class Taken:
    """What has been taken from a running simulation.

    kept: samples that were taken before. takings: step, number of samples, and whether the vehicles are commanded.
    whose: numbers of vehicles. points: x and y of each sample in turn, in the coordinates of SUMO, m. lane_lat:
    positive as SUMO has it. lane: numbers of lanes.
    """

    kept: SampledRows = field(default_factory=SampledRows.none)
    takings: list[tuple[int, int, bool]] = field(default_factory=list)
    whose: array[int] = field(default_factory=lambda: array("q"))
    points: array[float] = field(default_factory=lambda: array("d"))
    speed: array[float] = field(default_factory=lambda: array("d"))
    lane_pos: array[float] = field(default_factory=lambda: array("d"))
    lane_lat: array[float] = field(default_factory=lambda: array("d"))
    lane: array[float] = field(default_factory=lambda: array("d"))

    @property
    def due(self) -> bool:
        """Whether many samples wait."""
        return len(self.whose) >= max(MANY, len(self.kept.whose))

    def rows(self, scenario: Scenario) -> SampledRows:
        """Return all samples, those taken first first, in the coordinates of the scenario."""
        steps, counts, commanded = np.array(self.takings, np.int64).reshape(-1, 3).T
        states = np.empty((ROWS, len(self.whose)))
        points = np.array(self.points).reshape(-1, 2)
        for row, values, origin in zip(states, points.T, scenario.origin, strict=False):
            np.subtract(values, origin, out=row)
        for row, column in zip(states[2:], (self.speed, self.lane_pos, self.lane_lat, self.lane), strict=True):
            row[:] = column
        if scenario.lefthand:  # SUMO's lateral positions are positive towards the inner lanes
            states[LATERAL] *= -1.0
        whose = np.where(states[-1] == NOBODY, NOBODY, np.array(self.whose))
        taken = SampledRows(whose, np.repeat(steps, counts), np.repeat(commanded.astype(np.bool_), counts), states)
        return self.kept.and_then(taken)
