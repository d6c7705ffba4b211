"""Writes recordings in the format of exiD and inD, centres and headings of boxes; no reader has a part in it."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from isac_cosim.isacsim.traffic.recordings.recording import Recording

COLUMNS = ("recordingId", "trackId", "frame", "trackLifetime", "xCenter", "yCenter", "heading", "width", "length",
           "xVelocity", "yVelocity", "laneletId", "leftLeadId")  # fmt: skip
META = ("recordingId", "trackId", "initialFrame", "finalFrame", "numFrames", "width", "length", "class")
RECORDING = ("recordingId", "locationId", "frameRate", "duration", "numTracks", "xUtmOrigin", "yUtmOrigin",
             "orthoPxToMeter")  # fmt: skip


def write_exid(
    folder: Path, recording: Recording, every: int = 4, utm: tuple[float, float] = (0.0, 0.0), walkers: int = 1
) -> dict[str, str]:
    """Write a recording; return the names of its vehicles in the file, by their names in the recording.

    utm: origin of the coordinates, m. walkers: pedestrians, who have no size. every: of so many steps, one is written.
    """
    names: dict[str, str] = {}
    rows: list[list[object]] = []
    metas: list[list[object]] = []
    for name, track in recording.tracks.items():
        at = np.arange(-track.first_step % every, len(track), every)
        if len(at) < 2:
            continue
        names[name] = str(len(names))
        vx, vy = (np.gradient(values, recording.step_s) for values in (track.x, track.y))
        heading = np.degrees(np.arctan2(vy, vx))
        if np.hypot(vx, vy).min() < 0.1:  # a standing vehicle keeps its heading
            heading = np.full(len(track), heading[np.hypot(vx, vy).argmax()])
        heading = np.round(heading % 360.0, 4)
        x, y = (
            np.round(values - track.length_m / 2.0 * turn(np.radians(heading)), 5)
            for values, turn in ((track.x, np.cos), (track.y, np.sin))
        )
        frames = (track.first_step + at) // every
        for k, frame in zip(at.tolist(), frames.tolist(), strict=True):
            box = (x[k], y[k], heading[k], track.width_m, track.length_m, round(vx[k], 5), round(vy[k], 5))
            rows.append([3, names[name], frame, frame - frames[0], *box, "12;13", "-1"])
        kind = "truck" if track.length_m > 6.5 else "car"
        metas.append([3, names[name], frames[0], frames[-1], len(frames), track.width_m, track.length_m, kind])
    for k in range(walkers):
        rows += [[3, 9000 + k, frame, frame, 5.0, 60.0, 90.0, 0.0, 0.0, 0.0, 1.0, "", "-1"] for frame in range(50)]
        metas.append([3, 9000 + k, 0, 49, 50, 0.0, 0.0, "pedestrian"])
    content = {
        "tracks": (COLUMNS, rows),
        "tracksMeta": (META, metas),
        "recordingMeta": (RECORDING, [[3, 1, 100.0 / every, 45.0, len(metas), *utm, 0.1]]),
    }
    folder.mkdir(parents=True, exist_ok=True)
    for kind, (header, lines) in content.items():
        with (folder / f"03_{kind}.csv").open("w", newline="") as out:
            writer = csv.writer(out, lineterminator="\n")
            writer.writerow(header)
            writer.writerows(lines)
    return names
