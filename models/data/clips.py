"""Feature files of clips, for features that were extracted elsewhere, such as those of Brain4Cars.

A folder of clips holds one `.npz` file per clip, without pickled objects:

    in      (T, W) float   features of the inside stream, one row per frame; 65 wide for Brain4Cars, the speed last
    out     (T, V) float   features of the outside stream at the same frames; 33 wide for Brain4Cars, the speed last
    label   ()     int     number of the class, from 0
    background  () int     optional: number of the class that is no maneuver (driving straight on), -1 for none

T can differ between clips, W and V cannot, nor can the background. Clips are read in the order of their file names.

`clips.json` beside them, if there is one, is of `cosim clips`, which made them from videos (`models.video`).
"""

from __future__ import annotations

import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt
from pydantic import JsonValue

from isac_cosim.base.arrays import Float32Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.seeding import stream
from isac_cosim.base.settings import Sealed, read_json
from isac_cosim.base.stored.arrays import read_arrays

KEYS = ("in", "out", "label")
BACKGROUND = "background"
NO_BACKGROUND = -1
"""In place of the number of a class, where every class is a maneuver."""
MANIFEST = "clips.json"
View = Literal["road", "driver"]
"""The views of a pair of videos: `out` and `in` of a clip."""


class Extraction(Sealed):
    """What `cosim clips` writes beside the clips that it makes from videos.

    finished: whether all of them are there. random: views whose network has random weights, so that its features are a
    floor. made: settings, weights, sizes of the videos, and versions of the libraries, the same for all clips. clips:
    digests of the videos and speeds of each, and the begin of its maneuver. left_out: pairs that are no clips, and why.
    """

    sealed_since: ClassVar[int] = 1

    schema_version: Literal[1] = 1
    finished: bool
    random: list[View]
    made: dict[str, JsonValue]
    clips: dict[str, list[str]]
    left_out: dict[str, str]


@dataclass(frozen=True)
class Clip:
    """One clip: inner (T, W), outer (T, V) and the number of its class.

    background: number of the class that is no maneuver, NO_BACKGROUND if there is none; None where its file is silent.
    """

    name: str
    inner: Float32Array
    outer: Float32Array
    label: int
    background: int | None = None


@dataclass(frozen=True)
class ClipBatch:
    """Clips of one length: inner (N, L, W), outer (N, L, V), label (N,)."""

    inner: Float32Array
    outer: Float32Array
    label: IntArray

    @property
    def speed(self) -> Float32Array:
        """The last feature of the outside stream, (N, L, 1)."""
        return self.outer[:, :, -1:]


def load_clips(folder: str | Path, n_classes: int) -> list[Clip]:
    """Read all clips of a folder. Raises InputError if there are none, or one does not follow the format."""
    files = sorted(Path(folder).glob("*.npz"))
    if not files:
        raise InputError(f"{folder}: no .npz files in it; name the folder of the clips")
    _check_finished(Path(folder), files)
    clips = [read_clip(file, n_classes) for file in files]
    widths = (clips[0].inner.shape[1], clips[0].outer.shape[1])
    for file, clip in zip(files, clips, strict=True):
        clip_widths = (clip.inner.shape[1], clip.outer.shape[1])
        if clip_widths != widths:
            raise InputError(
                f"{file}: {clip_widths[0]} and {clip_widths[1]} features per frame, others have {widths[0]} and "
                f"{widths[1]}; extract all clips alike"
            )
        if clip.background != clips[0].background:
            raise InputError(
                f"{file}: background is {_spoken(clip.background)}, but {_spoken(clips[0].background)} in "
                f"{files[0].name}; say the same in all clips"
            )
    return clips


def extraction_in(folder: Path) -> Extraction | None:
    """Return what `cosim clips` says of the clips in a folder; None where they were made otherwise."""
    return read_json(Extraction, folder / MANIFEST)


def _check_finished(folder: Path, files: list[Path]) -> None:
    """Raise InputError where `cosim clips` has yet to make some of the clips, or others have come or gone since."""
    made = extraction_in(folder)
    if made is None:
        return
    if not made.finished:
        raise InputError(f"{folder}: its clips are not all made; run the same `cosim clips` again")
    if odd := {file.stem for file in files} ^ made.clips.keys():
        raise InputError(
            f"{folder / min(odd)}.npz: {MANIFEST} and the folder differ in this clip; run the same `cosim clips` again"
        )


def _spoken(background: int | None) -> str:
    return "not given" if background is None else str(background)


def read_clip(file: Path, n_classes: int) -> Clip:
    """Read one clip. Raises InputError if the file does not follow the format."""
    try:
        stored = read_arrays(file)
        inner, outer, label = (stored[key] for key in KEYS)
    except KeyError:
        raise InputError(f"{file}: a clip holds the arrays in, out and label; add what is missing") from None
    except (OSError, RuntimeError, ValueError, EOFError, zipfile.BadZipFile, zlib.error):
        raise InputError(f"{file}: not readable as .npz without pickled objects; save it with numpy.savez") from None
    inner, outer = _stream(file, "in", inner), _stream(file, "out", outer)
    if len(inner) != len(outer):
        raise InputError(f"{file}: {len(inner)} frames inside and {len(outer)} outside; give the same frames of both")
    if label.shape != () or label.dtype.kind not in "iu" or not 0 <= label < n_classes:
        raise InputError(f"{file}: label {label.tolist()} is not a class; give an integer from 0 to {n_classes - 1}")
    background = stored.get(BACKGROUND)
    if background is not None and (
        background.shape != () or background.dtype.kind not in "iu" or not NO_BACKGROUND <= background < n_classes
    ):
        raise InputError(
            f"{file}: background {background.tolist()} is not a class; give an integer from 0 to {n_classes - 1}, or "
            f"{NO_BACKGROUND} for none"
        )
    return Clip(file.stem, inner, outer, int(label), None if background is None else int(background))


def batch(clips: list[Clip], length: int, *keys: str | int) -> ClipBatch:
    """Return clips with `length` frames each, evenly spaced over the clip.

    keys: if given, one frame is drawn at random from each of `length` even parts; they name the draw, as for
    `base.seeding.stream`, and a clip's frames depend on them and on its name alone.
    """
    chosen = [frames(len(clip.inner), length, stream("clip", *keys, clip.name) if keys else None) for clip in clips]
    return ClipBatch(
        np.stack([clip.inner[at] for clip, at in zip(clips, chosen, strict=True)]),
        np.stack([clip.outer[at] for clip, at in zip(clips, chosen, strict=True)]),
        np.array([clip.label for clip in clips], dtype=np.int64),
    )


def frames(count: int, length: int, rng: np.random.Generator | None = None) -> IntArray:
    """Return which of `count` frames are taken, (length,), rising: the middle of each part, or a random one."""
    place = np.full(length, 0.5) if rng is None else rng.random(length)
    return np.floor((np.arange(length) + place) * (count / length)).astype(np.int64)


def _stream(file: Path, name: str, values: npt.NDArray[Any]) -> Float32Array:
    """Return a stream as float32. Raises InputError if it is not a table of finite numbers."""
    if values.ndim != 2 or not values.size or values.dtype.kind not in "fiu" or not np.isfinite(values).all():
        raise InputError(f"{file}: {name} is not a table of finite numbers, frames by features; fix the extraction")
    return values.astype(np.float32)
