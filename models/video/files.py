"""Video files: what they say of themselves, and their frames, each by its number.

Frames are counted by decoding them all in order, because seeking in compressed video is not exact. OpenCV decodes with
the FFmpeg in it; only files that begin as AVI or MP4 do get there, so none that name other files or addresses.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

from isac_cosim.base.arrays import IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.models.video.pairs import IncompleteError

if TYPE_CHECKING:
    import cv2

Image = npt.NDArray[np.uint8]
Taken = TypeVar("Taken")

MOST_HZ = 1000.0
MOST_FRAMES = 10_000_000
MOST_PIXELS = 2**25
"""Of a frame."""
MISSING = "videos need the library OpenCV: pip install '.[video]' in a checkout"


@dataclass(frozen=True)
class Facts:
    """What a video says of itself. frames: their number, which a file that was cut off does not hold."""

    frames: int
    rate_hz: float
    size: tuple[int, int]

    @property
    def duration_s(self) -> float:
        """How long the video is."""
        return self.frames / self.rate_hz


def opencv() -> Any:
    """Return OpenCV, which says nothing on its own and uses one thread. Raises InputError where it is missing."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    try:
        import cv2
    except ImportError:
        raise InputError(MISSING) from None
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    cv2.setNumThreads(1)
    return cv2


def facts_of(path: Path) -> Facts:
    """Return what a video says of itself.

    Raises IncompleteError if there is no such file or it holds no frames, InputError if it is no video, or beyond what
    is read.
    """
    if not path.is_file():
        raise IncompleteError(f"{path}: this view of the event is missing; add it, or leave the pair out")
    cv2 = opencv()
    with _opened(path) as capture:
        frames, rate_hz, width, height = (
            float(capture.get(of))
            for of in (
                cv2.CAP_PROP_FRAME_COUNT, cv2.CAP_PROP_FPS, cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT
            )
        )  # fmt: skip
    if not frames >= 1:
        raise IncompleteError(f"{path}: holds no frames; restore it, or leave the pair out")
    if not (isfinite(rate_hz) and 1 <= rate_hz <= MOST_HZ and frames <= MOST_FRAMES):
        raise InputError(f"{path}: claims {frames:g} frames at {rate_hz:g} a second; convert it to a usual video")
    if not 1 <= width * height <= MOST_PIXELS:
        raise InputError(f"{path}: claims frames of {width:g}x{height:g}; convert it to at most {MOST_PIXELS} pixels")
    return Facts(int(frames), rate_hz, (int(width), int(height)))


def taken_of(
    path: Path,
    facts: Facts,
    tolerance_s: float,
    places_of: Callable[[int], IntArray],
    take: Callable[[Image, Image | None], Taken],
) -> tuple[list[Taken], int]:
    """Return what is taken of some frames of a video, and how many frames it holds.

    places_of: the numbers of those frames from 0, rising, of so many in all. take: called with a frame, (H, W, 3) in
    the order blue, green, red, and with the one before it, once for each different place. tolerance_s: how much the
    video may hold less or more than it says, s. Raises InputError where that is more: the video was cut off.
    """
    told = facts.frames
    for _ in range(2):
        found, held = _pass(path, facts, places_of(told), take)
        if held == told:
            return found, held
        if abs(held - facts.frames) > tolerance_s * facts.rate_hz or not held:
            break
        told = held
    raise InputError(
        f"{path}: holds {held} frames, not the {facts.frames} that it claims: it was cut off or is damaged; restore it"
    )


def _pass(
    path: Path, facts: Facts, places: IntArray, take: Callable[[Image, Image | None], Taken]
) -> tuple[list[Taken], int]:
    """Decode a video once. Returns what was taken, repeated as the places are, and the number of its frames."""
    wanted = set(places.tolist())
    taken: dict[int, Taken] = {}
    before: Image | None = None
    count = 0
    with _opened(path) as capture:
        while capture.grab():
            current = _retrieved(path, capture, facts) if count in wanted or count + 1 in wanted else None
            if count in wanted and current is not None:
                taken[count] = take(current, before)
            before = current
            count += 1
    return [taken[place] for place in places.tolist() if place in taken], count


def _retrieved(path: Path, capture: cv2.VideoCapture, facts: Facts) -> Image:
    """Return the frame that was grabbed last, (H, W, 3)."""
    _, image = capture.retrieve()
    if image is None or image.dtype != np.uint8 or image.shape != (facts.size[1], facts.size[0], 3):
        raise InputError(f"{path}: a frame is damaged, or of another size than the video; convert or restore it")
    return np.asarray(image, dtype=np.uint8)


@contextmanager
def _opened(path: Path) -> Iterator[cv2.VideoCapture]:
    """Open a video. Raises InputError where it is none."""
    cv2 = opencv()
    try:
        with path.open("rb") as file:
            head = file.read(12)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); make it readable") from None
    if not ((head[:4] == b"RIFF" and head[8:] == b"AVI ") or head[4:8] == b"ftyp"):
        raise InputError(f"{path}: is no video in AVI or MP4; convert it")
    capture = cv2.VideoCapture(str(path.absolute()), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    try:
        if not capture.isOpened():
            raise InputError(f"{path}: is no readable video: cut off, damaged or of an unknown codec; restore it")
        yield capture
    finally:
        capture.release()
