"""Changed and forged datasets: refused in one line that names the file and what is wrong in it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

import cosim
from isac_cosim.base.errors import InputError
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.dataset.pull_outs import dropped_pull_outs
from isac_cosim.labeling.dataset.shard import read_shard
from isac_cosim.models.data.windows import Records
from tests.support.forged import forge_dataset, reseal
from tests.support.made_up_dataset import write_dataset

SHARD = "shards/toy-1.parquet"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made") / "data"
    write_dataset(folder, seeds=3, per_class=1, passing=True)
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    shutil.copytree(made, tmp_path / "data")
    return tmp_path / "data"


def rewritten(path: Path, change: Callable[[pa.Table], pa.Table]) -> None:
    """Change a Parquet file, and keep its metadata."""
    table = pq.read_table(path)
    pq.write_table(change(table).replace_schema_metadata(table.schema.metadata), path, compression="zstd")


def with_column(name: str, values: Callable[[pa.ChunkedArray], pa.Array]) -> Callable[[pa.Table], pa.Table]:
    def change(table: pa.Table) -> pa.Table:
        changed = values(table[name])
        return table.set_column(
            table.schema.get_field_index(name), pa.field(name, changed.type, changed.null_count > 0), changed
        )

    return change


def same(value: object, kind: pa.DataType) -> Callable[[pa.ChunkedArray], pa.Array]:
    return lambda column: pa.array([value] * len(column), kind)


def with_nan(column: pa.ChunkedArray) -> pa.Array:
    states = column.combine_chunks()
    states = states.chunk(0) if isinstance(states, pa.ChunkedArray) else states
    flat = states.flatten().flatten().to_numpy().copy()
    flat[1234] = np.nan
    inner = pa.FixedSizeListArray.from_arrays(pa.array(flat), type=states.type.value_type)
    return pa.FixedSizeListArray.from_arrays(inner, type=states.type)


def shorter(column: pa.ChunkedArray) -> pa.Array:
    flat = pa.array(np.zeros(len(column) * 6 * 10, np.float32))
    return pa.FixedSizeListArray.from_arrays(pa.FixedSizeListArray.from_arrays(flat, 10), 6)


CHANGES: dict[str, tuple[Callable[[pa.Table], pa.Table], str]] = {
    "labels of 0": (with_column("label", same(0, pa.int8())), "label"),
    "labels of 99": (with_column("label", same(99, pa.int8())), "label: is not an intention"),
    "a number for a text": (with_column("label", same(1.5, pa.float64())), "label: the column is of double"),
    "an unknown intention": (with_column("intention", same("loop", pa.string())), "intention: is not an intention"),
    "other origins": (
        with_column("origin", same("commanded", pa.string())),
        "origin: the numbers of samples by origin",
    ),
    "an unknown origin": (with_column("origin", same("divine", pa.string())), "origin: is not one of"),
    "NaN in tv": (with_column("tv", with_nan), "tv: holds values that are not finite"),
    "shorter records": (with_column("tv", shorter), "tv: the column is of"),
    "no tv": (lambda table: table.drop_columns(["tv"]), "tv: the column is missing"),
    "no label": (lambda table: table.drop_columns(["label"]), "label: the column is missing"),
    "fewer rows": (lambda table: table.slice(0, 3), "it has 3 rows"),
    "times that are NaN": (with_column("t_commit", same(np.nan, pa.float64())), "t_commit: times are not finite"),
    "times out of order": (with_column("t_onset", same(-5.0, pa.float64())), "t_onset: times are not in the order"),
    "another seed": (with_column("seed", same(7, pa.int64())), "seed: is not that"),
    "another scenario": (with_column("scenario", same("city", pa.string())), "scenario: is not that"),
    "ids of another episode": (
        with_column("sample_id", lambda column: pc.replace_substring(column, "toy-1", "toy-9").combine_chunks()),
        "sample_id: sample ids do not belong",
    ),
    "one id for all": (with_column("sample_id", same("toy-1-0", pa.string())), "sample_id: sample ids are not unique"),
    "sites below 0": (with_column("n_sites", same(-1, pa.int8())), "n_sites: is negative"),
    "lacking values": (with_column("sensor", same(None, pa.string())), "sensor: lacks values"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_changed_shard_is_refused_when_it_is_read(folder: Path, change: str) -> None:
    rewritten(folder / SHARD, CHANGES[change][0])
    with pytest.raises(
        InputError, match=r"toy-1\.parquet: .*(its bytes differ from the digest in shards\.parquet|it has 3 rows)"
    ):
        Records.of(Dataset.open(folder))


@pytest.mark.parametrize("change", CHANGES)
def test_a_forged_shard_is_refused_by_its_content(folder: Path, change: str) -> None:
    """Its digest is that of the index: what is wrong is found in the rows."""
    rewritten(folder / SHARD, CHANGES[change][0])
    forge_dataset(folder)
    dataset = Dataset.open(folder)
    with pytest.raises(InputError, match=rf"toy-1\.parquet: .*{CHANGES[change][1]}"):
        dataset.verify()
    if change in ("an unknown intention", "lacking values"):
        return  # in columns that training does not read
    with pytest.raises(InputError, match=rf"toy-1\.parquet: .*{CHANGES[change][1]}"):
        Records.of(dataset)


def test_a_shard_that_stores_another_episode_is_refused(folder: Path) -> None:
    """What it says of its episode is in the file's metadata, beside the rows."""
    path = folder / SHARD
    table = pq.read_table(path)
    metadata = {key: value.replace(b'"seed":1', b'"seed":9') for key, value in table.schema.metadata.items()}
    assert metadata != table.schema.metadata
    pq.write_table(table.replace_schema_metadata(metadata), path, compression="zstd")
    forge_dataset(folder)
    assert cosim.main(["sense", str(folder), "-o", str(folder.parent / "new"), "--sensor", "truth", "--quiet"]) == 2
    with pytest.raises(InputError, match=r"toy-1\.parquet: .*stores the episode toy, seed 9"):
        read_shard(path)


