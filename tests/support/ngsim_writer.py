"""Writes recordings of a straight road in the format of NGSIM; no reader has a part in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from isac_cosim.isacsim.traffic.recordings.recording import Recording

COLUMNS = ("Vehicle_ID", "Frame_ID", "Total_Frames", "Global_Time", "Local_X", "Local_Y", "Global_X", "Global_Y",
           "v_Length", "v_Width", "v_Class", "v_Vel", "v_Acc", "Lane_ID", "Preceding", "Following", "Space_Hdwy",
           "Time_Hdwy")  # fmt: skip
EPOCH_MS = 1118846980200
LEFT_EDGE_M, START_M = 7.2, -800.0
"""Of the bundled straight road: y of its left edge, and x of its start."""

Row = dict[str, float | int | str]


def straight(along: np.ndarray) -> np.ndarray:
    return np.zeros_like(along)


def ngsim_rows(
    recording: Recording,
    first_id: int = 1,
    later_ms: int = 0,
    frames_from: int = 0,
    bend: Callable[[np.ndarray], np.ndarray] = straight,
    noise_m: float = 0.0,
    every: int = 10,
) -> tuple[list[Row], dict[str, str]]:
    """Return the rows of a recording, and the numbers of its vehicles by name.

    later_ms, frames_from: what is added to the times and taken from the frames. bend: how far the road has gone to the
    left at a distance along it, m.
    """
    rng = np.random.default_rng(7)
    rows: list[Row] = []
    names: dict[str, str] = {}
    for name, track in recording.tracks.items():
        at = np.arange(-track.first_step % every, len(track), every)
        if len(at) < 4:
            continue
        names[name] = str(first_id + len(names))
        noise = rng.normal(0.0, noise_m, (2, len(at))) if noise_m else np.zeros((2, len(at)))
        along = track.x[at] - START_M
        across = LEFT_EDGE_M - (track.y[at] + noise[1] + bend(along))
        along = along + noise[0]
        frames = (track.first_step + at) // every
        kind = 3 if track.length_m > 6.5 else 2
        rows += [
            {
                "Vehicle_ID": int(names[name]), "Frame_ID": frame - frames_from, "Total_Frames": len(at),
                "Global_Time": EPOCH_MS + frame * every * 10 + later_ms, "Local_X": round(across[k] / 0.3048, 3),
                "Local_Y": round(along[k] / 0.3048, 3), "Global_X": 6451137.641, "Global_Y": 1873344.962,
                "v_Length": round(track.length_m / 0.3048, 2), "v_Width": round(track.width_m / 0.3048, 2),
                "v_Class": kind, "v_Vel": round(float(track.speed[at[k]]) / 0.3048, 2), "v_Acc": 0.0,
                "Lane_ID": 4 - int(track.lane[at[k]]), "Preceding": 0, "Following": 0, "Space_Hdwy": 0.0,
                "Time_Hdwy": 0.0,
            }
            for k, frame in enumerate(frames.tolist())
        ]  # fmt: skip
    return rows, names


def write_txt(path: Path, rows: Sequence[Row]) -> Path:
    """Columns without a header, with blanks between them."""
    path.write_text("\n".join(" ".join(f"{row[name]:>12}" for name in COLUMNS) for row in rows) + "\n")
    return path


def write_csv(path: Path, rows: Sequence[Row], places: Sequence[str] = (), order: Sequence[int] | None = None) -> Path:
    """Columns with a header; with the place of each row where `places` names them, in the spelling of that file."""
    header = [name.replace("v_Length", "v_length").replace("Hdwy", "Headway") for name in COLUMNS]
    lines = [",".join([*header, *(["Location"] if places else [])])]
    lines += [
        ",".join([*(str(rows[k][name]) for name in COLUMNS), *([places[k]] if places else [])])
        for k in (order if order is not None else range(len(rows)))
    ]
    path.write_text("\n".join(lines) + "\n")
    return path
