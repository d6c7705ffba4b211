"""The conditioned motion of a vehicle along and across its road: the input of the detectors.

Lateral motion is measured from the lane's centre line and continued over markings and edge changes. A curve, a
junction, another numbering of lanes, or another place on the map therefore does not change it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from isac_cosim.base.arrays import Array, reflected
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.labeling.road.lane_graph import LaneGraph, LaneStep

WIDTH_S = 0.15
"""Default standard deviation of the conditioning kernel, s."""
GRID_S = 0.05
"""Maximum sampling interval of the motion, s. Conditioned motion contains nothing above 3 Hz."""
JUMP_MPS = 5.0
"""A lateral step faster than this is not motion of a vehicle but a jump of the simulator, m/s."""
REACH = 5.0
"""Half-width of the kernel, in standard deviations."""


@dataclass(frozen=True)
class MarkingCrossing:
    """The vehicle's centre crosses one marking.

    time: of the first row beyond the marking, s. marking: its number; 0 is the left marking of the lane in which the
    track starts, and numbers increase to the left. left: whether it is crossed from right to left. at_m: the lateral
    position of the marking on the scale of `RoadMotion.q`, m.
    """

    time: float
    marking: int
    left: bool
    at_m: float


@dataclass(frozen=True)
class RoadMotion:
    """Conditioned motion of the front bumper centre of one vehicle, evenly sampled, arrays of shape (n,).

    times: simulation time, s, at intervals of at most `GRID_S`.
    v, a: speed and acceleration along the road, m/s, m/s2.
    q, vq, aq: lateral position, speed and acceleration, m, m/s, m/s2, left positive; the position is measured from the
    centre line of the lane in which the track starts.
    crossings: of markings, in order. jumps: times of steps that are not motion, s. until: time of the last row of the
    track, s, up to `GRID_S` after the last sample.
    """

    vehicle: str
    times: Array
    v: Array
    a: Array
    q: Array
    vq: Array
    aq: Array
    crossings: tuple[MarkingCrossing, ...]
    jumps: tuple[float, ...]
    until: float

    def lateral_at(self, time: float) -> float:
        """Return the lateral position at a time (s), m."""
        return float(np.interp(time, self.times, self.q))


def road_motion(recording: Recording, track: Track, graph: LaneGraph, width_s: float) -> RoadMotion:
    """Return the motion of one track relative to its road.

    graph: of the recording's lanes. width_s: standard deviation of the conditioning kernel, s.
    """
    times = recording.times(track)
    lateral, crossings, jumps = _lateral(track, graph, times, recording.step_s)
    every = max(1, int(GRID_S / recording.step_s + 1e-6))
    grid_s = every * recording.step_s
    v = _decimate(track.speed, width_s / recording.step_s, every)
    q = _decimate(lateral, width_s / recording.step_s, every)
    vq = slope(q, grid_s)
    return RoadMotion(
        vehicle=track.vehicle,
        times=times[::every],
        v=v,
        a=slope(v, grid_s),
        q=q,
        vq=vq,
        aq=slope(vq, grid_s),
        crossings=tuple(crossings),
        jumps=tuple(jumps),
        until=float(times[-1]),
    )


def _decimate(values: Array, sigma: float, every: int) -> Array:
    """Return every `every`-th row of the Gaussian-smoothed values; sigma in rows. Ends are point-reflected."""
    from scipy.signal import upfirdn  # loaded only here, because it takes a second

    reach = int(np.ceil(REACH * sigma))
    # Pad so that the rows to keep coincide with the kernel centres that the decimation keeps.
    before = reach + -2 * reach % every
    padded = reflected(values, before, reach)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    first = (before + reach) // every
    count = -(-len(values) // every)
    return np.asarray(upfirdn(kernel / kernel.sum(), padded, 1, every)[first : first + count])


def slope(values: Array, step_s: float) -> Array:
    """Return the time derivative of evenly sampled values, shape (n,), in their unit per second.

    Central differences of fourth order, of second order next to the ends, and one-sided at the ends.
    """
    if len(values) < 5:
        return np.gradient(values, step_s) if len(values) > 1 else np.zeros_like(values)
    inner = (8 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])) / (12 * step_s)
    return np.concatenate(
        [
            [(values[1] - values[0]) / step_s, (values[2] - values[0]) / (2 * step_s)],
            inner,
            [(values[-1] - values[-3]) / (2 * step_s), (values[-1] - values[-2]) / step_s],
        ]
    )


def _lateral(
    track: Track, graph: LaneGraph, times: Array, step_s: float
) -> tuple[Array, list[MarkingCrossing], list[float]]:
    """Return the lateral position over markings and edges, m; the markings crossed; and the times of jumps, s."""
    rows = np.flatnonzero(track.lane[1:] != track.lane[:-1]) + 1
    shifts = np.zeros(len(rows))
    crossings: list[MarkingCrossing] = []
    level, centre = 0, 0.0
    limit = JUMP_MPS * step_s
    for n, row in enumerate(rows):
        a, b = int(track.lane[row - 1]), int(track.lane[row])
        change = float(track.lane_lat[row] - track.lane_lat[row - 1])
        step = _likeliest(graph.steps(a, b), change)
        same_edge = graph.lanes[a].edge == graph.lanes[b].edge
        if step is not None and same_edge and graph.lanes[a].uneven:
            # The centre lines are not everywhere as far apart as the mean widths say.
            here = np.array([complex(track.x[row], track.y[row])])
            step = replace(step, shift_m=float(graph.places.places(a, here).left[0] - track.lane_lat[row]))
        # Where an edge ends, the centre line may be offset: that is the road's shape, not the vehicle's motion.
        continued = step is not None and (same_edge or abs(change + step.shift_m) <= limit)
        shifts[n] = step.shift_m if step is not None and continued else -change
        if step is not None:
            left = step.levels > 0
            for k in range(abs(step.levels)):
                at = centre + step.shift_m * (k + 0.5) / abs(step.levels)
                crossings.append(MarkingCrossing(float(times[row]), level if left else level - 1, left, at))
                level += 1 if left else -1
        centre += shifts[n]
    offset = np.zeros(len(track))
    offset[rows] = shifts
    lateral = track.lane_lat + np.cumsum(offset)
    jumps = np.flatnonzero(np.abs(np.diff(lateral)) > max(limit, 0.05)) + 1
    return np.asarray(lateral), crossings, [float(times[k]) for k in jumps]


def _likeliest(steps: tuple[LaneStep, ...], change_m: float) -> LaneStep | None:
    """Return the step onto a lane with the smallest lateral jump; of equal ones that over the fewest markings."""
    return min(steps, key=lambda step: round(abs(change_m + step.shift_m), 2), default=None)
