"""States at every step, rebuilt from states that were taken less often.

A driver of SUMO chooses an acceleration at an action step, every 0.1 s by default, and keeps it until the next one.
Within its lane, a vehicle therefore moves on a parabola from one action step to the next. Where there is one action
step, at a known time, between two samples, their speeds and positions give the accelerations before and after it, and
so the speed and the position at every step in between, but for rounding. Lateral motion has no such law and is
interpolated.

The samples of many vehicles are worked on at once: one vehicle has too few for numpy to be fast.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.isacsim.traffic.recordings.sampled_road import Road

X, Y, SPEED, LANE_POS, LANE_LAT, LANE = range(6)
"""The rows of a block of states."""
ROWS = 6
JUMP_M = 0.3
"""No vehicle drives this far aside from one sample to the next, m. SUMO moves some that far at once."""
CLOSE = 4
"""Steps within which a sample of a commanded vehicle is followed by another one."""
AT_ONCE = 4000
"""Samples after which states are rebuilt at once. What is computed of them fits into a processor's cache."""


@dataclass(frozen=True)
class Samples:
    """The states of vehicles at some steps, one vehicle after the other.

    steps: ascending within a vehicle, (k,). states: x, y, speed, lane_pos, lane_lat and the number of the lane, (6, k).
    turn: after how many steps the driver decides next, (k,). gaps: steps from a sample to that of the same vehicle that
    follows, or to the one after the vehicle's last state, (k,). last: whether it is its vehicle's last sample, (k,).
    """

    steps: IntArray
    states: Array
    turn: Array
    gaps: IntArray
    last: BoolArray

    @classmethod
    def of(
        cls,
        steps: IntArray,
        states: Array,
        commanded: BoolArray,
        counts: IntArray,
        acted: IntArray,
        action_steps: IntArray,
        last_steps: IntArray,
    ) -> Self:
        """Return samples of vehicles whose drivers decide at one step, and again after every so many steps.

        commanded: whether the vehicle is commanded after each sample, (k,). A command changes the acceleration all the
        time: it is taken to change halfway. counts: samples of each vehicle, one at least, (v,). acted, action_steps:
        of each driver, (v,). last_steps: of each vehicle's last state, not before its last sample, (v,).
        """
        last = np.zeros(len(steps), np.bool_)
        last[np.cumsum(counts) - 1] = True
        gaps = np.append(np.diff(steps), 1)
        gaps[last] = 1
        # What SUMO has right after a sample of a commanded vehicle is commanded as well.
        commanded = commanded | np.append(False, (commanded & ~last & (gaps < CLOSE))[:-1])
        acted, action_steps = np.repeat(acted, counts), np.repeat(action_steps, counts)
        turn = np.where(commanded, gaps / 2.0, (acted - steps) % action_steps)
        gaps[last] = last_steps + 1 - steps[last]
        return cls(steps, states, turn, gaps, last)


