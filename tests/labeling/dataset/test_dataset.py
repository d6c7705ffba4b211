"""The dataset on disk: its contract, and what damage is noticed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import cosim
from isac_cosim.base.errors import InputError
from isac_cosim.base.files import file_digest
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.labeling.dataset.dataset import (
    Dataset,
    Episode,
    ShardIndex,
    write_meta,
    write_shard,
)
from isac_cosim.labeling.dataset.shard import ARRAYS, SCALARS, read_shard, schema
from tests.support.former_dataset import without_index
from tests.support.small_dataset import LENGTHS, make, sample


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make(tmp_path_factory.mktemp("dataset") / "data")


def test_what_was_written_is_read_back_bit_for_bit(dataset: Dataset) -> None:
    rows = [sample(k, seed) for seed, count in enumerate((300, 0, 5)) for k in range(count)]
    arrays = dataset.arrays(*ARRAYS)
    for name in ARRAYS:
        np.testing.assert_array_equal(arrays[name], np.stack([getattr(row, name) for row in rows]))
    frame = dataset.frame()
    assert list(frame.columns) == list(SCALARS)
    assert list(frame["label"]) == [int(row.intention) for row in rows]
    for name in (
        "sample_id",
        "tv_id",
        "uv_id",
        "seed",
        "origin",
        "cause",
        "t_start",
        "t_onset",
        "t_commit",
        "t_end",
        "snr_db",
        "x0",
        "y0",
    ):
        assert list(frame[name]) == [getattr(row, name) for row in rows]
    np.testing.assert_array_equal(frame["cause_ttc_s"], np.float32([row.cause_ttc_s for row in rows]))
    assert len(dataset) == dataset.meta.samples == 305


def test_counts_of_the_meta_are_those_of_the_rows(dataset: Dataset) -> None:
    frame = dataset.frame(["intention", "origin"])
    assert dataset.meta.by_intention() == frame["intention"].value_counts().to_dict()
    assert dataset.meta.by_origin() == frame["origin"].value_counts().to_dict()
    assert dataset.meta.left_out() == {"no_uv": 3}


def test_columns_are_those_of_the_contract(dataset: Dataset) -> None:
    """Names and types as DESIGN.md gives them, stated here a second time on purpose."""
    columns = pq.read_schema(dataset.path / "shards" / "road-0.parquet")
    states = "fixed_size_list<element: fixed_size_list<element: float>[{}]>[6]"
    expected = {
        "sample_id": "string", "scenario": "string", "seed": "int64", "source": "string", "tv_id": "string",
        "uv_id": "string", "intention": "string", "label": "int8", "origin": "string", "cause": "string",
        "cause_ttc_s": "float", "t_start": "double",
        "t_onset": "double", "t_commit": "double", "t_end": "double", "pull_out": "string", "t_pass": "double",
        "t_pair_end": "double", "sensor": "string", "snr_db": "float",
        "n_sites": "int8", "x0": "double", "y0": "double", "tv_departed": "double",
        "track_id": "string", "right_share": "float", "breaks": "int16", "position_sd_m": "float",
        "tv": states.format(200), "tv_truth": states.format(200), "uv": states.format(50),
        "tv_run_in": states.format(20),
    }  # fmt: skip
    assert {field.name: str(field.type) for field in columns} == expected
    assert not any(isinstance(field.type, pa.BaseExtensionType) for field in columns)


def test_every_column_is_documented() -> None:
    """With its type; states and numbers of a unit with that, too."""
    lines = (Path(cosim.__file__).parent / "docs/dataset.md").read_text(encoding="utf-8").splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("| `")]
    documented = {row[0].strip("`"): row[1:] for row in rows if len(row) == 4}
    columns = schema(2000, 500, 200)
    assert list(documented) == columns.names
    units = {"t_": "s", "tv_departed": "s", "cause_ttc_s": "s", "snr_db": "dB", "x0": "m", "y0": "m"}
    units |= {"right_share": "", "position_sd_m": "m"}
    units |= dict.fromkeys(("tv", "uv"), "m, m/s, m/s²")
    for field in columns:
        kind, unit, meaning = documented[field.name]
        numbers = {"double": "float64", "float": "float32"}
        expected = "float32 [6]" if field.name in ARRAYS else numbers.get(str(field.type), str(field.type))
        assert kind.startswith(expected)
        if pa.types.is_floating(field.type) or field.name in ARRAYS:
            assert unit == next(value for name, value in units.items() if field.name.startswith(name))
        assert meaning


def test_encodings_are_those_of_the_contract(dataset: Dataset) -> None:
    metadata = pq.ParquetFile(dataset.path / "shards" / "road-0.parquet").metadata
    groups = [metadata.row_group(k) for k in range(metadata.num_row_groups)]
    assert [group.num_rows for group in groups] == [256, 44]
    columns = [group.column(k) for group in groups for k in range(group.num_columns)]
    assert {column.compression for column in columns} == {"ZSTD"}
    split = {column.path_in_schema.split(".")[0] for column in columns if "BYTE_STREAM_SPLIT" in column.encodings}
    times = {"t_start", "t_onset", "t_commit", "t_end", "t_pass", "t_pair_end"}
    assert split == {
        "cause_ttc_s",
        *times,
        "snr_db",
        "x0",
        "y0",
        "tv_departed",
        "right_share",
        "position_sd_m",
        *ARRAYS,
    }


def test_pandas_alone_reads_a_shard(dataset: Dataset) -> None:
    frame = pd.read_parquet(dataset.path / "shards" / "road-2.parquet")
    np.testing.assert_array_equal(np.stack([np.stack(row) for row in frame["uv"]]), dataset.arrays("uv")["uv"][300:])


def test_equal_samples_give_equal_bytes_and_digest(dataset: Dataset, tmp_path: Path) -> None:
    again = make(tmp_path / "again")
    assert again.digest == dataset.digest
    for shard in dataset.meta.shards:
        assert again.shard_path(shard).read_bytes() == dataset.shard_path(shard).read_bytes()
    assert make(tmp_path / "other", (300, 0, 4)).digest != dataset.digest


def test_roads_and_sites_come_back(dataset: Dataset) -> None:
    lane, inside = dataset.roads("road")
    assert (lane.id, lane.shape.tolist()) == ("e_0", [[0.0, 1.0], [10.0, 2.5]])
    assert inside.id == ":j_0"
    assert lane.width_m == pytest.approx(3.2)
    assert dataset.sites("road") == [Site("s", 1.0, 2.0, 25.0, 90.0)]


def test_a_sound_dataset_is_verified(dataset: Dataset) -> None:
    dataset.verify()


@pytest.mark.parametrize("at", [0.001, 0.3, 0.6, 0.999])
def test_a_flipped_bit_is_noticed(tmp_path: Path, at: float) -> None:
    dataset = make(tmp_path / "data", (5, 5))
    path = dataset.path / "shards" / "road-1.parquet"
    content = bytearray(path.read_bytes())
    content[int(at * len(content))] ^= 1
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"road-1\.parquet.*digest"):
        dataset.verify()


def test_a_truncated_shard_is_no_shard(tmp_path: Path) -> None:
    dataset = make(tmp_path / "data", (5,))
    path = dataset.path / "shards" / "road-0.parquet"
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match="not a whole shard"):
        read_shard(path)


WRONG = {
    "nan": lambda s: replace(s, tv=np.full_like(s.tv, np.nan)),
    "times": lambda s: replace(s, t_commit=9.0),
    "sample ids": lambda s: replace(s, sample_id="road-0-7"),
}


@pytest.mark.parametrize("fault", WRONG)
def test_values_against_the_contract_are_noticed(tmp_path: Path, fault: str) -> None:
    """A shard whose digest is right, but whose rows are wrong."""
    dataset = make(tmp_path / "data", (3,))
    rows = [sample(0, 0), WRONG[fault](sample(1, 0)), sample(2, 0)]
    shard = write_shard(dataset.path / "shards", rows, dataset.meta.shards[0].episode, *LENGTHS)
    write_meta(dataset.path, dataset.meta.model_copy(update={"shards": ShardIndex.of([shard])}))
    with pytest.raises(InputError, match="finite" if fault == "nan" else fault):
        Dataset.open(dataset.path).verify()


@pytest.mark.parametrize(("fault", "message"), [("counts", "counts differ"), ("content", "not a whole shard")])
def test_an_index_that_does_not_describe_its_shard_is_noticed(tmp_path: Path, fault: str, message: str) -> None:
    """A shard whose digest is that of the index, which says something else of it, or which is no shard."""
    dataset = make(tmp_path / "data", (3,))
    shard = dataset.meta.shards[0]
    path = dataset.path / "shards" / shard.file
    if fault == "content":
        path.write_bytes(path.read_bytes()[:-100])
    changes = {"sha256": file_digest(path)} if fault == "content" else {"bytes": shard.bytes + 1}
    write_meta(
        dataset.path, dataset.meta.model_copy(update={"shards": ShardIndex.of([shard.model_copy(update=changes)])})
    )
    with pytest.raises(InputError, match=message):
        Dataset.open(dataset.path).verify()


def test_columns_of_another_kind_are_refused(dataset: Dataset) -> None:
    with pytest.raises(ValueError, match=r"no scalar columns: \['tv'\]"):
        dataset.frame(["seed", "tv"])
    with pytest.raises(ValueError, match=r"no array columns: \['seed'\]"):
        next(dataset.arrays_by_shard("tv", "seed"))


def test_a_label_that_contradicts_its_intention_is_noticed(tmp_path: Path) -> None:
    dataset = make(tmp_path / "data", (3,))
    path = dataset.path / "shards" / "road-0.parquet"
    table = pq.read_table(path)
    k = table.schema.get_field_index("label")
    table = table.set_column(k, table.schema.field(k), pa.array([6, 6, 6], pa.int8()))
    pq.write_table(table, path)
    write_meta(dataset.path, dataset.meta.model_copy(update={"shards": ShardIndex.of([read_shard(path)])}))
    with pytest.raises(InputError, match="label and intention disagree"):
        Dataset.open(dataset.path).verify()


def test_records_of_another_length_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="float32"):
        write_shard(tmp_path, [sample(0)], Episode(scenario="road", seed=1), 100, 50)
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_dataset_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not a dataset"):
        Dataset.open(tmp_path)
    with pytest.raises(InputError, match="not a dataset"):
        Dataset.open(tmp_path / "nowhere")


def test_another_version_and_a_damaged_meta_are_refused(tmp_path: Path) -> None:
    dataset = make(tmp_path / "data", (1,))
    path = dataset.path / "dataset.json"
    content = json.loads(path.read_text())
    path.write_text(json.dumps({**content, "schema_version": 6}))
    with pytest.raises(InputError, match="schema_version"):
        Dataset.open(dataset.path)
    path.write_text("{")
    with pytest.raises(InputError, match=r"dataset\.json"):
        Dataset.open(dataset.path)


def test_a_shard_named_outside_the_folder_is_refused(tmp_path: Path) -> None:
    dataset = make(tmp_path / "data", (1,))
    without_index(dataset.path)
    path = dataset.path / "dataset.json"
    path.write_text(path.read_text().replace("road-0.parquet", "../../x.parquet"))
    with pytest.raises(InputError, match=r"shards\.0\.file"):
        Dataset.open(dataset.path)


def test_an_unfinished_dataset_and_a_missing_shard_are_refused(tmp_path: Path) -> None:
    dataset = make(tmp_path / "data", (1,))
    write_meta(dataset.path, dataset.meta.model_copy(update={"complete": False}))
    with pytest.raises(InputError, match="not finished"):
        Dataset.open(dataset.path)
    write_meta(dataset.path, dataset.meta)
    dataset.shard_path(dataset.meta.shards[0]).unlink()
    with pytest.raises(InputError, match="missing"):
        Dataset.open(dataset.path)


def test_a_reaction_without_a_cause_is_a_fault(tmp_path: Path) -> None:
    dataset = make(tmp_path / "data", (6,))
    [shard] = dataset.meta.shards
    samples = [replace(row, cause="") for row in dataset.samples(shard)]
    changed = write_shard(dataset.path / "shards", samples, shard.episode, *LENGTHS)
    write_meta(dataset.path, dataset.meta.model_copy(update={"shards": ShardIndex.of([changed])}))
    with pytest.raises(InputError, match="reactions are not the samples with a cause"):
        Dataset.open(dataset.path).verify()
