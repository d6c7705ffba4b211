"""Scenes for Foxglove: the library's own reader finds in a file what was recorded, and nothing half-written stays."""

from __future__ import annotations

import errno
import json
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cosim
from isac_cosim.base.errors import InputError, OutputError
from isac_cosim.base.workers.kept_workers import KeptWorkers
from isac_cosim.isacsim.traffic import motion
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.dataset.dataset import STATE, Dataset
from isac_cosim.labeling.dataset.record_point import in_plane
from isac_cosim.labeling.export.exporting import export_episode, export_sample
from isac_cosim.labeling.generation.recorded_again import Recorder
from tests.labeling.export.conftest import EPISODE

pytest.importorskip("mcap", reason="the extra mcap is not installed")

from mcap.reader import make_reader
from mcap.writer import Writer

Messages = dict[str, list[tuple[float, Any]]]


def read(folder: Path) -> Messages:
    """What a file says on each topic, with the time of each message, s. A message has what its schema promises."""
    messages: Messages = defaultdict(list)
    with (folder / "scene.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            content = json.loads(message.data)
            assert schema is not None
            assert content.keys() == json.loads(schema.data)["properties"].keys()
            messages[channel.topic].append((message.log_time / 1e9, content))
    return messages


def entities(messages: Messages, topic: str) -> dict[str, Any]:
    """What is drawn on a topic, by its name."""
    return {entity["id"]: entity for _, update in messages[topic] for entity in update["entities"]}


def front(cube: Any) -> complex:
    """Where the front bumper of a drawn vehicle is."""
    turn, place = cube["pose"]["orientation"], cube["pose"]["position"]
    forward = complex(turn["w"], turn["z"]) ** 2
    return complex(place["x"], place["y"]) + cube["size"]["x"] / 2 * forward


def test_a_stretch_holds_the_vehicles_where_they_were(
    dataset: Dataset, recording: Recording, tmp_path: Path, one_worker: KeptWorkers
) -> None:
    samples = dataset.samples(dataset.meta.shards[0])
    to_s = 0.5 * round(2.0 * sorted(sample.t_start for sample in samples)[len(samples) // 2]) - 0.5
    done = export_episode(dataset, EPISODE, "mcap", tmp_path / "out", one_worker, 0.5, span_s=(42.0, to_s))
    messages, settings = read(tmp_path / "out"), Recorder.of(dataset).study.motion
    drawn = messages["/vehicles"]
    assert [at_s for at_s, _ in drawn] == np.arange(42.0, to_s + 0.1, 0.5).tolist()
    for at_s, update in drawn[::10]:
        (entity,) = update["entities"]
        step = np.array([round(at_s / recording.step_s)])
        there = [t for t in recording.tracks.values() if t.first_step <= step[0] < t.first_step + len(t)]
        places = [complex(*motion.positions(recording, track, step, settings)[:, 0]) for track in there]
        np.testing.assert_allclose([front(cube) for cube in entity["cubes"]], places, atol=1e-6)
        assert [cube["size"]["x"] for cube in entity["cubes"]] == [track.length_m for track in there]
    shown = [sample for sample in samples if 42.0 <= sample.t_start <= to_s]
    assert 0 < done.samples == len(shown) < len(samples)
    assert {message["name"] for _, message in messages["/events"]} == {sample.sample_id for sample in shown}
    sites = [name for name in entities(messages, "/place") if name.startswith("site ")]
    assert len(sites) == len(dataset.sites("motorway"))


def test_the_target_and_the_own_vehicle_are_named_while_their_record_lasts(
    dataset: Dataset, tmp_path: Path, one_worker: KeptWorkers
) -> None:
    sample = dataset.samples(dataset.meta.shards[0])[0]
    span_s = sample.t_start - 1.0, sample.t_start + 6.5
    export_episode(dataset, EPISODE, "mcap", tmp_path / "out", one_worker, 0.5, span_s=span_s)
    named = {
        at_s: {text["text"] for text in update["entities"][0]["texts"]}
        for at_s, update in read(tmp_path / "out")["/vehicles"]
    }
    for at_s, texts in named.items():
        if sample.t_start <= at_s <= sample.t_start + 4.99:
            assert {f"TV {sample.tv_id}", f"UV {sample.uv_id}"} <= texts | {f"TV {sample.uv_id}"}
    assert any(named.values())


def test_a_record_is_in_the_file_number_for_number(dataset: Dataset, tmp_path: Path) -> None:
    sample = dataset.samples(dataset.meta.shards[0])[-1]
    done = export_sample(dataset, sample.sample_id, tmp_path / "out", "mcap")
    messages = read(tmp_path / "out")
    sides = {"tv_sensed": sample.tv, "tv_true": sample.tv_truth, "uv_reported": sample.uv}
    for side, stored in sides.items():
        states = messages[f"/records/{sample.sample_id}/{side}"]
        values = np.array([[state[name] for name in STATE] for _, state in states]).T
        np.testing.assert_array_equal(values, in_plane(stored, sample.x0, sample.y0))
        times = [at_s for at_s, _ in states]
        np.testing.assert_allclose(np.diff(times), 5.0 / stored.shape[1], atol=1e-6)
        assert times[0] == pytest.approx(sample.t_start)
    assert done.states == sum(stored.shape[1] for stored in sides.values())
    events = {message["message"].rpartition(": ")[2]: at_s for at_s, message in messages["/events"]}
    moments = sample.t_start, sample.t_onset, sample.t_commit, sample.t_end
    assert list(events) == ["record begins", "onset", "commit", "end"]
    assert [*events.values()] == pytest.approx(moments, abs=1e-6)
    paths = entities(messages, "/paths")
    assert list(paths) == [f"{sample.sample_id} {side}" for side in sides]
    drawn = [[point["x"], point["y"]] for point in paths[f"{sample.sample_id} tv_true"]["lines"][0]["points"]]
    np.testing.assert_allclose(drawn, in_plane(sample.tv_truth, sample.x0, sample.y0)[:2, ::16].T)
    assert len(messages["/vehicles"]) == 125


def test_the_command_says_what_it_wrote(dataset: Dataset, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    name = dataset.samples(dataset.meta.shards[0])[0].sample_id
    assert cosim.main(["export", str(dataset.path), "--sample", name, "--mcap", "-o", f"{tmp_path}/out", "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["states"] == 4500
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["scene.mcap"]


def test_without_the_library_it_says_how_to_get_it(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    with pytest.raises(InputError, match=r"--mcap needs the library mcap: pip install '\.\[mcap\]'"):
        export_sample(dataset, dataset.samples(dataset.meta.shards[0])[0].sample_id, tmp_path / "out", "mcap")
    assert not any(tmp_path.iterdir())


def test_a_full_disk_leaves_nothing(dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Writer, "finish", full)
    with pytest.raises(OutputError, match=r"scene\.mcap: cannot be written \(No space left on device\)"):
        export_sample(dataset, dataset.samples(dataset.meta.shards[0])[0].sample_id, tmp_path / "out", "mcap")
    assert not any(tmp_path.iterdir())
