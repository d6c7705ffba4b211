"""The log of a dataset: a line an episode, outside every digest."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import cosim
from isac_cosim.base.errors import OutputError
from isac_cosim.base.workers.kept_workers import KeptWorkers
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.generation import log
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.log import Entry
from isac_cosim.labeling.generation.resense import ResenseSettings, own_sensing, resense
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.scripted import InlineEngine, ScriptedSource, small_study

INLINE = InlineEngine()


def lines(folder: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]


def test_every_episode_leaves_a_line(tmp_path: Path, one_worker: KeptWorkers) -> None:
    """One is made at once, one in the second try, one never: each says so, and what SUMO had to say."""
    (tmp_path / "died").mkdir()
    (tmp_path / "died" / "1").touch()
    source = ScriptedSource(tmp_path, broken=(3,), frail=tmp_path / "died", warnings=7)
    feedback = RecordedFeedback()
    study = small_study(seeds={"first": 1, "last": 3})
    dataset = generate(study, tmp_path / "data", one_worker, feedback, source=source)
    entries = {entry["seed"]: entry for entry in lines(dataset.path)}
    assert feedback.details == [str(Entry.model_validate(line)) for line in lines(dataset.path)]
    assert (entries[1]["outcome"], entries[1]["retries"], entries[1]["reason"]) == ("made", 0, None)
    assert (entries[1]["samples"], entries[1]["collided"], entries[1]["warnings"]) == (2, 1, 7)
    example = {"kind": "Vehicle '...' is slow.", "count": 7, "example": "Vehicle 'c' is slow."}
    assert (entries[1]["vehicles"], entries[1]["sumo_warnings"]) == (5, [example])
    assert entries[1]["events"] == dataset.meta.shards[0].episode.events
    assert entries[1]["beyond_car"] == dataset.meta.shards[0].episode.counts["beyond_car"]
    assert float(str(entries[1]["seconds"])) > 0
    assert (entries[2]["outcome"], entries[2]["retries"]) == ("made", 1)
    assert (entries[3]["outcome"], entries[3]["retries"], entries[3]["reason"]) == (
        "lost", 2, "RuntimeError: the simulation broke",
    )  # fmt: skip
    assert feedback.details[-1].startswith("road-3: lost, RuntimeError: the simulation broke")


def test_the_log_is_no_part_of_the_dataset(tmp_path: Path) -> None:
    """Without it, or with half a line of a killed command in it, the dataset stays what it is and goes on."""
    source, study = ScriptedSource(tmp_path), small_study(seeds={"first": 1, "last": 2})
    dataset = generate(study, tmp_path / "data", INLINE, source=source)
    (dataset.path / "log.jsonl").write_text('{"scenario": "ro')
    dataset.verify()
    assert generate(study, dataset.path, INLINE, source=source).digest == dataset.digest
    dataset.shard_path(dataset.meta.shards[1]).unlink()
    assert generate(study, dataset.path, INLINE, source=source).digest == dataset.digest
    first, second = (dataset.path / "log.jsonl").read_text().splitlines()
    assert first == '{"scenario": "ro'
    assert json.loads(second)["seed"] == 2
    (dataset.path / "log.jsonl").unlink()
    assert Dataset.open(dataset.path).digest == dataset.digest


def test_sensing_anew_is_logged_too(tmp_path: Path) -> None:
    dataset = generate(
        small_study(seeds={"first": 1, "last": 2}), tmp_path / "data", INLINE, source=ScriptedSource(tmp_path)
    )
    again = resense(dataset, ResenseSettings(sensing=own_sensing(dataset)), tmp_path / "again", INLINE)
    assert [(line["seed"], line["samples"]) for line in lines(again.path)] == [(1, 2), (2, 2)]


def test_a_log_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / log.LOG_FILE).mkdir()
    with pytest.raises(OutputError, match=r"log\.jsonl: cannot be written \(Is a directory\)"):
        log.append(tmp_path, Entry(scenario="road", seed=1, outcome="lost"))


@pytest.mark.parametrize("option", ["", "--quiet", "--verbose"])
def test_how_much_a_command_says(
    option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A line an episode with --verbose, nothing but warnings with --quiet; the result on standard output always."""
    source = ScriptedSource(tmp_path, broken=(2,), warnings=3)
    monkeypatch.setattr("isac_cosim.labeling.generation.generate.motion_source", lambda study: source)
    monkeypatch.setattr("isac_cosim.base.workers.engine.LocalEngine.run", lambda _, *task: INLINE.run(*task))
    out = tmp_path / "data"
    words = ["generate", "road", "-o", str(out), "--seeds", "1:2", "--jobs", "1", "--json", *option.split()]
    assert cosim.main(words) == 0
    captured = capfd.readouterr()
    assert json.loads(captured.out.splitlines()[-1])["samples"] == 2
    assert captured.out.count("\n") == 1
    episodes = [line for line in captured.err.splitlines() if line.startswith("road-")]
    warned = [line for line in captured.err.splitlines() if line.startswith("warning: ")]
    assert any("episode road-2 was left out: RuntimeError: the simulation broke" in line for line in warned)
    assert "warning: SUMO warned 3 times in 1 episode, for example: Vehicle 'c' is slow." in warned
    if option == "--verbose":
        assert len(episodes) == 2
        assert episodes[0].startswith("road-1: 2 samples")
        assert episodes[0].endswith("1 of 5 vehicles collided, 3 warnings")
        assert episodes[1].startswith("road-2: lost, RuntimeError: the simulation broke")
    else:
        assert episodes == []
    assert ("position_error_m" in captured.err) is (option != "--quiet")
    if option == "--quiet":
        assert captured.err.splitlines() == warned
    assert len(lines(out)) == 2
