"""What an MCAP file holds: a stretch of an episode with all its vehicles, or one record with its TV and UV."""

from __future__ import annotations

from math import inf
from pathlib import Path

import numpy as np

from isac_cosim.base.arrays import Array, ComplexArray, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic import motion
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.road_coordinates import lane_headings
from isac_cosim.labeling.dataset.dataset import Dataset, RoadLane, Sample
from isac_cosim.labeling.dataset.record_point import in_plane
from isac_cosim.labeling.export.scene_log import MCAP_FILE, PATH_HZ, Placed, SceneLog, lanes_near

Span = tuple[float, float]
WHOLE: Span = (-inf, inf)
SIZE_M = 4.5, 1.8
"""Drawn length and width of the vehicles of a single record, whose sizes a dataset does not hold, m."""


def write_stretch(
    recording: Recording,
    scenario: Scenario,
    samples: list[Sample],
    rates_hz: tuple[float, float],
    settings: motion.MotionSettings,
    folder: Path,
    every: int,
    span_s: Span = WHOLE,
) -> tuple[int, int, int]:
    """Write what happens in a recording between two instants: all vehicles, and the records that begin in between.

    rates_hz: of the records' TV and UV states. every: of so many steps one is written, those whose number it divides.
    span_s: s of simulation time. Returns how many states, vehicles and records were written. Raises InputError where no
    vehicle is there, OutputError where the file cannot be written.
    """
    placed: dict[int, list[Placed]] = {}
    vehicles = 0
    for track in recording.tracks.values():
        steps = _steps(track.first_step, len(track), recording.step_s, every, span_s)
        if not len(steps):
            continue
        rows, vehicles = steps - track.first_step, vehicles + 1
        places = motion.positions(recording, track, steps, settings)
        # On the whole track: a lane without extent has the direction of the place before.
        headings = lane_headings(recording.lanes, track.lane, track.lane_pos)[rows]
        _place(placed, steps, places, headings, (track.vehicle, track.length_m, track.width_m))
    if not placed:
        first_s, last_s = span_s
        raise InputError(
            f"--from {first_s:g} --to {last_s:g}: no vehicle of {recording.scenario}, seed {recording.seed}, is there; "
            f"{_there(recording)}"
        )
    inside = [sample for sample in samples if span_s[0] <= sample.t_start <= span_s[1]]
    every_place = np.array([[vehicle.x, vehicle.y] for there in placed.values() for vehicle in there]).T
    lanes = [RoadLane(lane.id, lane.width_m, lane.shape) for lane in recording.lanes]
    with SceneLog.new(folder / MCAP_FILE) as log:
        log.place(min(placed) * recording.step_s, lanes_near(lanes, every_place), scenario.sites)
        for step, there in sorted(placed.items()):
            at_s = round(step * recording.step_s, 6)
            now = [sample for sample in inside if sample.t_start <= at_s <= _end_s(sample, rates_hz[0])]
            log.vehicles(at_s, there, {sample.tv_id for sample in now}, {sample.uv_id for sample in now})
        states = sum(len(there) for there in placed.values()) + sum(log.record(sample, rates_hz) for sample in inside)
    return states, vehicles, len(inside)


def write_single(dataset: Dataset, sample: Sample, folder: Path) -> int:
    """Write a record with its TV and UV into a folder. Returns how many states were written. Raises OutputError."""
    rates_hz = dataset.meta.tv_rate_hz, dataset.meta.uv_rate_hz
    placed: dict[int, list[Placed]] = {}
    for vehicle, relative, rate_hz in zip(
        (sample.tv_id, sample.uv_id), (sample.tv_truth, sample.uv), rates_hz, strict=True
    ):
        states = in_plane(relative, sample.x0, sample.y0)[:, :: max(1, round(rate_hz / PATH_HZ))]
        headings = states[2] + 1j * states[3]
        _place(placed, np.arange(states.shape[1]), states[:2], headings, (vehicle, *SIZE_M))
    places = np.array([[vehicle.x, vehicle.y] for there in placed.values() for vehicle in there]).T
    with SceneLog.new(folder / MCAP_FILE) as log:
        near = lanes_near(dataset.roads(sample.scenario), places)
        log.place(sample.t_start, near, dataset.sites(sample.scenario))
        for step, there in placed.items():
            log.vehicles(round(sample.t_start + step / PATH_HZ, 6), there, {sample.tv_id}, {sample.uv_id})
        return log.record(sample, rates_hz)


def _place(
    placed: dict[int, list[Placed]],
    steps: IntArray,
    places: Array,
    headings: ComplexArray,
    vehicle: tuple[str, float, float],
) -> None:
    """Put a vehicle, with its id, length and width, m, where it is at some steps."""
    for step, x, y, heading in zip(steps.tolist(), *places.tolist(), np.angle(headings).tolist(), strict=True):
        placed.setdefault(step, []).append(Placed(vehicle[0], x, y, heading, *vehicle[1:]))


def _steps(first: int, count: int, step_s: float, every: int, span_s: Span) -> IntArray:
    """Return those of so many steps from the first one on that are written."""
    steps = np.arange(-(-first // every) * every, first + count, every)
    return steps[(steps * step_s >= span_s[0] - 1e-9) & (steps * step_s <= span_s[1] + 1e-9)]


def _end_s(sample: Sample, rate_hz: float) -> float:
    return float(sample.t_start + (sample.tv.shape[1] - 1) / rate_hz)


def _there(recording: Recording) -> str:
    """Say when vehicles are there."""
    if not recording.tracks:
        return "there is none at any time"
    first = min(track.first_step for track in recording.tracks.values()) * recording.step_s
    last = max(track.first_step + len(track) for track in recording.tracks.values()) * recording.step_s
    return f"there are some from {first:g} to {last:g} s"
