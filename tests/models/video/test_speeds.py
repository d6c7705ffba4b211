"""Speeds: what is read, what is refused, how they are smoothed, and that none is of later."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from isac_cosim.base.errors import InputError
from isac_cosim.models.video import speeds as module
from isac_cosim.models.video.pairs import IncompleteError
from isac_cosim.models.video.speeds import read_speeds, speeds_at


def write_params(path: Path, speeds: list[Any], first: int = 1, **changed: Any) -> Path:
    """As Brain4Cars has them: a struct with a cell of structs."""
    frames = np.empty((1, len(speeds)), dtype=object)
    for k, speed in enumerate(speeds):
        frames[0, k] = np.zeros((0, 0)) if speed is None else {"speed": float(speed), "box": np.zeros(4)}
    content = {"frame_start": first, "frame_end": len(speeds), "laneInfo": "1,2,0", "frame_data": frames} | changed
    savemat(path, {"params": content}, do_compression=True)
    return path


def test_the_speeds_of_brain4cars_are_read(tmp_path: Path) -> None:
    values = read_speeds(write_params(tmp_path / "params.mat", [None, 7, 30.5, -1, None, 40], first=2))
    np.testing.assert_array_equal(values, [7, 30.5, np.nan, np.nan, 40])


def test_speeds_are_read_from_a_text(tmp_path: Path) -> None:
    file = tmp_path / "speed.csv"
    file.write_text("speed\n3\n-1\n\n4.5,1,2,0\n")
    np.testing.assert_array_equal(read_speeds(file), [3, np.nan, np.nan, 4.5])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "holds no speeds"),
        ("fast\n", "is no readable file of speeds"),
        ("3\n-2\n", "holds no speeds from 0"),
        ("3\ninf\n", "holds no speeds from 0"),
        (b"\xff\xfe3", "is no readable file"),
    ],
)
def test_other_texts_are_refused(tmp_path: Path, content: str | bytes, message: str) -> None:
    file = tmp_path / "speed.csv"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=rf"speed\.csv: {message}"):
        read_speeds(file)


@pytest.mark.parametrize(
    "changed", [{"frame_start": 0}, {"frame_end": 9}, {"frame_data": 3.0}, {"frame_start": "a"}, {"frame_start": []}]
)
def test_other_matlab_files_are_refused(tmp_path: Path, changed: dict[str, Any]) -> None:
    file = write_params(tmp_path / "params.mat", [1, 2, 3], **changed)
    with pytest.raises(InputError, match=r"params\.mat: "):
        read_speeds(file)


def test_damaged_matlab_files_are_refused(tmp_path: Path) -> None:
    content = write_params(tmp_path / "params.mat", [1.0] * 30).read_bytes()
    file = tmp_path / "damaged.mat"
    for cut in (
        b"",
        content[:100],
        content[: len(content) // 2],
        b"MATLAB 7.3" + content[10:],
        content[:-40] + bytes(40),
    ):
        file.write_bytes(cut)
        with pytest.raises(InputError, match=r"damaged\.mat: is no readable file of speeds"):
            read_speeds(file)


def test_a_matlab_file_that_unpacks_to_too_much_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = write_params(tmp_path / "params.mat", [1, 2], box=np.zeros(100_000))
    assert file.stat().st_size < 5_000
    read_speeds(file)
    monkeypatch.setattr(module, "MOST_UNPACKED_BYTES", 100_000)
    with pytest.raises(InputError, match="it unpacks to more than 100000 bytes"):
        read_speeds(file)


def test_a_missing_file_makes_a_pair_incomplete(tmp_path: Path) -> None:
    with pytest.raises(IncompleteError, match="speeds of the frames are missing"):
        read_speeds(tmp_path / "params.mat")


def test_speeds_are_means_over_the_past(tmp_path: Path) -> None:
    speeds = np.random.default_rng(0).uniform(0, 30, 40)
    places = np.arange(10, 40)
    smoothed = speeds_at(speeds, 40, places, 6, 0.5, tmp_path)
    expected = [np.mean([speeds[m] for m in range(max(10, n - 5), n + 1)]) for n in places]
    np.testing.assert_allclose(smoothed, expected, rtol=1e-6)
    later = np.where(np.arange(40) > 25, 99.0, speeds)
    np.testing.assert_array_equal(speeds_at(later, 40, places, 6, 0.5, tmp_path)[:16], smoothed[:16])


def test_unknown_speeds_are_the_last_known_ones(tmp_path: Path) -> None:
    speeds = np.array([np.nan, np.nan, 4, np.nan, np.nan, 7, 8, 9])
    taken = speeds_at(speeds, 8, np.arange(8), 1, 0.5, tmp_path)
    assert taken.tolist() == [4, 4, 4, 4, 4, 7, 8, 9]
    with pytest.raises(IncompleteError, match=r"unknown in 4 of the clip's 8 frames"):
        speeds_at(speeds, 8, np.arange(8), 1, 0.6, tmp_path)


def test_as_many_speeds_as_the_video_has_frames_or_nearly(tmp_path: Path) -> None:
    assert speeds_at(np.arange(31.0), 30, np.arange(30), 1, 1.0, tmp_path).tolist() == pytest.approx(range(30), abs=1)
