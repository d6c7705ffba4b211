"""README.md and croissant.json: other programs read the dataset by them, and nothing in them is invented."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cosim
from isac_cosim.base.errors import InputError
from isac_cosim.base.files import file_digest
from isac_cosim.labeling.dataset.dataset import ROAD_SCHEMA, Dataset
from isac_cosim.labeling.dataset.pull_outs import dropped_pull_outs
from isac_cosim.labeling.dataset.shard import schema
from isac_cosim.labeling.publication.columns import COLUMNS, ROAD_COLUMNS
from isac_cosim.labeling.publication.describing import describe
from isac_cosim.labeling.publication.statement import Statement
from tests.support.made_up_dataset import write_dataset

HOSTILE = '<script>alert("x")</script>: "quoted" # no comment'


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    dataset = write_dataset(tmp_path / "data", seeds=2, per_class=1, passing=True)
    describe(dataset.path, Statement())
    return dataset


def card(dataset: Dataset) -> str:
    return (dataset.path / "README.md").read_text(encoding="utf-8")


def croissant(dataset: Dataset) -> dict[str, Any]:
    return json.loads((dataset.path / "croissant.json").read_text(encoding="utf-8"))


def test_every_column_is_described() -> None:
    assert COLUMNS.keys() == set(schema(1, 1, 1).names)
    assert ROAD_COLUMNS.keys() == set(ROAD_SCHEMA.names)


def test_hugging_face_reads_every_table(dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`load_dataset(DIR)` alone gives the samples: not pull-outs and roads as well."""
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    datasets = pytest.importorskip("datasets")
    read = {
        name: datasets.load_dataset(str(dataset.path), name, cache_dir=str(tmp_path / "cache"))["train"]
        for name in (None, "samples", "pull_outs", "roads")
    }
    assert read[None]["sample_id"] == read["samples"]["sample_id"]
    assert list(read["samples"]["sample_id"]) == dataset.frame(["sample_id"])["sample_id"].tolist()
    np.testing.assert_array_equal(np.array(read["samples"][1]["tv"], np.float32), dataset.arrays("tv")["tv"][1])
    dropped = dropped_pull_outs(dataset).frame(["sample_id"])["sample_id"].tolist()
    assert list(read["pull_outs"]["sample_id"]) == dropped
    assert len(dropped) > 0
    assert list(read["roads"]["id"]) == [lane.id for lane in dataset.roads("toy")]


def test_croissant_reads_every_table(dataset: Dataset) -> None:
    mlcroissant = pytest.importorskip("mlcroissant")
    described = mlcroissant.Dataset(jsonld=str(dataset.path / "croissant.json"))
    assert not described.metadata.ctx.issues.errors
    assert described.metadata.ctx.is_v1_1()
    read = {name: list(described.records(record_set=name)) for name in ("samples", "pull_outs", "roads")}
    names = dataset.frame(["sample_id"])["sample_id"].tolist()
    assert [row["samples/sample_id"].decode() for row in read["samples"]] == names
    np.testing.assert_array_equal(np.array(read["samples"][1]["samples/uv"]), dataset.arrays("uv")["uv"][1])
    assert len(read["pull_outs"]) == len(dropped_pull_outs(dataset))
    assert [row["roads/id"].decode() for row in read["roads"]] == [lane.id for lane in dataset.roads("toy")]


def test_a_croissant_description_has_the_files_with_their_digests(dataset: Dataset) -> None:
    content = croissant(dataset)
    assert content["conformsTo"] == "http://mlcommons.org/croissant/1.1"
    files = {entry["@id"]: entry for entry in content["distribution"]}
    for name in ("dataset.json", "shards.parquet"):
        assert files[name]["sha256"] == file_digest(dataset.path / name)
    for name in ("samples", "pull_outs", "roads"):
        assert list(dataset.path.glob(files[f"{name}-files"]["includes"]))
    states = {field["name"]: field for field in content["recordSet"][0]["field"]}
    assert (states["tv"]["arrayShape"], states["uv"]["arrayShape"]) == ("6,2000", "6,500")
    assert states["tv"]["dataType"] == "cr:Float32"


