"""Samples of vehicles that wait until their states at every step are rebuilt."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field

import numpy as np

from isacsim.arrays import Array, BoolArray, IntArray
from isacsim.scenarios.scenario import Scenario
from isacsim.traffic.state_log import LATERAL, ROWS

MANY = 100_000
"""So many samples wait, and as many as were kept the last time."""
NOBODY = -1
"""The number of a vehicle that is not recorded, and of a lane where there is none."""


@dataclass(frozen=True)
class Rows:
    """Samples: numbers of the vehicles, steps, whether the vehicle is commanded then, (n,) each, and states, (6, n).

    Of a vehicle and step that has several, the first is meant.
    """

    whose: IntArray
    steps: IntArray
    commanded: BoolArray
    states: Array

    @classmethod
    def none(cls) -> Rows:
        """Return no samples."""
        return cls(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0, np.bool_), np.empty((ROWS, 0)))

    def of(self, which: IntArray) -> Rows:
        """Return some of the samples, by their numbers (m,)."""
        return Rows(self.whose[which], self.steps[which], self.commanded[which], self.states.take(which, axis=1))

    def between(self, start: int, stop: int) -> Rows:
        """Return samples that follow one another."""
        part = slice(start, stop)
        return Rows(self.whose[part], self.steps[part], self.commanded[part], self.states[:, part])

    def and_then(self, others: Rows) -> Rows:
        """Return these samples and others."""
        if not len(self.whose):
            return others
        return Rows(
            np.concatenate([self.whose, others.whose]),
            np.concatenate([self.steps, others.steps]),
            np.concatenate([self.commanded, others.commanded]),
            np.concatenate([self.states, others.states], axis=1),
        )

    def with_copies(self, steps: IntArray, of: IntArray) -> Rows:
        """Return these samples and, of steps (m,), the states that some of the samples (m,) have, without commands."""
        copied = self.of(of)
        return self.and_then(Rows(copied.whose, steps, np.zeros(len(of), np.bool_), copied.states))

    def by_vehicle(self, wanted: BoolArray) -> Rows:
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

    kept: Rows = field(default_factory=Rows.none)
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

    def rows(self, scenario: Scenario) -> Rows:
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
        taken = Rows(whose, np.repeat(steps, counts), np.repeat(commanded.astype(np.bool_), counts), states)
        return self.kept.and_then(taken)
