"""The journal of finished shards: what an interrupted command need not read again, and what it does not trust."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.errors import OutputError
from isac_cosim.labeling.dataset.dataset import SHARDS, Dataset, Meta, Shard, ShardIndex, write_meta
from isac_cosim.labeling.generation import generate, journal
from isac_cosim.labeling.generation.journal import JOURNAL_FILE, Journal
from tests.support.former_dataset import without_index
from tests.support.many_shards import made_up_shard, write_many
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.scripted import InlineEngine, ScriptedSource, small_study

STARTED = Meta(
    complete=False, fingerprint="f", tv_rate_hz=40, uv_rate_hz=10, duration_s=5.0, study={}, versions={}, scenarios=()
)


def stored(folder: Path, seed: int, size: int | None = None, fingerprint: str = "f") -> Shard:
    """An entry, and a file of its size or another one in the place of its shard."""
    shard = made_up_shard(seed, fingerprint=fingerprint)
    (folder / SHARDS).mkdir(exist_ok=True)
    (folder / SHARDS / shard.file).write_bytes(bytes(shard.bytes if size is None else size))
    return shard


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the shards that are read, all of which are found to be sound."""
    names: list[str] = []

    def read_shard(path: Path) -> Shard:
        names.append(path.name)
        return made_up_shard(int(path.stem.partition("-")[2]), fingerprint="f")

    monkeypatch.setattr(journal, "read_shard", read_shard)
    return names


def test_noted_shards_are_not_read_again(tmp_path: Path, read: list[str]) -> None:
    first = Journal.open(tmp_path, STARTED)
    shards = [stored(tmp_path, seed) for seed in range(3)]
    for shard in shards:
        first.add(shard)
    assert list(first.shards) == shards
    assert (tmp_path / JOURNAL_FILE).read_text().count("\n") == 3
    again = Journal.open(tmp_path, STARTED)
    assert list(again.shards) == shards
    assert read == []
    again.remove()
    assert sorted(path.name for path in tmp_path.iterdir()) == [SHARDS]


def test_what_differs_from_its_note_is_read_again(tmp_path: Path, read: list[str]) -> None:
    """A file that was cut short, one of another study, one without a note; and one that is gone."""
    first = Journal.open(tmp_path, STARTED)
    first.add(stored(tmp_path, 0))
    first.add(stored(tmp_path, 1, size=10))
    first.add(stored(tmp_path, 2, fingerprint="other"))
    stored(tmp_path, 3)
    first.add(made_up_shard(4, fingerprint="f"))
    again = Journal.open(tmp_path, STARTED)
    assert read == ["road-1.parquet", "road-2.parquet", "road-3.parquet"]
    assert again.shards.files == [f"road-{seed}.parquet" for seed in range(4)]
    assert again.shards.fingerprints == ["f"] * 4


def test_lines_of_killed_commands_are_passed_over(tmp_path: Path, read: list[str]) -> None:
    """Where a line ends too early, the next command's first line is one of its own."""
    Journal.open(tmp_path, STARTED).add(stored(tmp_path, 0))
    path = tmp_path / JOURNAL_FILE
    path.write_bytes(path.read_bytes()[:-30])
    second = Journal.open(tmp_path, STARTED)
    second.add(stored(tmp_path, 1))
    assert Journal.open(tmp_path, STARTED).shards == second.shards
    assert second.shards.files == ["road-0.parquet", "road-1.parquet"]
    assert read == ["road-0.parquet"]


def test_notes_of_former_versions_count(tmp_path: Path, read: list[str]) -> None:
    """In the list of `dataset.json`, or in an index; the journal's lines are newer."""
    shards = [stored(tmp_path, seed) for seed in range(3)]
    scenarios = [{"name": "road", "source": "road", "sha256": "0" * 64, "origin": (0.0, 0.0), "sites": ()}]
    content = {**dict(STARTED), "complete": True, "scenarios": scenarios, "shards": ShardIndex.of(shards)}
    write_meta(tmp_path, Meta.model_validate(content))
    assert list(Journal.open(tmp_path, STARTED).shards) == shards
    without_index(tmp_path)
    opened = Journal.open(tmp_path, STARTED)
    assert list(opened.shards) == shards
    opened.add(stored(tmp_path, 1).model_copy(update={"samples": 77}))
    assert Journal.open(tmp_path, STARTED).shards.numbers("samples").tolist() == [shards[0].samples, 77, 4]
    assert read == []


