"""`generate` from recordings of drivers: a dataset, and a picture of its road beside it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import cosim
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.streams.dataset import Streams
from tests.support.highd_writer import straight_recording, write_highd
from tests.support.scripted import InlineEngine


@pytest.mark.slow
def test_a_recording_becomes_a_dataset_with_a_picture_of_its_road(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("isac_cosim.base.workers.engine.LocalEngine", lambda *_: InlineEngine())
    numbers = write_highd(tmp_path / "highd", straight_recording(2), straight_recording(1))
    words = ["generate", str(tmp_path / "highd"), "--source", "levelx", "-o", str(tmp_path / "data")]
    assert cosim.main([*words, "--json"]) == 0
    captured = capfd.readouterr()
    result = json.loads(captured.out.splitlines()[-1])
    assert result["samples"] > 5
    assert "07_tracks.csv: 117 vehicles" in captured.err
    picture = tmp_path / "data" / "roads" / "07.png"
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "the road, its sites and the first vehicles" in captured.err
    dataset = Dataset.open(tmp_path / "data")
    samples = [sample for shard in dataset.meta.shards for sample in dataset.samples(shard)]
    assert {sample.source for sample in samples} == {"levelx"}
    assert {sample.scenario for sample in samples} == {"07"}
    assert {sample.origin for sample in samples} == {"natural"}
    assert {sample.tv_id for sample in samples} <= set(numbers_of(numbers))
    # The same command finds it finished, and the picture as it was.
    before = picture.stat().st_mtime_ns
    assert cosim.main(words) == 0
    assert picture.stat().st_mtime_ns == before
    # What the file says of its speeds is in the dataset, for people and as JSON.
    capfd.readouterr()
    assert cosim.main(["inspect", str(tmp_path / "data"), "--json"]) == 0
    captured = capfd.readouterr()
    (told,) = (
        line
        for line in json.loads(captured.out.splitlines()[-1])["remarks"]["07"]
        if "its speeds differ from those" in line
    )
    assert f"07: {told}" in captured.err.splitlines()


def numbers_of(numbers: dict[str, int]) -> list[str]:
    return [str(number) for number in numbers.values()]


@pytest.mark.slow
def test_a_recording_becomes_streams_with_the_same_picture(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("isac_cosim.base.workers.engine.LocalEngine", lambda *_: InlineEngine())
    numbers = write_highd(tmp_path / "highd", None, straight_recording(1))
    words = ["generate", str(tmp_path / "highd"), "--source", "levelx", "--streams", "-o", str(tmp_path / "streams")]
    assert cosim.main([*words, "--json"]) == 0
    captured = capfd.readouterr()
    assert json.loads(captured.out.splitlines()[-1])["vehicle_hours"] > 0.0
    picture = tmp_path / "streams" / "roads" / "07.png"
    assert picture.read_bytes().startswith(b"\x89PNG")
    streams = Streams.open(tmp_path / "streams")
    streams.verify()
    (facts, stretches) = next(iter(streams.read()))
    assert (facts.scenario, facts.seed) == ("07", 1)
    assert {stretch.tv_id for stretch in stretches} <= set(numbers_of(numbers))


def test_a_folder_without_a_source_is_a_scenario(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write_highd(tmp_path / "highd", None, straight_recording(1))
    assert cosim.main(["generate", str(tmp_path / "highd"), "-o", str(tmp_path / "data")]) == 2
    assert "has no SUMO configuration (.sumocfg) and no network" in capfd.readouterr().err.replace("\n", " ")
    assert cosim.main(["generate", str(tmp_path), "--source", "levelx", "-o", str(tmp_path / "data")]) == 2
    assert "has no recording; name the tracks of each" in capfd.readouterr().err.replace("\n", " ")
