"""Nothing in a dataset or a study can lead to files outside the folder that is written."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from pydantic import ValidationError

from isac_cosim.base.errors import InputError, OutputError
from isac_cosim.labeling.dataset.dataset import Dataset, Episode, Lost, read_shard
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.resense import ResenseSettings, own_sensing, resense
from isac_cosim.studies.study import read_study
from tests.support.former_dataset import without_index
from tests.support.scripted import InlineEngine, ScriptedSource, small_study

INLINE = InlineEngine()
STUDY = small_study(seeds={"first": 1, "last": 2})


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    (tmp_path / "road").mkdir()
    return generate(STUDY, tmp_path / "data", INLINE, source=ScriptedSource(tmp_path / "road"))


def rewritten(dataset: Dataset, old: str, new: str) -> None:
    path = dataset.path / "dataset.json"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


@pytest.mark.parametrize("name", ["../../evil", "/tmp/evil", "..", ".hidden", "a/b", "a\\u0000b", "road\\n"])
def test_a_scenario_cannot_be_named_out_of_the_folder(dataset: Dataset, name: str) -> None:
    without_index(dataset.path)
    for old in ('"name": "road"', '"scenario": "road"', '"file": "road-1.parquet"'):
        before = (dataset.path / "dataset.json").read_text()
        key = old.partition(":")[0]
        rewritten(dataset, old, f'{key}: "{name}"')
        with pytest.raises(InputError, match=r"dataset\.json: "):
            Dataset.open(dataset.path)
        (dataset.path / "dataset.json").write_text(before)


def test_a_shard_that_names_another_episode_is_refused(dataset: Dataset) -> None:
    """The names inside the shard count, when the dataset is finished or sensed anew."""
    path = dataset.shard_path(dataset.meta.shards[0])
    table = pq.read_table(path)
    for scenario, seed in (("../../evil", 1), ("road", 7)):
        stored = json.loads(table.schema.metadata[b"cosim.episode"]) | {"scenario": scenario, "seed": seed}
        pq.write_table(table.replace_schema_metadata({b"cosim.episode": json.dumps(stored)}), path)
        with pytest.raises(InputError, match=r"road-1\.parquet: not a whole shard"):
            read_shard(path)


@pytest.mark.parametrize("name", ["../../evil", "/tmp/evil", "..", ".hidden", "a/b", "a\0b", "road\n", "a ", ""])
def test_no_episode_has_a_name_that_leads_elsewhere(name: str) -> None:
    with pytest.raises(ValidationError):
        Episode(scenario=name, seed=1)
    with pytest.raises(ValidationError):
        Lost(scenario=name, seed=1, reason="it broke")


def test_samples_of_a_scenario_that_is_not_listed_lead_nowhere(dataset: Dataset) -> None:
    assert dataset.roads("road")
    for name in ("../roads/road", str(dataset.path / "roads" / "road"), "other"):
        with pytest.raises(InputError, match=r"has samples of '.*', which it does not list as a scenario"):
            dataset.roads(name)


@pytest.mark.parametrize("part", ["shards", "roads"])
def test_a_folder_that_is_a_link_is_refused(dataset: Dataset, tmp_path: Path, part: str) -> None:
    """Files that the link leads to are neither overwritten nor removed."""
    (dataset.path / part).rename(tmp_path / "elsewhere")
    (tmp_path / "elsewhere/thesis.tex").write_text("years of work")
    (dataset.path / part).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match=f"{part}: is a link"):
        generate(STUDY, dataset.path, INLINE, source=ScriptedSource(tmp_path / "road"))
    assert (tmp_path / "elsewhere/thesis.tex").read_text() == "years of work"


@pytest.mark.parametrize("file", ["dataset.json", "shards/road-1.parquet", "roads/road.parquet"])
def test_a_file_that_is_a_link_is_replaced_and_not_followed(dataset: Dataset, tmp_path: Path, file: str) -> None:
    (tmp_path / "foreign").write_bytes((dataset.path / file).read_bytes())
    before = (tmp_path / "foreign").read_bytes()
    (dataset.path / file).unlink()
    (dataset.path / file).symlink_to(tmp_path / "foreign")
    dataset.shard_path(dataset.meta.shards[1]).unlink()
    if file.startswith("shards"):
        (tmp_path / "foreign").write_bytes(before := b"no shard")
    again = generate(STUDY, dataset.path, INLINE, source=ScriptedSource(tmp_path / "road"))
    assert again.digest == dataset.digest
    assert (tmp_path / "foreign").read_bytes() == before


def test_a_log_that_is_a_link_is_not_followed(dataset: Dataset, tmp_path: Path) -> None:
    (tmp_path / "foreign").write_text("mine\n")
    (dataset.path / "log.jsonl").unlink()
    (dataset.path / "log.jsonl").symlink_to(tmp_path / "foreign")
    dataset.shard_path(dataset.meta.shards[1]).unlink()
    with pytest.raises(OutputError, match=r"log\.jsonl: cannot be written"):
        generate(STUDY, dataset.path, INLINE, source=ScriptedSource(tmp_path / "road"))
    assert (tmp_path / "foreign").read_text() == "mine\n"


def test_links_may_be_read(dataset: Dataset, tmp_path: Path) -> None:
    """A dataset whose shards are elsewhere is read, and sensed anew into a new folder."""
    (dataset.path / "shards").rename(tmp_path / "elsewhere")
    (dataset.path / "shards").symlink_to(tmp_path / "elsewhere")
    before = sorted((tmp_path / "elsewhere").iterdir())
    anew = resense(Dataset.open(dataset.path), ResenseSettings(sensing=own_sensing(dataset)), tmp_path / "anew", INLINE)
    assert len(anew) == len(dataset)
    assert sorted((tmp_path / "elsewhere").iterdir()) == before


@pytest.mark.parametrize("name", ["..toml", "...toml", "study.toml"])
def test_a_study_s_name_cannot_lead_out_of_the_folder(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("")
    assert read_study(tmp_path / name).name == "study"
    (tmp_path / name).write_text('name = "../out"')
    with pytest.raises(InputError, match="name: "):
        read_study(tmp_path / name)