def at_every_step(samples: Samples, road: Road, step_s: float) -> Array:
    """Return the states of vehicles at every step from their first samples to their last steps, shape (6, n).

    samples: where they are more than one step apart, the driver decides at most once in between. road: of the lanes
    that the samples give as numbers.
    Returns x, y, speed, lane_pos, lane_lat and the number of the lane, one vehicle after the other. Those of the
    samples are the samples.
    """
    gaps, last, taken = samples.gaps, samples.last, np.ascontiguousarray(samples.states)
    first_row = np.cumsum(gaps) - gaps
    lane = taken[LANE].astype(np.int64)
    places = road.places(lane, taken[LANE_POS])
    aside = taken[: Y + 1] - places.points(taken[LANE_POS], taken[LANE_LAT])
    # A vehicle leaves the road at a sample (`SampledLog`), and is on it until then.
    drift = _to_next(aside, last)
    # A jump aside can go some centimetres along as well: it is one jump in the plane, not one in x or y.
    drift[:, np.hypot(*drift) > JUMP_M] = 0.0
    driven, moved = _to_next(taken[LANE_POS], last), _to_next(taken[LANE_LAT], last)
    changes = np.flatnonzero((_to_next(lane, last) != 0) & (gaps > 1))
    ends = np.concatenate([[taken[row, changes], taken[row, changes + 1]] for row in (LANE_POS, SPEED)])
    elapsed_s = np.asarray(gaps[changes] * step_s, np.float64)
    crossings = road.crossings(lane[changes], lane[changes + 1], ends, moved[changes], elapsed_s)
    driven[changes], moved[changes] = crossings.driven_m, crossings.moved_m
    crossing = np.full(len(lane), -1)
    crossing[changes] = np.arange(len(changes))
    ahead = _Along.of(samples, taken, driven, step_s)
    sideways = _slopes(gaps, moved, last)
    jumps = moved - sideways[0]
    # Two samples in one segment have all between them in it.
    leaves = last | (_to_next(places.numbers, last) != 0)

    block = np.empty((ROWS, int(gaps.sum())))
    block[:, first_row] = taken
    for k, gap in _equal(gaps):
        # Instants in rows and samples in columns: numpy is fastest along many samples.
        elapsed = np.arange(1.0, gap)[:, None]
        share = elapsed / gap
        speed, lane_pos = ahead.after(elapsed, k)
        lane_lat = taken[LANE_LAT, k] + _cubic(sideways[:, k], share)
        # Nobody knows when a jump was; halfway is at most half the time wrong.
        lane_lat += jumps[k] * (elapsed >= gap / 2.0)
        lanes = np.tile(taken[LANE, k], (gap - 1, 1))
        points = places.of(k).points(lane_pos, lane_lat)
        crossed = np.flatnonzero(crossing[k] >= 0)
        leaving = np.flatnonzero(leaves[k] & (crossing[k] < 0))
        if len(crossed):
            which = np.tile(crossing[k[crossed]], gap - 1)
            found = crossings.places(which, lane_pos[:, crossed].ravel(), lane_lat[:, crossed].ravel())
            for values, of_crossed in zip((lanes, lane_pos, lane_lat), found, strict=True):
                values[:, crossed] = of_crossed.reshape(gap - 1, -1)
            beyond = road.places(found[0].astype(np.int64), found[1]).points(*found[1:])
            for values, of_crossed in zip(points, beyond, strict=True):
                values[:, crossed] = of_crossed.reshape(gap - 1, -1)
        if len(leaving):
            within = lane_pos[:, leaving]
            beyond = road.further(places.numbers[k[leaving]], within).points(within, lane_lat[:, leaving])
            for values, of_leaving in zip(points, beyond, strict=True):
                values[:, leaving] = of_leaving
        rows = first_row[k] + np.arange(1, gap)[:, None]
        for row, values, off, change in zip(block, points, aside[:, k], drift[:, k], strict=False):
            row[rows] = values + (off + change * share)
        for row, values in zip(block[SPEED:], (speed, lane_pos, lane_lat, lanes), strict=True):
            row[rows] = values
    return block


def _equal(gaps: IntArray) -> Iterator[tuple[IntArray, int]]:
    """Yield samples, `AT_ONCE` at most, and how many steps lie between each of them and the next, more than one."""
    for gap in np.unique(gaps[gaps > 1]).tolist():
        of_gap = np.flatnonzero(gaps == gap)
        for start in range(0, len(of_gap), AT_ONCE):
            yield of_gap[start : start + AT_ONCE], gap


def _to_next(values: npt.NDArray[Any], last: BoolArray) -> npt.NDArray[Any]:
    """Return the change of values from each sample to its vehicle's next, 0 after the last, (..., k)."""
    change = np.zeros_like(values)
    np.subtract(values[..., 1:], values[..., :-1], out=change[..., :-1])
    change[..., last] = 0
    return change


