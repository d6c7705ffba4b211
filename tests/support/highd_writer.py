"""Writes recordings of a straight road in the format of highD; no reader has a part in it."""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.generation.settings import DatasetStudy

TRACK_COLUMNS = ("frame", "id", "x", "y", "width", "height", "xVelocity", "yVelocity", "laneId")
META_COLUMNS = ("id", "width", "height", "initialFrame", "finalFrame", "numFrames", "class", "drivingDirection")


@lru_cache(maxsize=2)
def straight_recording(seed: int = 1) -> Recording:
    """45 s of the bundled straight road, whose lanes lie along the x axis, with reactions and commanded maneuvers."""
    study = DatasetStudy.model_validate({"traffic": {"run_in_s": 40.0, "duration_s": 45.0}})
    return motion_source(study).record(load("straight_road"), seed)


@dataclass(frozen=True)
class Image:
    """How a camera sees a carriageway. left_m: x of the image's left edge in the plane, m. down_m: how far below the
    upper edge of the image y = 0 is, m. turned: whether the carriageway is seen driving leftward."""

    left_m: float
    down_m: float
    turned: bool

    def x(self, forward: np.ndarray) -> np.ndarray:
        return self.left_m - forward if self.turned else forward - self.left_m

    def y(self, leftward: np.ndarray) -> np.ndarray:
        return self.down_m + leftward if self.turned else self.down_m - leftward


UPPER, LOWER = Image(2000.0, 12.0, turned=True), Image(-800.0, 36.0, turned=False)


def image_id(name: str, numbers: dict[str, int]) -> int:
    """Number the vehicles as they come, from 1."""
    return numbers.setdefault(name, len(numbers) + 1)


def write_highd(
    folder: Path, upper: Recording | None, lower: Recording, every: int = 4, decimals: int = 2, noise_m: float = 0.0
) -> dict[str, int]:
    """Write one recording for each direction; return the numbers of the vehicles, by direction and name.

    every: of so many steps, one is written.
    """
    rng = np.random.default_rng(7)
    numbers: dict[str, int] = {}
    rows: list[list[object]] = []
    metas: list[list[object]] = []
    for half, recording, image in (("upper", upper, UPPER), ("lower", lower, LOWER)):
        for name, track in recording.tracks.items() if recording else ():
            at = np.arange(-track.first_step % every, len(track), every)
            if not len(at):
                continue
            number = image_id(f"{half}/{name}", numbers)
            front, y = image.x(track.x), image.y(track.y)
            vx, vy = np.gradient(front, recording.step_s), np.gradient(y, recording.step_s)
            noise = rng.normal(0.0, noise_m, (2, len(front))) if noise_m else np.zeros((2, len(front)))
            corner_x = front + noise[0] - (0.0 if image.turned else track.length_m)
            corner_y = y + noise[1] - track.width_m / 2.0
            frames = (track.first_step + at) // every + 1
            for k, frame in zip(at.tolist(), frames.tolist(), strict=True):
                corner = (round(float(corner_x[k]), decimals), round(float(corner_y[k]), decimals))
                speed = (round(float(vx[k]), 2), round(float(vy[k]), 2))
                rows.append([frame, number, *corner, track.length_m, track.width_m, *speed, int(track.lane[k]) + 2])
            kind = "Truck" if track.length_m > 6.5 else "Car"
            span = (frames[0], frames[-1], len(frames))
            metas.append([number, track.length_m, track.width_m, *span, kind, 1 if image.turned else 2])
    lanes = lower.lanes
    borders = np.array([lane.shape[0, 1] - lane.width_m / 2 for lane in lanes] + [lanes[-1].shape[0, 1] + 1.8])
    markings = [";".join(f"{y:.2f}" for y in sorted(image.y(borders).tolist())) for image in (UPPER, LOWER)]
    recording_meta = [[7, 25 * 4 // every, 2, 36.11, "11.2017", "Tue", "08:38", 45.0, *markings]]
    columns = ("id", "frameRate", "locationId", "speedLimit", "month", "weekDay", "startTime", "duration",
               "upperLaneMarkings", "lowerLaneMarkings")  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    for kind, header, content in (
        ("tracks", TRACK_COLUMNS, rows),
        ("tracksMeta", META_COLUMNS, metas),
        ("recordingMeta", columns, recording_meta),
    ):
        with (folder / f"07_{kind}.csv").open("w", newline="") as out:
            writer = csv.writer(out, lineterminator="\n")
            writer.writerow(header)
            writer.writerows(content)
    return numbers


def renamed(recording: Recording, numbers: dict[str, int], half: str, every: int = 4) -> Recording:
    """Return a recording with the file's numbers of its vehicles, and with times that count frames from 1."""
    tracks = {
        (number := str(numbers[f"{half}/{name}"])): replace(track, vehicle=number, first_step=track.first_step + every)
        for name, track in recording.tracks.items()
        if f"{half}/{name}" in numbers
    }
    return replace(recording, tracks=tracks)
