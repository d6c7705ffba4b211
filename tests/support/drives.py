"""Recordings made by hand: roads with edges, junction lanes, renumbered lanes and curves, and scripted vehicles.

A road is described along s, m from its start, and across it in slots of one lane width: 0 is the base lane, left is
positive. For a straight road without edges, see `labeling.road.straight_road`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.recordings.recording import Command, Recording, Track

WIDTH_M = 3.2
STEP_S = 0.01


@dataclass(frozen=True)
class Stretch:
    """An edge: its length, m, and its slots from right to left. internal: whether it is inside a junction."""

    length_m: float
    slots: tuple[int, ...] = (0, 1, 2)
    internal: bool = False


@dataclass(frozen=True)
class Road:
    """Consecutive stretches on an arc of `curvature` (1/m, left positive) from `origin` (m) with `heading` (rad)."""

    stretches: tuple[Stretch, ...] = (Stretch(5000.0),)
    curvature: float = 0.0
    heading: float = 0.0
    origin: tuple[float, float] = (0.0, 0.0)

    @property
    def starts(self) -> Array:
        return np.concatenate([[0.0], np.cumsum([stretch.length_m for stretch in self.stretches])])

    def edge(self, n: int) -> str:
        return f":j{n}" if self.stretches[n].internal else f"e{n}"

    def lane(self, n: int, slot: int) -> str:
        return f"{self.edge(n)}_{self.stretches[n].slots.index(slot)}"

    def xy(self, s: Array, y: Array) -> tuple[Array, Array]:
        """Return map positions at s along the base lane and y left of it, m."""
        c = self.curvature
        turned = self.heading + c * s
        if c:
            along = (np.sin(turned) - np.sin(self.heading)) / c, (np.cos(self.heading) - np.cos(turned)) / c
        else:
            along = s * np.cos(self.heading), s * np.sin(self.heading)
        return self.origin[0] + along[0] - y * np.sin(turned), self.origin[1] + along[1] + y * np.cos(turned)

    def lanes(self) -> tuple[Lane, ...]:
        lanes = []
        for n, stretch in enumerate(self.stretches):
            onward = self.stretches[n + 1].slots if n + 1 < len(self.stretches) else ()
            at = np.linspace(self.starts[n], self.starts[n + 1], 20)
            for index, slot in enumerate(stretch.slots):
                successors = (self.lane(n + 1, slot),) if slot in onward else ()
                shape = np.stack(self.xy(at, np.full(20, slot * WIDTH_M)), axis=1)
                lane = Lane(self.lane(n, slot), self.edge(n), index, WIDTH_M, stretch.length_m, shape, successors)
                lanes.append(lane)
        return tuple(lanes)

    def track(
        self,
        vehicle: str,
        s: Array,
        y: Array,
        speed: Array,
        first_step: int = 0,
        length_m: float = 5.0,
        kind: str = "passenger",
    ) -> Track:
        """Return the track of a vehicle whose front bumper is at (s, y), m, shapes (n,)."""
        number = {lane.id: k for k, lane in enumerate(self.lanes())}
        n = np.clip(np.searchsorted(self.starts, s, side="right") - 1, 0, len(self.stretches) - 1)
        slot = np.floor(y / WIDTH_M + 0.5).astype(int)
        lane = np.array([number[self.lane(int(a), int(b))] for a, b in zip(n, slot, strict=True)], dtype=np.int32)
        x_map, y_map = self.xy(s, y)
        return Track(
            vehicle, kind, length_m, 1.8, first_step, x_map, y_map, speed, lane, s - self.starts[n], y - slot * WIDTH_M
        )

    def recording(self, *tracks: Track, commands: Sequence[Command] = (), step_s: float = STEP_S) -> Recording:
        return Recording(
            "scripted", 7, step_s, self.lanes(), {track.vehicle: track for track in tracks}, tuple(commands)
        )


@dataclass(frozen=True)
class Drive:
    """A scripted vehicle: when it drives, from where, how fast, and its lateral position.

    speed, lateral: functions of time (s, arrays) to m/s and m left of the base lane.
    """

    vehicle: str
    start_m: float = 0.0
    speed: float | Callable[[Array], Array] = 30.0
    lateral: float | Callable[[Array], Array] = 0.0
    duration_s: float = 60.0
    begin_s: float = 0.0
    length_m: float = 5.0
    kind: str = "passenger"

    def on(self, road: Road, step_s: float = STEP_S) -> Track:
        first = round(self.begin_s / step_s)
        t = (first + np.arange(round(self.duration_s / step_s) + 1)) * step_s
        speed = self.speed(t) if callable(self.speed) else np.full(len(t), self.speed)
        lateral = self.lateral(t) if callable(self.lateral) else np.full(len(t), self.lateral)
        s = self.start_m + np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * step_s)])
        return road.track(self.vehicle, s, lateral, speed, first, self.length_m, self.kind)


def record(road: Road, *drives: Drive, commands: Sequence[Command] = (), step_s: float = STEP_S) -> Recording:
    """Return the recording of scripted vehicles on a road."""
    return road.recording(*(drive.on(road, step_s) for drive in drives), commands=commands, step_s=step_s)


def sweep(start: float, duration: float, distance: float) -> Callable[[Array], Array]:
    """A move aside by `distance` (m) from `start` (s) on: a sine of acceleration, peak 2 pi distance / duration^2."""

    def move(t: Array) -> Array:
        u = np.clip((t - start) / duration, 0.0, 1.0)
        return np.asarray(distance * (u - np.sin(2 * np.pi * u) / (2 * np.pi)))

    return move


def ramps(*corners: tuple[float, float]) -> Callable[[Array], Array]:
    """A signal that is linear between corners (time in s, value)."""
    at, values = zip(*corners, strict=True)
    return lambda t: np.asarray(np.interp(t, at, values))


def total(*parts: Callable[[Array], Array] | float) -> Callable[[Array], Array]:
    """The sum of signals."""
    return lambda t: np.asarray(sum((p(t) if callable(p) else np.full(len(t), p)) for p in parts))


def thinned(recording: Recording, every: int) -> Recording:
    """Return the recording with only every `every`-th step."""
    tracks = {}
    for name, track in recording.tracks.items():
        skip = -track.first_step % every
        columns = {c: getattr(track, c)[skip::every] for c in ("x", "y", "speed", "lane", "lane_pos", "lane_lat")}
        tracks[name] = replace(track, first_step=(track.first_step + skip) // every, **columns)
    parked = {
        name: tuple((-(-first // every), -(-after // every)) for first, after in stays)
        for name, stays in recording.parked.items()
    }
    return replace(recording, step_s=recording.step_s * every, tracks=tracks, parked=parked)
