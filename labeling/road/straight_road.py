"""Recordings made by hand: scripted vehicles on a straight road. For examples, and for trying out a detector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track

LANE_WIDTH_M = 3.2
LENGTH_M = 10_000.0
STEP_S = 0.01

Script = float | Sequence[tuple[float, float]]
"""A constant value, or corners (time in s, value) with straight lines between them."""


@dataclass(frozen=True)
class ScriptedVehicle:
    """A vehicle whose motion is given.

    speed: m/s. lateral: position of its centre, m left of the centre line of the rightmost lane. start_m: position of
    its front bumper along the road at time 0. It is on the road from time 0 to duration_s.
    """

    vehicle: str
    speed: Script = 30.0
    lateral: Script = 0.0
    start_m: float = 0.0
    duration_s: float = 40.0
    length_m: float = 5.0


def straight_road(*vehicles: ScriptedVehicle, n_lanes: int = 3) -> Recording:
    """Return the 100 Hz recording of scripted vehicles on a straight one-way road of 10 km with lanes of 3.2 m.

    >>> recording = straight_road(ScriptedVehicle("tv", speed=20.0, lateral=[(10, 0.0), (14, 3.2)]))
    >>> track = recording.tracks["tv"]
    >>> track.lane[[0, -1]].tolist(), round(track.x[-1])
    ([0, 1], 800)

    Raises ValueError where a vehicle leaves the road.
    """
    along = np.array([0.0, LENGTH_M])
    lanes = tuple(
        Lane(
            f"road_{k}", "road", k, LANE_WIDTH_M, LENGTH_M, np.stack([along, 0 * along + k * LANE_WIDTH_M], axis=1), ()
        )
        for k in range(n_lanes)
    )
    return Recording("straight_road", 0, STEP_S, lanes, {v.vehicle: _track(v, n_lanes) for v in vehicles})


def _track(scripted: ScriptedVehicle, n_lanes: int) -> Track:
    times = np.asarray(np.arange(round(scripted.duration_s / STEP_S) + 1) * STEP_S, np.float64)
    speed, y = _values(scripted.speed, times), _values(scripted.lateral, times)
    x = scripted.start_m + np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * STEP_S)])
    lane = np.floor(y / LANE_WIDTH_M + 0.5).astype(np.int32)
    if lane.min() < 0 or lane.max() >= n_lanes or x.min() < 0 or x.max() > LENGTH_M:
        raise ValueError(f"vehicle {scripted.vehicle} leaves the road; it has {n_lanes} lanes and {LENGTH_M:g} m")
    return Track(
        scripted.vehicle, "passenger", scripted.length_m, 1.8, 0, x, y, speed, lane, x, y - lane * LANE_WIDTH_M
    )


def _values(script: Script, times: Array) -> Array:
    if isinstance(script, int | float):
        return np.full(len(times), float(script))
    at, values = zip(*script, strict=True)
    return np.asarray(np.interp(times, at, values))