def test_a_note_costs_no_more_than_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, read: list[str]
) -> None:
    """Adding writes a line, and never puts the whole list together."""
    monkeypatch.setattr(journal, "TOGETHER", 4)
    opened, converted = Journal.open(tmp_path, STARTED), []
    of = ShardIndex.of
    with monkeypatch.context() as patch:
        patch.setattr(ShardIndex, "merged", None)
        patch.setattr(ShardIndex, "of", lambda shards: converted.append(len(shards)) or of(shards))
        sizes = []
        for seed in range(10):
            opened.add(made_up_shard(seed, fingerprint="f"))
            sizes.append((tmp_path / JOURNAL_FILE).stat().st_size)
    assert converted == [4, 4]
    assert max(np.diff(sizes)) < 2 * sizes[0]
    assert list(opened.shards) == [made_up_shard(seed, fingerprint="f") for seed in range(10)]


def test_a_journal_that_is_a_link_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "foreign").write_text("mine\n")
    (tmp_path / JOURNAL_FILE).symlink_to(tmp_path / "foreign")
    with pytest.raises(OutputError, match=r"shards\.jsonl: cannot be written"):
        Journal.open(tmp_path, STARTED).add(made_up_shard(1))
    assert (tmp_path / "foreign").read_text() == "mine\n"


def test_a_large_dataset_is_finished_without_reading_its_shards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, read: list[str]
) -> None:
    """Of 20,000 episodes, the last one is missing."""
    count = 20_000
    study = small_study(seeds={"first": 1, "last": count})
    source, out = ScriptedSource(tmp_path), tmp_path / "data"
    started = generate.describe(study, generate.read_scenarios(study, source), source)
    (out / SHARDS).mkdir(parents=True)
    write_meta(out, started)
    noted = write_many(out / "shards.parquet", count - 1, started.fingerprint)
    looks: list[Path] = []

    def files_in(folder: Path) -> dict[str, int]:
        looks.append(folder)
        return dict.fromkeys(noted.files, 1001)

    monkeypatch.setattr(journal, "files_in", files_in)
    finished = dict.fromkeys([*noted.files, f"road-{count}.parquet"], 1001)
    monkeypatch.setattr("isac_cosim.labeling.dataset.dataset.files_in", lambda _: finished)
    feedback = RecordedFeedback()
    dataset = generate.generate(study, out, InlineEngine(), feedback, source)
    assert (read, looks) == ([], [out / SHARDS])
    assert [line.partition(":")[0] for line in feedback.details] == [f"road-{count}"]
    assert dataset.meta.shards[:-1] == noted
    assert dataset.meta.shards[-1].episode.seed == count
    assert sorted(path.name for path in out.iterdir() if path.is_file()) == [
        "README.md", "croissant.json", "dataset.json", "log.jsonl", "shards.parquet",
    ]  # fmt: skip


def test_a_command_killed_at_the_end_leaves_a_sound_dataset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between the index and `dataset.json`, and before the journal is deleted."""
    study, source, out = small_study(seeds={"first": 1, "last": 2}), ScriptedSource(tmp_path), tmp_path / "data"
    whole = generate.generate(study, tmp_path / "whole", InlineEngine(), source=source)

    def write_index_alone(folder: Path, meta: Meta) -> None:
        if not meta.complete:
            return write_meta(folder, meta)
        meta.shards.write(folder / "shards.parquet")
        raise KeyboardInterrupt

    def keep(_: Journal) -> None:
        raise KeyboardInterrupt

    for place, killed in (("folder.write_meta", write_index_alone), ("journal.Journal.remove", keep)):
        with monkeypatch.context() as patch:
            patch.setattr(f"isac_cosim.labeling.generation.{place}", killed)
            with pytest.raises(KeyboardInterrupt):
                generate.generate(study, out, InlineEngine(), source=source)
        assert (out / JOURNAL_FILE).is_file()
    assert Dataset.open(out).digest == whole.digest
    generate.generate(study, out, InlineEngine(), source=source)
    assert {path.name for path in out.rglob("*")} == {path.name for path in whole.path.rglob("*")}
    for name in ("shards.parquet", "dataset.json"):
        assert (out / name).read_bytes() == (whole.path / name).read_bytes()
