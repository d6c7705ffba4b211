"""`clips`: what it is given, what it says, and that `reproduce` takes what it makes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import cosim
from isac_cosim.models.data.clips import load_clips
from isac_cosim.studies.reproduction.reproduce import reproduce, request
from tests.support.made_up_videos import write_event
from tests.support.scripted import InlineEngine

EVENT = "20141019_091035_1_26"


@pytest.fixture
def videos(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """One event of 5 s at 5 frames a second."""
    monkeypatch.setattr("isac_cosim.command_line.options.engine_of", lambda *_: InlineEngine())
    write_event(tmp_path / "videos", "rchange", EVENT, 25, rate_hz=5)
    return tmp_path / "videos"


@pytest.mark.slow
def test_a_folder_of_videos_becomes_clips_of_the_papers_size(
    videos: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    words = ["clips", str(videos), "-o", str(tmp_path / "clips"), "--driver-cut", "64x64+8+0", "--json"]
    (videos / "face_camera/lturn" / EVENT).mkdir(parents=True)
    assert cosim.main(words) == 2
    assert f"road_camera/lturn/{EVENT}.avi: this view of the event is missing" in capfd.readouterr().err
    assert cosim.main([*words, "--complete-only"]) == 0
    out, err = capfd.readouterr()
    said = json.loads(out)
    assert (said["clips"], list(said["left_out"])) == (1, [f"lturn-{EVENT}"])
    assert "warning: features of the road are of a ResNet-18 with random weights, a floor; give --road-weights" in err
    assert "warning: features of the driver are of a MobileFaceNet with random weights" in err
    assert f"left out: lturn-{EVENT}: " in err
    (clip,) = load_clips(tmp_path / "clips", 5)
    assert (clip.inner.shape, clip.outer.shape, clip.label, clip.background) == ((150, 65), (150, 33), 3, 0)
    wanted = request("castformer", tmp_path / "out", stages=["data"], clips=tmp_path / "clips")
    page = reproduce(wanted, InlineEngine()).page.read_text()
    assert "Features of the road and driver are of networks with random weights: a floor" in page


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--driver-cut", "64"], "--driver-cut 64: give width and height as 900x800"),
        (["--driver-cut", "64x64+1"], "--driver-cut 64x64+1: give width and height"),
        (["--driver-cut", "0x64"], "--driver-cut 0x64: give width and height"),
        (["--driver-cut", "64x64+99999+0"], "give width and height"),
        ([], "frames of 96x64 do not hold 900x800 pixels of the driver; say with --driver-cut what to take"),
        (["--driver-cut", "64x64+40+0"], "do not hold 64x64 pixels of the driver at 40,0; say with --driver-cut"),
        (["--driver-cut", "64x64", "--road-weights", "nowhere"], "nowhere: no such file; give the weights"),
    ],
)
def test_wrong_arguments(
    videos: Path, tmp_path: Path, words: list[str], message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert cosim.main(["clips", str(videos), "-o", str(tmp_path / "clips"), *words]) == 2
    assert message in capfd.readouterr().err
    assert not (tmp_path / "clips").exists()
