"""Videos that were never filmed: every frame tells its number, and the road moves by known steps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from isac_cosim.models.video.settings import VideoSettings

SMALL = VideoSettings(frames=10, clip_s=1, driver_cut=(64, 64), flow_size=(96, 64), road_size=(48, 32))
SIZE = (96, 64)
"""Width and height of the videos."""
BRIGHTER = 4
"""Every frame of the driver is so much brighter than the one before it."""
STEPS = (1, 4, 2, 5, 3)
"""The road moves to the right by so many pixels from frame to frame, over and over."""


def write_video(path: Path, images: Iterable[npt.NDArray[np.uint8]], rate_hz: float = 30, codec: str = "MJPG") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = None
    for image in images:
        if writer is None:
            size = image.shape[1], image.shape[0]
            writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*codec), rate_hz, size)
            assert writer.isOpened()
        writer.write(image)
    assert writer is not None
    writer.release()
    return path


def driver_images(count: int, size: tuple[int, int] = SIZE) -> list[npt.NDArray[np.uint8]]:
    """Frame k has the brightness 4 k."""
    return [np.full((size[1], size[0], 3), BRIGHTER * k, dtype=np.uint8) for k in range(count)]


def road_images(count: int, size: tuple[int, int] = SIZE, seed: int = 0) -> list[npt.NDArray[np.uint8]]:
    """A smooth texture; frame k is moved from frame k - 1 by STEPS[k % 5] pixels to the right."""
    moved = np.cumsum([step_of(k) for k in range(count)]) if count else np.zeros(0, int)
    noise = np.random.default_rng(seed).integers(0, 256, (size[1] // 8, (size[0] + 3 * count + 16) // 8, 1))
    wide = cv2.resize(noise.astype(np.uint8), None, fx=8, fy=8, interpolation=cv2.INTER_CUBIC)
    last = int(moved[-1])
    wide = cv2.resize(wide, (max(wide.shape[1], size[0] + last), size[1]))
    return [np.repeat(wide[:, last - x : last - x + size[0], None], 3, axis=2) for x in moved.tolist()]


def step_of(frame: int) -> int:
    """How far the road has moved into a frame, pixels."""
    return STEPS[frame % len(STEPS)]


def write_speeds(path: Path, speeds: Sequence[float]) -> Path:
    """In the form of Brain4Cars' car_state.txt: speed, lane, lanes, intersection."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{speed:g},1,2,0\n" for speed in speeds))
    return path


def write_event(videos: Path, action: str, event: str, count: int = 30, rate_hz: float = 30) -> None:
    """An event of Brain4Cars: both views, and the number of each frame as its speed."""
    write_video(videos / "road_camera" / action / f"{event}.avi", road_images(count, seed=len(event)), rate_hz)
    inside = videos / "face_camera" / action / event
    write_video(inside / f"video_{event}.avi", driver_images(count), rate_hz)
    write_speeds(inside / "car_state.txt", range(count))