def _before(values: npt.NDArray[Any], last: BoolArray, first: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the values of each vehicle's previous samples, (k,). first: those of its first sample."""
    before = np.roll(values, 1)
    starts = np.roll(last, 1)
    before[starts] = first[starts]
    return before


def _without_jumps(changes: Array) -> Array:
    """Return changes from one sample to the next, m, with 0 for jumps."""
    return np.asarray(np.where(np.abs(changes) > JUMP_M, 0.0, changes))


@dataclass(frozen=True)
class _Along:
    """How vehicles move along their lanes after each sample, in steps: two accelerations, one after the other.

    speed: m per step. lane_pos: m. before, then: acceleration until the driver decides, and from then on, m per step
    squared. turn: steps until then. moving: steps until the vehicle stops, infinite if it does not. Shape (k,) each.
    """

    speed: Array
    lane_pos: Array
    before: Array
    then: Array
    turn: Array
    moving: Array
    step_s: float

    @classmethod
    def of(cls, samples: Samples, taken: Array, driven: Array, step_s: float) -> Self:
        """Find the accelerations. driven: m from each sample to the next, (k,).

        Over n = i + j steps with the acceleration a in the first i and b in the other j, a vehicle at speed v moves on
        by dp, and its speed changes by dv:

            dp = v n + a (i^2 / 2 + i j) + b j^2 / 2,    dv = a i + b j,

        so that a = 2 (dp - v n - dv j / 2) / (n i). After the last sample, a vehicle keeps its acceleration.
        """
        speed, n, last = taken[SPEED] * step_s, samples.gaps, samples.last
        i = np.minimum(samples.turn, n)
        dv, dp, v = _to_next(speed, last), driven, speed
        # A decision at the sample itself leaves one acceleration.
        a = np.where(i > 0, 2.0 * (dp - v * n - dv * (n - i) / 2.0) / (n * np.where(i > 0, i, 1)), dv / n)
        b = np.where(i < n, (dv - a * i) / np.where(i < n, n - i, 1), a)
        moving = np.full(len(n), np.inf)
        stands = np.append(speed[1:] == 0.0, False) & ~last
        # One that stands at the next sample stops before it, unless it went too far for braking all the time.
        stops = np.flatnonzero(stands & (v > 0.0) & (dp > 0.0) & (n > 1) & (2.0 * dp <= v * n))
        moving[stops] = 2.0 * dp[stops] / v[stops]
        a[stops] = b[stops] = -v[stops] / moving[stops]
        kept = _before(b, last, np.zeros(len(n)))[last]
        a[last] = b[last] = np.where(v[last] > 0.0, kept, 0.0)
        brakes = np.flatnonzero(last & (a < 0.0))
        moving[brakes] = -v[brakes] / a[brakes]
        return cls(speed, taken[LANE_POS], a, b, samples.turn, moving, step_s)

    def after(self, elapsed: Array, k: IntArray) -> tuple[Array, Array]:
        """Return speed, m/s, and position, m, some steps (t, 1) after some samples k (m,), shape (t, m) each."""
        steps = np.minimum(elapsed, self.moving[k])
        i = np.minimum(steps, self.turn[k])
        j = steps - i
        speed = self.speed[k]
        gained = self.before[k] * i
        middle = speed + gained
        later = self.then[k] * j
        lane_pos = self.lane_pos[k] + (speed + 0.5 * gained) * i + (middle + 0.5 * later) * j
        return np.maximum(middle + later, 0.0) / self.step_s, lane_pos


def _slopes(gaps: IntArray, moved: Array, last: BoolArray) -> Array:
    """Return of lateral positions after each sample: their change, and their slopes at its ends in shares of its time.

    moved: m aside from each sample to the next, (k,). Returns shape (3, k). The slope at a sample is that of the
    parabola through it and its neighbours. Across a jump there is neither.
    """
    change = _without_jumps(moved)
    rate = change / gaps
    before, gap_before = _before(rate, last, rate), _before(gaps, last, gaps)
    slope = (before * gaps + rate * gap_before) / (gaps + gap_before)
    slope[last] = before[last]
    jumps = moved != change
    slope[jumps | np.append(False, jumps[:-1]) | (change == 0.0) & (before == 0.0)] = 0.0
    at_end = np.append(slope[1:], 0.0)
    still = change == 0.0
    return np.stack([change, np.where(still, 0.0, slope * gaps), np.where(still, 0.0, at_end * gaps)])


def _cubic(slopes: Array, share: Array) -> Array:
    """Return the change of a cubic after shares of its time. slopes: as `_slopes` returns them."""
    change, at_start, at_end = slopes
    bend = at_start + at_end - 2.0 * change
    return np.asarray(share * (at_start + share * (3.0 * change - 2.0 * at_start - at_end + share * bend)))
