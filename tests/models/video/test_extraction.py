"""From a folder of videos to clips that CaSTFormer reads: what is kept, what goes on, and what is refused."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from isac_cosim.base import landlock
from isac_cosim.base.errors import InputError
from isac_cosim.models.data.clips import Extraction, extraction_in, load_clips
from isac_cosim.models.predictors.castformer import CastformerSettings
from isac_cosim.models.video import encoders, extraction
from isac_cosim.models.video.extraction import Weights, extract_clips
from isac_cosim.models.video.pairs import ACTIONS
from isac_cosim.models.video.settings import VideoSettings
from isac_cosim.studies.clip_validation import ClipSettings, background_of, cross_validate
from tests.support.made_up_videos import SMALL, driver_images, road_images, write_event, write_speeds, write_video
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.scripted import InlineEngine

EVENTS = ("20141019_091035_1_31", "20141019_091136_63_93")


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two events of every action, as Brain4Cars has them."""
    videos = tmp_path_factory.mktemp("videos")
    for action in ACTIONS:
        for event in EVENTS:
            write_event(videos, action, event)
    return videos


@pytest.fixture(scope="module")
def few(published: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two of them."""
    videos = tmp_path_factory.mktemp("few")
    for view in ("face_camera", "road_camera"):
        shutil.copytree(published / view / "lturn", videos / view / "lturn")
    return videos


@pytest.fixture
def videos(published: Path, tmp_path: Path) -> Path:
    """A copy that a test may change."""
    return Path(shutil.copytree(published, tmp_path / "videos"))


def extract(
    videos: Path, out: Path, settings: VideoSettings = SMALL, feedback: RecordedFeedback | None = None, **more: Any
) -> Extraction:
    weights = more.pop("weights", Weights())
    return extract_clips(videos, out, settings, weights, InlineEngine(), feedback or RecordedFeedback(), **more)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_castformer_is_trained_on_clips_of_videos(published: Path, tmp_path: Path) -> None:
    done = extract(published, tmp_path / "clips")
    assert done.finished
    assert done.random == ["road", "driver"]
    assert len(done.clips) == 10
    clips = load_clips(tmp_path / "clips", len(ACTIONS))
    assert [clip.name for clip in clips] == [f"{action}-{event}" for action in ACTIONS for event in EVENTS]
    assert [clip.label for clip in clips] == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]
    assert {clip.inner.shape for clip in clips} == {(10, 65)}
    assert {clip.outer.shape for clip in clips} == {(10, 33)}
    # The speed is the number of the frame: 1, 4 ... 28, of which each clip has the means so far.
    means = [np.mean(range(1, 3 * k + 2, 3)) for k in range(10)]
    for clip in clips:
        np.testing.assert_allclose(clip.inner[:, -1], means, rtol=1e-6)
        np.testing.assert_array_equal(clip.outer[:, -1], clip.inner[:, -1])
    tiny = CastformerSettings(width=8, heads=2, encoder_layers=1, intent_source="out")
    settings = ClipSettings(castformer=tiny, frames=4, folds=2, epochs=1, background=background_of(clips, None))
    assert settings.background == 0
    assert np.sum(cross_validate(clips, settings).confusion) == 10


def test_the_same_videos_give_the_same_bytes(few: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        extract(few, tmp_path / name)
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    extract(few, tmp_path / "c", SMALL.model_copy(update={"seed": 1}))
    assert contents(tmp_path / "a").keys() == contents(tmp_path / "c").keys()
    first = f"lturn-{EVENTS[0]}.npz"
    assert contents(tmp_path / "a")[first] != contents(tmp_path / "c")[first]


class StoppedError(Exception):
    """Stands for Ctrl-C."""


def interrupt(done: float, total: float) -> None:
    if done == 1:
        raise StoppedError


def test_an_interrupted_command_goes_on_to_the_same_bytes(few: Path, tmp_path: Path) -> None:
    out = tmp_path / "clips"
    with pytest.raises(StoppedError):
        extract(few, out, feedback=RecordedFeedback(on_move=interrupt))
    (kept,) = out.glob("*.npz")
    with pytest.raises(InputError, match="clips are not all made; run the same `cosim clips` again"):
        load_clips(out, 5)
    before_ns = kept.stat().st_mtime_ns
    (out / ".123-lturn.npz").write_bytes(b"of a killed command")
    feedback = RecordedFeedback()
    extract(few, out, feedback=feedback)
    assert feedback.moves == [(0, 2), (1, 2), (2, 2)]
    assert kept.stat().st_mtime_ns == before_ns
    extract(few, tmp_path / "whole")
    assert contents(out) == contents(tmp_path / "whole")
    kept.write_bytes(kept.read_bytes()[:-30])
    extract(few, out)
    assert contents(out) == contents(tmp_path / "whole")


def test_a_clip_whose_videos_have_changed_is_made_again(few: Path, tmp_path: Path) -> None:
    videos, out = Path(shutil.copytree(few, tmp_path / "videos")), tmp_path / "clips"
    extract(videos, out)
    before = contents(out)
    speeds = videos / "face_camera/lturn" / EVENTS[0] / "car_state.txt"
    write_speeds(speeds, [7.0] * 30)
    extract(videos, out)
    changed = {name for name, content in contents(out).items() if content != before[name]}
    assert changed == {"clips.json", f"lturn-{EVENTS[0]}.npz"}
    assert load_clips(out, 5)[0].inner[:, -1].tolist() == [7.0] * 10


def test_other_settings_and_foreign_files_need_another_folder(videos: Path, tmp_path: Path) -> None:
    out = tmp_path / "clips"
    extract(videos, out)
    before = contents(out)
    with pytest.raises(InputError, match="made with other settings; choose another folder"):
        extract(videos, out, SMALL.model_copy(update={"seed": 1}))
    shutil.rmtree(videos / "face_camera/rturn")
    shutil.rmtree(videos / "road_camera/rturn")
    with pytest.raises(InputError, match=rf"rturn-{EVENTS[0]}\.npz: is no clip of these videos"):
        extract(videos, out)
    assert contents(out) == before
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis/thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match="is not empty and holds no clips"):
        extract(videos, tmp_path / "thesis")


def test_clips_that_came_or_went_since_are_refused(few: Path, tmp_path: Path) -> None:
    extract(few, tmp_path / "clips")
    (tmp_path / "clips" / f"lturn-{EVENTS[0]}.npz").unlink()
    with pytest.raises(InputError, match=rf"lturn-{EVENTS[0]}\.npz: clips\.json and the folder differ in this clip"):
        load_clips(tmp_path / "clips", 5)


def road(videos: Path) -> Path:
    return videos / "road_camera/lturn" / f"{EVENTS[0]}.avi"


def driver(videos: Path) -> Path:
    return videos / "face_camera/lturn" / EVENTS[0] / f"video_{EVENTS[0]}.avi"


def cut_off(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def playlist(path: Path) -> None:
    path.write_text("#EXTM3U\n#EXTINF:1,\nhttp://127.0.0.1:9/a.avi\n")


DAMAGED: dict[str, tuple[Callable[[Path], object], str]] = {
    "driver cut off": (lambda v: cut_off(driver(v)), r"video_\w+\.avi: holds \d+ frames, not the 30 that it claims"),
    "road cut off": (lambda v: cut_off(road(v)), r"_31\.avi: holds \d+ frames, not the 30 that it claims"),
    "header alone": (lambda v: road(v).write_bytes(road(v).read_bytes()[:300]), r"_31\.avi: is no readable video"),
    "no video": (lambda v: road(v).write_text("a text"), r"_31\.avi: is no video in AVI or MP4"),
    "playlist": (lambda v: playlist(road(v)), r"_31\.avi: is no video in AVI or MP4"),
    "of another size": (
        lambda v: write_video(driver(v), driver_images(30, (128, 96))), r"video_\w+\.avi: frames of 128x96, where"
    ),
    "too small": (
        lambda v: write_video(driver(v), driver_images(30, (64, 48))), "frames of 64x48 do not hold 64x64 pixels"
    ),
    "foreign action": (lambda v: (v / "face_camera/uturn").mkdir(), "face_camera/uturn: is none of end_action"),
    "foreign name": (lambda v: (v / "face_camera/lturn/a b").mkdir(), "'a b' cannot be the name of a clip"),
    "nothing": (lambda v: shutil.rmtree(v / "face_camera"), r"holds neither clips\.csv nor the folders"),
    "speeds": (lambda v: write_speeds(driver(v).parent / "car_state.txt", []), r"car_state\.txt: holds no speeds"),
}  # fmt: skip
INCOMPLETE: dict[str, tuple[Callable[[Path], object], str]] = {
    "without road": (lambda v: road(v).unlink(), rf"road_camera/lturn/{EVENTS[0]}\.avi: this view of the event is"),
    "without driver": (lambda v: driver(v).unlink(), r"video_\w+\.avi: this view of the event is missing"),
    "without speeds": (lambda v: (driver(v).parent / "car_state.txt").unlink(), r"params_\w+\.mat: the speeds of"),
    "speeds unknown": (
        lambda v: write_speeds(driver(v).parent / "car_state.txt", [-1] * 30), "speed is unknown in 10 of the clip's 10"
    ),
    "speeds of others": (
        lambda v: write_speeds(driver(v).parent / "car_state.txt", [1] * 20), "holds the speeds of 20 frames, and the"
    ),
    "too short": (lambda v: write_video(road(v), road_images(20)), r"_31\.avi: shows 0\.67 s before the maneuver"),
    "apart": (lambda v: write_video(road(v), road_images(40)), r"is 1\.00 s, the view of the road 1\.33 s"),
}  # fmt: skip


@pytest.mark.parametrize("kind", [*DAMAGED, *INCOMPLETE])
def test_what_is_wrong_is_named(videos: Path, tmp_path: Path, kind: str) -> None:
    spoil, message = (DAMAGED | INCOMPLETE)[kind]
    spoil(videos)
    with pytest.raises(InputError, match=message) as error:
        extract(videos, tmp_path / "clips")
    assert str(error.value).isprintable()
    if "cut off" in kind:  # found only as it is decoded
        made = extraction_in(tmp_path / "clips")
        assert made is not None
        assert not made.finished
    else:
        assert not (tmp_path / "clips").exists()


@pytest.mark.parametrize("kind", INCOMPLETE)
def test_incomplete_events_can_be_left_out(
    videos: Path, tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(extraction, "clip_of", lambda *_: {"in": np.zeros((10, 65)), "out": np.zeros((10, 33))})
    spoil, _ = INCOMPLETE[kind]
    spoil(videos)
    done = extract(videos, tmp_path / "clips", complete_only=True)
    assert list(done.left_out) == [f"lturn-{EVENTS[0]}"]
    assert len(done.clips) == len(load_clips(tmp_path / "clips", 5)) == 9


@pytest.mark.parametrize("kind", [kind for kind in DAMAGED if kind not in ("road cut off", "driver cut off")])
def test_damaged_files_cannot(videos: Path, tmp_path: Path, kind: str) -> None:
    spoil, message = DAMAGED[kind]
    spoil(videos)
    with pytest.raises(InputError, match=message):
        extract(videos, tmp_path / "clips", complete_only=True)


def test_a_video_without_frames_is_incomplete(videos: Path, tmp_path: Path) -> None:
    import cv2

    road(videos).unlink()
    cv2.VideoWriter(str(road(videos)), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"MJPG"), 30, (96, 64)).release()
    with pytest.raises(InputError, match=r"_31\.avi: holds no frames"):
        extract(videos, tmp_path / "clips")


ROW = "a,lturn,r.avi,d.avi,s.txt,"


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            "name,label\na,lturn\n",
            r"clips\.csv: its columns have to be name, label, road, driver, speed, and",
        ),
        ("name,label,road,driver,speed,maneuvers\n", "its columns have to be"),
        (f"{{}}{ROW}\n{ROW.upper()}", r"line 3: label 'LTURN' is none of end_action"),
        (f"{{}}{ROW}\n{ROW}", "two clips are called a"),
        ("{}", "holds no pairs of videos"),
        ("{}a,lturn,r.avi\n", "line 2: has 3 cells, not 6"),
        ("{}a,5,r.avi,d.avi,s.txt,", "line 2: label '5' is none of"),
        ("{}../a,4,r.avi,d.avi,s.txt,", r"line 2: '\.\./a' cannot be the name of a clip"),
        ("{}a,4,../r.avi,d.avi,s.txt,", r"line 2: '\.\./r\.avi' is no file in the folder of the videos"),
        ("{}a,4,r.avi,/d.avi,s.txt,", r"line 2: '/d\.avi' is no file in the folder"),
        ("{}a,4,r.avi,d.avi,..\\s.txt,", "is no file in the folder"),
        ("{}a,4,http://a/b.avi,d.avi,s.txt,", "is no file in the folder"),
        ("{}a,4,r.avi,d.avi,,", "line 2: '' is no file in the folder"),
        ("{}a,4,r.avi,d.avi,s.txt,soon", "line 2: maneuver_s 'soon' is no time after"),
        ("{}a,4,r.avi,d.avi,s.txt,nan", "line 2: maneuver_s 'nan' is no time after"),
        ('{}"a', "is no readable table"),
        ("\xff", r"clips\.csv: is no readable table"),
    ],
)
def test_wrong_tables_are_refused(tmp_path: Path, table: str, message: str) -> None:
    content = table.replace("{}", "name,label,road,driver,speed,maneuver_s\n")
    (tmp_path / "clips.csv").write_bytes(content.encode("latin-1"))
    with pytest.raises(InputError, match=message) as error:
        extract(tmp_path, tmp_path / "clips")
    assert str(error.value).isprintable()


def test_a_table_says_when_the_maneuver_begins(tmp_path: Path) -> None:
    write_video(tmp_path / "r.avi", road_images(60))
    write_video(tmp_path / "d.avi", driver_images(60))
    write_speeds(tmp_path / "s.txt", range(60))
    (tmp_path / "clips.csv").write_text("name,label,road,driver,speed,maneuver_s\na,2,r.avi,d.avi,s.txt,1.5\n")
    extract(tmp_path, tmp_path / "clips", SMALL.model_copy(update={"speed_mean_s": 0.0}))
    (clip,) = load_clips(tmp_path / "clips", 5)
    assert clip.label == 2
    assert clip.inner[:, -1].tolist() == list(range(16, 45, 3))
    (tmp_path / "clips.csv").write_text("name,label,road,driver,speed,maneuver_s\na,2,r.avi,d.avi,s.txt,2.5\n")
    with pytest.raises(InputError, match=r"r\.avi: ends at 2\.00 s, before the maneuver at 2\.50 s"):
        extract(tmp_path, tmp_path / "other")


def test_weights_are_checked_before_any_video_is_read(published: Path, tmp_path: Path) -> None:
    (tmp_path / "weights").write_text("none")
    with pytest.raises(InputError, match="weights: is no readable file of weights"):
        extract(published, tmp_path / "clips", weights=Weights(driver=tmp_path / "weights"))
    assert not (tmp_path / "clips").exists()


def test_weights_that_overflow_are_refused(published: Path, tmp_path: Path) -> None:
    import torch

    state = encoders.ResNet18(32).state_dict()
    state["bn1.running_var"].fill_(-1)
    torch.save(state, tmp_path / "weights")
    with pytest.raises(InputError, match="its features are not finite: the network's weights are damaged"):
        extract(published, tmp_path / "clips", weights=Weights(road=tmp_path / "weights"))


def test_without_opencv_the_extra_is_named(published: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(InputError, match=r"need the library OpenCV: pip install '\.\[video\]' in a checkout"):
        extract(published, tmp_path / "clips")


@pytest.mark.skipif(not landlock.version(), reason="the kernel has no Landlock")
def test_what_decodes_videos_can_write_nowhere(few: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[str] = []

    def confined(name: str, result: Callable[..., Any]) -> Callable[..., Any]:
        def work(*arguments: Any) -> Any:
            tried.append(name)
            with pytest.raises(OSError, match="Permission denied"):
                (tmp_path / "written").write_text("by a decoder")
            return result(*arguments)

        return work

    monkeypatch.setattr(extraction, "check", confined("check", extraction.check))
    monkeypatch.setattr(extraction, "clip_of", confined("clip_of", extraction.clip_of))
    extract(few, tmp_path / "clips")
    assert sorted(tried) == ["check", "check", "clip_of", "clip_of"]
