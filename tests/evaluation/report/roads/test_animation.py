"""The animation: as many frames as a record has, in real time; vehicles move, and nothing is told beforehand."""

from __future__ import annotations

import errno
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError, OutputError
from isac_cosim.evaluation.report.figures import BLUE, CYCLE, GREY, ORANGE
from isac_cosim.evaluation.report.replay.content import AnswersAlong, Maneuver, Moving, Replay, VehicleNear, at_rate
from isac_cosim.evaluation.report.roads.animation import animate
from tests.evaluation.report.replay.test_content import drive

CLASSES = ("hard_brake", "left_lane_change", "right_lane_change", "overtake", "hard_accel", "evasive_swerve")


def moving() -> Moving:
    """A TV, a UV 40 m ahead of it in the same lane, and a vehicle that stands aside until 2 s."""
    truth = at_rate(drive(30.0), 400.0)[:, :61]
    answers = AnswersAlong(0.8, 0.04, np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0], (41, 1)), "overtake", False)
    other = VehicleNear("o", "car", 4.5, 1.8, 0.0, 0.2, truth[:, :51:5] + [[0.0], [7.0]])
    uv = truth + np.array([[40.0], [0.0]])
    did = [Maneuver("overtake", 1.0, 2.0)]
    return Moving(
        "a", "overtake", "natural", "tv", "uv", 0.0, did, truth, truth + 0.3, uv, others=[other], answers=answers
    )


@pytest.fixture(scope="module")
def shown() -> Replay:
    line = np.array([[49_000.0, 0.0], [51_000.0, 0.0]])
    return Replay("Episode", [moving()], [(3.6, line)], [("s", 5e4, 10.0, 90.0)], CLASSES)


@pytest.fixture(scope="module")
def picture(shown: Replay, tmp_path_factory: pytest.TempPathFactory) -> Image.Image:
    path = tmp_path_factory.mktemp("animation") / "moving.gif"
    assert animate(shown, shown.records, path) == 31
    return Image.open(path)


def colored(picture: Image.Image, frame: int, color: str, rows: slice) -> Array:
    """The places on a frame, pixels to the right, that have a colour."""
    picture.seek(frame)
    pixels = np.asarray(picture.convert("RGB"), dtype=int)[rows]
    wanted = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
    return np.flatnonzero((np.abs(pixels - wanted).max(axis=2) < 24).any(axis=0))


ROAD, BELOW = slice(20, 250), slice(260, 440)


def test_it_plays_in_real_time_and_holds_the_end(picture: Image.Image) -> None:
    durations = []
    for frame in range(picture.n_frames):  # type: ignore[attr-defined]
        picture.seek(frame)
        durations.append(picture.info["duration"])
    assert picture.info["loop"] == 0
    assert sum(durations[:-1]) == 30 * 80
    assert durations[-1] == 1500


def test_the_own_vehicle_is_ahead_and_others_are_there_as_long_as_they_are_known(picture: Image.Image) -> None:
    tv, uv = colored(picture, 10, BLUE, ROAD), colored(picture, 10, ORANGE, ROAD)
    assert len(tv)
    assert uv.min() > tv.max()
    assert len(colored(picture, 10, GREY, ROAD)) > len(colored(picture, 30, GREY, ROAD))


def test_answers_appear_as_they_are_given(picture: Image.Image) -> None:
    def drawn(frame: int) -> int:
        return len(colored(picture, frame, CYCLE[3], BELOW))

    assert drawn(30) > drawn(20) + 50
    assert drawn(20) > drawn(10) + 50


@pytest.mark.slow
def test_a_webp_is_written_as_well(shown: Replay, tmp_path: Path) -> None:
    path = tmp_path / "moving.webp"
    animate(shown, shown.records, path)
    with Image.open(path) as read:
        assert (read.format, read.n_frames) == ("WEBP", 31)  # type: ignore[attr-defined]


def test_what_cannot_be_written_is_one_line(shown: Replay, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"is not the name of an animation; let it end in \.webp or \.gif"):
        animate(shown, shown.records, tmp_path / "moving.png")
    with pytest.raises(InputError, match="Episode: has no record to animate"):
        animate(shown, [], tmp_path / "moving.gif")

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Image.Image, "save", full)
    with pytest.raises(OutputError, match="No space left on device"):
        animate(shown, shown.records, tmp_path / "moving.gif")
    assert not any(tmp_path.iterdir())
