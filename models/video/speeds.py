"""The speed of the vehicle in every frame: read from the files beside the videos, filled in, and smoothed.

Nothing of later enters a frame: gaps are filled with the last speed before them, and means are over the past. A clip
that is cut short, to predict ahead, is then as if it had been recorded so.
"""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

import numpy as np

from isac_cosim.base.arrays import Array, Float32Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.stored.errors import READ_ERRORS, reason_of
from isac_cosim.models.video.pairs import IncompleteError

MOST_FILE_BYTES = 100_000_000
MOST_UNPACKED_BYTES = 500_000_000
MOST_SPEED = 1000.0
COMPRESSED = b"\x0f\x00\x00\x00"
"""How a compressed part of a MATLAB file begins."""
MATLAB_HEADER, LITTLE_ENDIAN = b"MATLAB 5.0", b"IM"


def read_speeds(path: Path) -> Array:
    """Return the speed of each frame, (n,), in the unit of the file; NaN where it is not known.

    A text has a line for each frame, in which the speed comes first, before a comma if more follows (Brain4Cars, as
    converted by others: speed, lane, lanes, intersection); the first line may be the heading `speed`. A MATLAB file is
    one of Brain4Cars: `params.frame_data{k}.speed` from `params.frame_start` to `params.frame_end`. -1, nan and nothing
    stand for unknown. Raises IncompleteError where there is no such file, InputError where it is damaged or holds
    something else.
    """
    if not path.is_file():
        raise IncompleteError(f"{path}: the speeds of the frames are missing; give them, or leave the pair out")
    if path.stat().st_size > MOST_FILE_BYTES:
        raise InputError(f"{path}: has more than {MOST_FILE_BYTES} bytes, too many for speeds; give the right file")
    try:
        values = _of_matlab(path) if path.suffix.lower() == ".mat" else _of_text(path)
    except MemoryError:
        raise
    except (*READ_ERRORS, NotImplementedError) as error:
        raise InputError(f"{path}: is no readable file of speeds ({reason_of(error)}); restore it") from None
    values = np.where(values == -1, np.nan, values)
    known = values[~np.isnan(values)]
    if not len(values) or not (np.abs(known) <= MOST_SPEED).all() or (known < 0).any():
        raise InputError(f"{path}: holds no speeds from 0 to {MOST_SPEED:g}, with -1 for unknown; correct it")
    return values


def speeds_at(speeds: Array, frames: int, places: IntArray, per_mean: int, known: float, where: Path) -> Float32Array:
    """Return the smoothed speeds of the frames of a clip, (T,).

    speeds: (n,), spread evenly over the video. frames: number of frames of the video. places: which of them the clip
    takes, (T,), rising. per_mean: number of frames of the clip that a mean is over. known: least share of the clip's
    frames whose speed has to be known. Raises IncompleteError, which names `where`, if fewer are.
    """
    taken = speeds[np.minimum((places + 0.5) * len(speeds) / frames, len(speeds) - 1).astype(np.int64)]
    unknown = np.isnan(taken)
    if 1 - unknown.mean() < known:
        raise IncompleteError(
            f"{where}: the speed is unknown in {unknown.sum()} of the clip's {len(taken)} frames; leave the pair out"
        )
    last = np.maximum.accumulate(np.where(unknown, -1, np.arange(len(taken))))
    filled = taken[np.where(last < 0, np.flatnonzero(~unknown)[0], last)]
    sums = np.concatenate([[0.0], np.cumsum(filled)])
    begin = np.maximum(np.arange(len(filled)) + 1 - max(1, per_mean), 0)
    end = np.arange(1, len(filled) + 1)
    return np.asarray((sums[end] - sums[begin]) / (end - begin), dtype=np.float32)


def _of_text(path: Path) -> Array:
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    cells = [line.partition(",")[0].strip() for line in lines]
    if cells and cells[0] == "speed":
        cells = cells[1:]
    return np.array([float(cell) if cell else np.nan for cell in cells], dtype=np.float64)


def _of_matlab(path: Path) -> Array:
    from scipy.io import loadmat

    _check_unpacked(path)
    params: Any = loadmat(path, variable_names=["params"])["params"][0, 0]
    first, last = (int(params[name].item()) for name in ("frame_start", "frame_end"))
    frames = params["frame_data"].ravel()
    if not 1 <= first <= last <= len(frames):
        raise ValueError(f"frame_start {first} and frame_end {last} of {len(frames)} frames")
    return np.array([_speed(frame) for frame in frames[first - 1 : last]], dtype=np.float64)


def _speed(frame: Any) -> float:
    """Return the speed in the data of a frame; NaN where there is none."""
    if frame.dtype.names is None or "speed" not in frame.dtype.names or not frame.size:
        return float("nan")
    speed = np.asarray(frame["speed"].ravel()[0], dtype=np.float64)
    return float(speed.item()) if speed.size else float("nan")


def _check_unpacked(path: Path) -> None:
    """Raise ValueError if the compressed parts of a MATLAB file hold more than is read, or it is of another version."""
    content = path.read_bytes()
    if not content.startswith(MATLAB_HEADER) or content[126:128] != LITTLE_ENDIAN:
        raise ValueError("it is not of MATLAB's version 5 to 7")
    at, total = 128, 0
    while at + 8 <= len(content):
        size = int.from_bytes(content[at + 4 : at + 8], "little")
        if content[at : at + 4] == COMPRESSED:
            packed = content[at + 8 : at + 8 + size]
            total += len(zlib.decompressobj().decompress(packed, MOST_UNPACKED_BYTES - total + 1))
        if total > MOST_UNPACKED_BYTES:
            raise ValueError(f"it unpacks to more than {MOST_UNPACKED_BYTES} bytes")
        at += 8 + size
