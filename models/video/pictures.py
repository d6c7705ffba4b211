"""What the networks see of a frame: the optical flow of the road, and the driver's picture.

Flow is measured by DIS (Kroeger et al., ECCV 2016; OpenCV). The paper measures it with RAFT, a trained network whose
weights are not published with it; DIS is the floor beneath that.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from isac_cosim.base.arrays import Float32Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.models.video.files import Facts, Image, opencv, taken_of
from isac_cosim.models.video.pairs import IncompleteError, VideoPair
from isac_cosim.models.video.settings import VideoSettings


def places_of(frames: int, facts: Facts, end_s: float | None, settings: VideoSettings) -> IntArray:
    """Return which frames of a video a clip takes, (T,), rising: those shown in the middle of its T equal parts.

    frames: that the video holds. end_s: end of the clip, s of the video; None for that of the video.
    """
    end_s = frames / facts.rate_hz if end_s is None else end_s
    middles_s = end_s - settings.clip_s + (np.arange(settings.frames) + 0.5) / settings.rate_hz
    # A time that is a frame's begin but for rounding is that frame's.
    return np.asarray(np.clip(np.floor(middles_s * facts.rate_hz + 1e-6), 0, frames - 1), dtype=np.int64)


def check_span(path: Path, facts: Facts, end_s: float | None, settings: VideoSettings) -> None:
    """Raise IncompleteError unless a video holds the whole clip."""
    end_s = facts.duration_s if end_s is None else end_s
    if end_s < settings.clip_s - settings.tolerance_s:
        raise IncompleteError(
            f"{path}: shows {end_s:.2f} s before the maneuver, a clip {settings.clip_s:g} s; leave the pair out"
        )
    if end_s > facts.duration_s + settings.tolerance_s:
        raise IncompleteError(
            f"{path}: ends at {facts.duration_s:.2f} s, before the maneuver at {end_s:.2f} s; leave the pair out"
        )
    if facts.frames < 2:
        raise IncompleteError(f"{path}: has one frame, and flow needs two; leave the pair out")


def road_pictures(pair: VideoPair, facts: Facts, settings: VideoSettings) -> Float32Array:
    """Return the flow into each frame of a clip, (T, 3, H, W): to the right, down, and its length.

    In pixels of the resulting picture, in one frame of a clip. The first frame of a video has the flow of the second.
    """
    cv2 = opencv()
    dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    at_once = facts.rate_hz / settings.rate_hz / np.divide(settings.flow_size, settings.road_size)

    def grey(image: Image) -> Any:
        plain = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        return cv2.resize(plain, settings.flow_size, interpolation=cv2.INTER_AREA)

    def take(image: Image, before: Image | None) -> Float32Array:
        assert before is not None
        flow = dis.calc(grey(before), grey(image), None)
        right, down = np.moveaxis(cv2.resize(flow, settings.road_size, interpolation=cv2.INTER_AREA) * at_once, -1, 0)
        return np.stack([right, down, np.hypot(right, down)]).astype(np.float32)

    def places(frames: int) -> IntArray:
        return np.maximum(places_of(frames, facts, pair.maneuver_s, settings), 1)

    return _stacked(pair.road, taken_of(pair.road, facts, settings.tolerance_s, places, take)[0])


def driver_pictures(pair: VideoPair, facts: Facts, settings: VideoSettings) -> tuple[Float32Array, IntArray, int]:
    """Return the driver in each frame of a clip, (T, 3, S, S) in red, green, blue from -1 to 1.

    Also returns which frames of the video these are, (T,), and how many it holds. A picture is cut out and resized;
    no face is looked for.
    """
    cv2 = opencv()
    left, top = driver_corner(pair.driver, facts, settings)
    width, height = settings.driver_cut
    size = (settings.driver_size, settings.driver_size)

    def take(image: Image, before: Image | None) -> Float32Array:
        cut = cv2.cvtColor(image[top : top + height, left : left + width], cv2.COLOR_BGR2RGB)
        picture = cv2.resize(cut, size, interpolation=cv2.INTER_AREA)
        return np.asarray(np.moveaxis(picture, -1, 0) / 127.5 - 1, dtype=np.float32)

    def places(frames: int) -> IntArray:
        return places_of(frames, facts, pair.maneuver_s, settings)

    taken, held = taken_of(pair.driver, facts, settings.tolerance_s, places, take)
    return _stacked(pair.driver, taken), places(held), held


def driver_corner(path: Path, facts: Facts, settings: VideoSettings) -> tuple[int, int]:
    """Return the upper left corner of what is cut out of the driver's view. Raises InputError where it is too small."""
    (width, height), (of_width, of_height) = settings.driver_cut, facts.size
    left, top = settings.driver_corner or ((of_width - width) // 2, (of_height - height) // 2)
    if left < 0 or top < 0 or left + width > of_width or top + height > of_height:
        raise InputError(
            f"{path}: frames of {of_width}x{of_height} do not hold {width}x{height} pixels of the driver"
            f"{f' at {left},{top}' if settings.driver_corner else ''}; say with --driver-cut what to take"
        )
    return left, top


def _stacked(path: Path, pictures: list[Float32Array]) -> Float32Array:
    """Return pictures as one array. Raises InputError where they are not finite."""
    stacked = np.stack(pictures)
    if not np.isfinite(stacked).all():
        raise InputError(f"{path}: its optical flow is not finite; restore the video, or leave the pair out")
    return stacked
