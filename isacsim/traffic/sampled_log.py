"""The states of a simulation, taken as often as it takes to know every step, and no oftener.

SUMO writes the states of all vehicles once per action step, and `sampled_states` rebuilds those in between. A vehicle
that is commanded is sampled more often. That costs far less than having SUMO write every state (docs/performance.md).
"""

from __future__ import annotations

from array import array
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from isacsim.arrays import Array
from isacsim.scenarios.scenario import Scenario
from isacsim.traffic.sampled_states import Road, Samples, at_every_step
from isacsim.traffic.state_log import LATERAL, ROWS, FileLog, Numbers, RowSorter

COMMANDED_STEPS = 4
"""Steps between two samples of a commanded vehicle."""
SAMPLE = ("step", "x", "y", "speed", "lane_pos", "lane_lat", "lane", "commanded")
"""The values of a sample that is taken through libsumo."""


class SampledLog(FileLog):
    """Takes the states of all vehicles at an interval, and more often of those that are commanded.

    interval_s: longest time between two samples of a vehicle, s. Most drivers must not decide more often; those who do
    are sampled like commanded ones.
    """

    def __init__(self, scenario: Scenario, step_s: float, first: int, interval_s: float) -> None:
        super().__init__(scenario, step_s, first)
        self._interval = int(interval_s / step_s + 1e-9)
        self._lanes = {lane.id: k for k, lane in enumerate(scenario.lanes)}
        self._road = Road(scenario.lanes)
        self._samples: dict[str, array[float]] = {}
        self._until: dict[str, float] = {}
        self._last_step: dict[str, int] = {}
        self._actions: dict[str, tuple[int, int]] = {}

    def options(self, folder: Path) -> dict[str, str]:
        """Return the options of a log at every step, and the interval at which SUMO writes."""
        return {**super().options(folder), "device.fcd.period": f"{self._interval * self._step_s:g}"}

    def step(self, sumo: Any, commanded: Collection[str] = ()) -> None:
        """Note what happened, as every log does, and take the samples that SUMO does not write."""
        returned = self._returning
        super().step(sumo, commanded)
        step = round(sumo.simulation.getTime() / self._step_s)
        if step <= self._first:
            return
        for name in (*sumo.simulation.getArrivedIDList(), *self._teleporting):
            self._last_step[name] = step - 1
            self._until.pop(name, None)
        begins = step == self._first + 1
        for name in sumo.vehicle.getIDList() if begins else self._departed:
            self._begin(sumo, name, step)
        for name in returned:
            if name not in self._last_step:
                self._sample(sumo, name, step, False)
        # A vehicle that has just left is commanded no more, but the director does not know that yet.
        for name in commanded:
            if name in self._last_step:
                continue
            if name not in self._until:
                self._sample(sumo, name, step, True)
                self._until[name] = step + self._interval
            else:
                self._until[name] = max(self._until[name], step + self._interval)
        if self._until and step % COMMANDED_STEPS == 0:
            for name, until in list(self._until.items()):
                self._sample(sumo, name, step, until > step)
                if until <= step:
                    del self._until[name]

    def finish(self, sumo: Any) -> None:
        """Sample all vehicles at the last step."""
        step = round(sumo.simulation.getTime() / self._step_s)
        for name in sumo.vehicle.getIDList():
            if name not in self._last_step:
                self._sample(sumo, name, step, False)
                self._last_step[name] = step

    def blocks(self) -> Iterator[tuple[str, int, Array]]:
        """Yield the states of each vehicle; only when SUMO has ended is its file complete."""
        sorter = RowSorter(self._interval, self._rebuilt)
        for rows in self._batches():
            sorter.add(*rows)
        blocks = {name: (first_step, block) for name, first_step, block in sorter.blocks(self._samples)}
        for name in sorted(blocks, key=lambda name: (blocks[name][0], name)):
            yield name, *blocks[name]

    def _begin(self, sumo: Any, name: str, step: int) -> None:
        """Note when a driver decides, and take the first sample of the vehicle."""
        action_steps = max(1, round(sumo.vehicle.getActionStepLength(name) / self._step_s))
        self._actions[name] = round(sumo.vehicle.getLastActionTime(name) / self._step_s), action_steps
        often = action_steps < self._interval
        self._sample(sumo, name, step, often)
        if often:
            self._until[name] = float("inf")

    def _sample(self, sumo: Any, name: str, step: int, commanded: bool) -> None:
        """Take a state through libsumo. It has none of a parked vehicle; SUMO's file does."""
        get = sumo.vehicle
        lane = get.getLaneID(name)
        if not lane:
            return
        x, y = get.getPosition(name)
        along = get.getSpeed(name), get.getLanePosition(name), get.getLateralLanePosition(name)
        self._samples.setdefault(name, array("d")).extend((step, x, y, *along, self._lanes[lane], commanded))

    def _rebuilt(self, name: str, steps: Numbers, block: Array) -> tuple[int, Array]:
        """Return the first step of a vehicle and its states at every step, given those that SUMO wrote.

        A vehicle that had an incident has no track; there are no laws for how it moved.
        """
        if name in self.collided or name in self.teleported:
            return 0, np.empty((ROWS, 0))
        taken = np.array(self._samples.get(name, ())).reshape(-1, len(SAMPLE)).T
        more = taken[1:-1].copy()
        more[:2] -= np.reshape(self._scenario.origin, (2, 1))
        if self._scenario.lefthand:  # SUMO's lateral positions are positive towards the inner lanes
            more[LATERAL] *= -1.0
        steps, written = self._with_stays(name, steps, block)
        every_step = np.concatenate([taken[0], steps])
        # Of a step that has both, the sample that was taken through libsumo comes first and stays.
        every_step, places = np.unique(every_step, return_index=True)
        commanded = np.concatenate([taken[-1] > 0, np.zeros(len(steps), np.bool_)])[places]
        states = np.concatenate([more, written], axis=1)[:, places]
        samples = Samples.of(every_step.astype(np.int64), states, commanded, *self._actions[name])
        last_step = self._last_step.get(name, samples.steps[-1])
        rebuilt = at_every_step(samples, max(last_step, int(samples.steps[-1])), self._road, self._step_s)
        rebuilt[ROWS - 1] = rebuilt[ROWS - 1].astype(np.int64).view(np.float64)
        return int(samples.steps[0]), rebuilt

    def _with_stays(self, name: str, steps: Numbers, block: Array) -> tuple[Numbers, Array]:
        """Return what SUMO wrote of a vehicle, with numbers for lanes, and the first and last state of its stays.

        A vehicle that parks is beside the road at once, and stands.
        """
        written = block.copy()
        written[-1] = written[-1].view(np.int64)
        added: list[tuple[int, int]] = []
        for first, after in self._parked.get(name, ()):
            inside = np.flatnonzero((steps >= first) & (steps < (np.inf if after is None else after)))
            if len(inside):
                if first >= steps[0]:
                    added.append((first, int(inside[0])))
                if after is not None:
                    added.append((after - 1, int(inside[-1])))
        if not added:
            return steps, written
        more_steps, copied = np.array(added).T
        return np.append(steps, more_steps), np.append(written, written[:, copied], axis=1)
