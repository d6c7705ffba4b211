"""From videos to pictures: which frames a clip takes, and what the networks see of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from isac_cosim.models.video.extraction import check, clip_of
from isac_cosim.models.video.files import Facts, facts_of
from isac_cosim.models.video.pairs import VideoPair, pairs_in
from isac_cosim.models.video.pictures import driver_pictures, places_of, road_pictures
from isac_cosim.models.video.settings import VideoSettings
from tests.support.made_up_videos import BRIGHTER, SMALL, driver_images, road_images, step_of, write_speeds, write_video


def pair_of(folder: Path, count: int, rate_hz: float = 30, maneuver_s: float | None = None) -> VideoPair:
    road = write_video(folder / "road.avi", road_images(count), rate_hz)
    driver = write_video(folder / "driver.avi", driver_images(count), rate_hz)
    return VideoPair("a", 1, road, driver, write_speeds(folder / "speed.txt", range(count)), maneuver_s)


def frame_numbers(pictures: np.ndarray) -> list[int]:
    """The numbers of the frames that pictures of the driver show, by their brightness."""
    return np.round((pictures.mean(axis=(1, 2, 3)) + 1) * 127.5 / BRIGHTER).astype(int).tolist()


def test_a_clip_of_the_papers_rate_takes_every_frame_once() -> None:
    facts = Facts(150, 30.0, (720, 480))
    assert places_of(150, facts, None, VideoSettings()).tolist() == list(range(150))
    assert places_of(151, facts, None, VideoSettings()).tolist() == list(range(1, 151))


@pytest.mark.parametrize(("rate_hz", "count"), [(30, 45), (25, 40), (60, 62), (12, 14)])
def test_a_frame_is_the_one_on_screen_in_its_part_of_the_clip(tmp_path: Path, rate_hz: float, count: int) -> None:
    pair, settings = pair_of(tmp_path, count, rate_hz), SMALL.model_copy(update={"frames": 30})
    shown = frame_numbers(driver_pictures(pair, facts_of(pair.driver), settings)[0])
    middles_s = [count / rate_hz - 1 + (k + 0.5) / 30 for k in range(30)]
    assert all(n / rate_hz <= t + 1e-6 < (n + 1) / rate_hz + 2e-6 for n, t in zip(shown, middles_s, strict=True))


def test_a_clip_ends_at_the_maneuver(tmp_path: Path) -> None:
    pair, settings = pair_of(tmp_path, 60, maneuver_s=1.5), SMALL.model_copy(update={"frames": 30})
    assert frame_numbers(driver_pictures(pair, facts_of(pair.driver), settings)[0]) == list(range(15, 45))


@pytest.mark.parametrize(("rate_hz", "count"), [(30, 32), (15, 16), (30, 30)])
def test_flow_is_the_motion_into_a_frame_in_one_frame_of_the_clip(tmp_path: Path, rate_hz: float, count: int) -> None:
    pair, settings = pair_of(tmp_path, count, rate_hz), SMALL.model_copy(update={"frames": 30})
    facts = facts_of(pair.road)
    flow = road_pictures(pair, facts, settings)
    assert flow.shape == (30, 3, 32, 48)
    frames = np.maximum(places_of(count, facts, None, settings), 1)
    expected = np.array([step_of(k) for k in frames]) * (48 / 96) * (rate_hz / 30)
    np.testing.assert_allclose(np.median(flow[:, 0], axis=(1, 2)), expected, atol=0.12)
    np.testing.assert_allclose(np.median(flow[:, 1], axis=(1, 2)), 0, atol=0.05)
    np.testing.assert_allclose(flow[:, 2], np.hypot(flow[:, 0], flow[:, 1]), rtol=1e-5)


def test_both_streams_and_the_speed_are_of_the_same_frames(tmp_path: Path) -> None:
    settings = SMALL.model_copy(update={"frames": 30, "speed_mean_s": 0.0})
    checked = check(pair_of(tmp_path, 45), settings)

    def see(view: str) -> object:
        if view == "road":
            return lambda pictures: np.median(pictures[:, 0], axis=(1, 2))[:, None]
        return lambda pictures: np.array(frame_numbers(pictures))[:, None]

    clip = clip_of(checked, settings, see)  # type: ignore[arg-type]
    assert clip["in"][:, 0].tolist() == list(range(15, 45))
    assert clip["in"][:, 1].tolist() == clip["out"][:, 1].tolist() == list(range(15, 45))
    np.testing.assert_allclose(clip["out"][:, 0], [step_of(k) / 2 for k in range(15, 45)], atol=0.12)


def test_the_driver_is_cut_out_where_it_is_told(tmp_path: Path) -> None:
    image = np.zeros((64, 96, 3), dtype=np.uint8)
    image[10:26, 40:56] = (0, 0, 255)  # red
    video = write_video(tmp_path / "driver.avi", [image] * 30)
    pair = VideoPair("a", 0, video, video, tmp_path / "speed")
    cut = SMALL.model_copy(update={"driver_cut": (16, 16), "driver_corner": (40, 10)})
    inside = driver_pictures(pair, facts_of(video), cut)[0]
    assert inside.shape == (10, 3, 112, 112)
    np.testing.assert_allclose(np.median(inside, axis=(0, 2, 3)), [1, -1, -1], atol=0.1)
    outside = SMALL.model_copy(update={"driver_cut": (16, 16), "driver_corner": (0, 40)})
    np.testing.assert_allclose(np.median(driver_pictures(pair, facts_of(video), outside)[0]), -1, atol=0.1)


def test_mp4_is_read_as_avi_is(tmp_path: Path) -> None:
    write_video(tmp_path / "road.mp4", road_images(30), codec="mp4v")
    write_video(tmp_path / "driver.mp4", driver_images(30), codec="mp4v")
    write_speeds(tmp_path / "speed.csv", range(30))
    (tmp_path / "clips.csv").write_text("name,label,road,driver,speed\na,rturn,road.mp4,driver.mp4,speed.csv\n")
    (pair,) = pairs_in(tmp_path)
    assert pair.label == 4
    shown = frame_numbers(driver_pictures(pair, facts_of(pair.driver), SMALL)[0])
    # The codec loses three steps of brightness at the begin: less than one frame.
    np.testing.assert_allclose(shown, places_of(30, facts_of(pair.driver), None, SMALL), atol=1)