def test_counts_are_those_of_the_dataset(dataset: Dataset) -> None:
    text = card(dataset)
    for intention, number in dataset.meta.by_intention().items():
        assert f"| {intention} | {number} |" in text
    assert f"{len(dataset)} samples of driver intentions" in text
    assert "| `tv` | float32 [6][2000] | " in text


def test_licence_and_citation_are_asked_for_and_not_invented(dataset: Dataset) -> None:
    assert "license" not in croissant(dataset)
    assert "\nlicense:" not in card(dataset)
    assert "Licence: nobody has stated one; `cosim describe FOLDER --license ...` does." in card(dataset)
    assert "citeAs" not in croissant(dataset)
    command = ["describe", str(dataset.path), "--license", "CC-BY-4.0", "--creator", "A. Author", "--quiet"]
    assert cosim.main(command) == 0
    assert cosim.main(["describe", str(dataset.path), "--citation", "A. Author, 2026", "--quiet"]) == 0
    content = croissant(dataset)
    assert (content["license"], content["citeAs"]) == ("CC-BY-4.0", "A. Author, 2026")
    assert content["creator"]["name"] == "A. Author"
    assert '\nlicense: "cc-by-4.0"\n' in card(dataset)
    assert "Citation: A. Author, 2026" in card(dataset)
    Dataset.open(dataset.path).verify()


def test_no_text_ends_what_it_is_in(dataset: Dataset) -> None:
    describe(dataset.path, Statement(license=HOSTILE, citation=HOSTILE, creator=HOSTILE))
    _, front, body = card(dataset).split("---\n", 2)
    assert "<script>" not in body
    line = next(line for line in front.splitlines() if line.startswith("license: "))
    assert json.loads(line.removeprefix("license: ")) == HOSTILE.lower()
    assert croissant(dataset)["citeAs"] == HOSTILE


def test_a_readme_of_somebody_stays(dataset: Dataset, capsys: pytest.CaptureFixture[str]) -> None:
    (dataset.path / "README.md").write_text("My own words.\n")
    assert cosim.main(["describe", str(dataset.path), "--license", "MIT"]) == 0
    assert "README.md: is somebody's own and stays as it is" in capsys.readouterr().err
    assert card(dataset) == "My own words.\n"
    assert croissant(dataset)["license"] == "MIT"


def test_the_same_dataset_gives_the_same_bytes(dataset: Dataset, tmp_path: Path) -> None:
    other = write_dataset(tmp_path / "elsewhere", seeds=2, per_class=1, passing=True)
    describe(other.path, Statement())
    for name in ("README.md", "croissant.json"):
        assert (other.path / name).read_bytes() == (dataset.path / name).read_bytes()


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--url", "ftp://x"], "arguments: url"),
        (["--license", " "], "--license: is empty"),
        (["--citation", "a\nb"], "arguments: citation"),
        (["--license", "x" * 1001], "arguments: license"),
    ],
)
def test_what_cannot_be_stated_is_one_line(
    dataset: Dataset, capsys: pytest.CaptureFixture[str], options: list[str], line: str
) -> None:
    before = {path: path.read_bytes() for path in dataset.path.glob("*.*")}
    assert cosim.main(["describe", str(dataset.path), *options]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert line in error
    assert {path: path.read_bytes() for path in dataset.path.glob("*.*")} == before


def test_what_is_no_dataset_is_refused(tmp_path: Path, dataset: Dataset) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match="not a dataset"):
        describe(tmp_path, Statement())
    (dataset.path / "publication.json").write_text('{"license": 3}')
    with pytest.raises(InputError, match=r"publication\.json: license"):
        describe(dataset.path, Statement())