@pytest.mark.parametrize(
    "command", ["train data -o run --model rule", "inspect data", "sense data -o new --sensor truth"]
)
def test_commands_refuse_changed_data(
    folder: Path, command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder.parent)
    rewritten(folder / SHARD, CHANGES["labels of 0"][0])
    assert cosim.main([*command.split(), "--quiet"]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert "toy-1.parquet" in line
    assert "digest" in line


@pytest.mark.parametrize("file", ["roads/toy.parquet", "dropped_pull_outs/toy-0.parquet"])
def test_the_other_files_are_held_against_their_digests(folder: Path, file: str) -> None:
    content = bytearray((folder / file).read_bytes())
    content[len(content) // 3] ^= 4
    (folder / file).write_bytes(content)
    with pytest.raises(InputError, match=file.partition("/")[2].replace(".", r"\.")):
        Dataset.open(folder).verify()
    dataset = Dataset.open(folder)
    read = (lambda: dataset.roads("toy")) if file.startswith("roads") else (lambda: dropped_pull_outs(dataset))
    with pytest.raises(InputError, match=file.partition("/")[2].replace(".", r"\.")):
        read()


DESCRIPTIONS: dict[str, tuple[dict[str, object], str]] = {
    "rates of 1e9": ({"tv_rate_hz": 1e9}, "tv_rate_hz: must be at most"),
    "endless records": ({"duration_s": 1e300}, "duration_s, run_in_s, tv_rate_hz and uv_rate_hz give records"),
    "rates that are not the study's": ({"study": {"record": {"tv_rate_hz": 200.0}}}, "tv_rate_hz: is not that"),
    "other classes": ({"class_names": ["a", "b"]}, "class_names or state"),
    "no index": ({"index_sha256": None}, "index_sha256: is missing"),
    "a scenario that leads out": ({"scenarios": []}, "scenarios that it does not list"),
    "roads that lead out": ({"roads": {"../x.parquet": "0" * 64}}, "roads"),
}


@pytest.mark.parametrize("change", DESCRIPTIONS)
def test_a_forged_description_is_refused(folder: Path, change: str) -> None:
    path = folder / "dataset.json"
    update, fault = DESCRIPTIONS[change]
    path.write_text(json.dumps(json.loads(path.read_text()) | update))
    reseal(path)
    with pytest.raises(InputError, match=fault):
        Dataset.open(folder)


def test_a_changed_description_is_noticed(folder: Path) -> None:
    """A value that could as well be right: a site a metre further on."""
    path = folder / "dataset.json"
    content = json.loads(path.read_text())
    content["scenarios"][0]["sites"][0]["x"] += 1.0
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"dataset\.json: sha256: differs from the content"):
        Dataset.open(folder)


def test_an_index_that_claims_more_than_its_shards_hold_takes_no_memory(folder: Path) -> None:
    """Two thousand million samples, for which nothing is allocated."""
    index = folder / "shards.parquet"
    table = pq.read_table(index)
    many = 2_000_000_000
    counts = pa.array(
        [{name: many if name == "following" else 0 for name in row} for row in table["by_intention"].to_pylist()],
        table["by_intention"].type,
    )
    table = table.set_column(table.schema.get_field_index("by_intention"), table.schema.field("by_intention"), counts)
    samples = pa.array([many] * len(table), pa.int32())
    table = table.set_column(table.schema.get_field_index("samples"), table.schema.field("samples"), samples)
    pq.write_table(table, index)
    forge_dataset(folder)
    with pytest.raises(InputError, match=r"toy-0\.parquet: .*it has 7 rows, and 2000000000 in the index"):
        Dataset.open(folder).arrays("tv")


def test_the_order_of_the_rows_on_disk_is_the_order_of_the_dataset(made: Path) -> None:
    """The undamaged dataset passes every check."""
    dataset = Dataset.open(made)
    dataset.verify()
    assert len(Records.of(dataset)) == len(dataset)
    assert dataset.roads("toy")[0].id == "e_0"


@pytest.mark.parametrize(("taken", "given"), [("dropped_pull_outs", "shards"), ("shards", "dropped_pull_outs")])
def test_samples_and_dropped_pull_outs_are_not_taken_for_each_other(folder: Path, taken: str, given: str) -> None:
    """One would be asked about as the other: ids would stand twice, or classes would hold what is in none."""
    shutil.copyfile(folder / given / "toy-1.parquet", folder / taken / "toy-1.parquet")
    forge_dataset(folder)
    read = Dataset.frame if taken == "shards" else lambda dataset: dropped_pull_outs(dataset).frame()
    with pytest.raises(InputError, match=rf"{taken}/toy-1\.parquet"):
        read(Dataset.open(folder))


def test_a_dropped_pull_out_is_a_pull_out(folder: Path) -> None:
    rewritten(folder / "dropped_pull_outs/toy-1.parquet", with_column("pull_out", same("", pa.string())))
    forge_dataset(folder)
    with pytest.raises(InputError, match="pull_out: is missing in a dropped pull-out"):
        dropped_pull_outs(Dataset.open(folder)).frame()


@pytest.mark.parametrize("level_db", [np.inf, -np.inf, 3e38])
def test_an_snr_that_nothing_has_is_refused(folder: Path, level_db: float) -> None:
    rewritten(folder / SHARD, with_column("snr_db", same(level_db, pa.float32())))
    forge_dataset(folder)
    with pytest.raises(InputError, match="snr_db: is beyond 1000 dB"):
        Dataset.open(folder).frame()
