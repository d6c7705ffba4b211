"""The index of shards: its entries against the shards they come from, large ones, and what damage is noticed."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import isac_cosim.labeling.dataset.dataset
from isac_cosim.base.errors import InputError
from isac_cosim.labeling.dataset import shard_index
from isac_cosim.labeling.dataset.dataset import (
    CLASS_NAMES,
    Dataset,
    Meta,
    ScenarioMeta,
    ShardIndex,
    read_meta,
    write_meta,
)
from tests.support.former_dataset import without_index
from tests.support.many_shards import made_up_shard, write_many

SHARDS = [made_up_shard(seed, scenario) for seed in range(7) for scenario in ("road", "ramp")]
SCENARIOS = tuple(
    ScenarioMeta(name=name, source=name, sha256="0" * 64, origin=(0.0, 0.0), sites=()) for name in ("ramp", "road")
)


def meta_of(shards: ShardIndex) -> Meta:
    return Meta(
        complete=True, fingerprint="f", tv_rate_hz=40, uv_rate_hz=10, duration_s=5.0, study={}, versions={},
        scenarios=SCENARIOS, shards=shards,
    )  # fmt: skip


@pytest.mark.parametrize("together", [1, 3, 4096])
def test_entries_come_back_as_they_were(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, together: int) -> None:
    monkeypatch.setattr(shard_index, "TOGETHER", together)
    ShardIndex.of(SHARDS).write(tmp_path / "shards.parquet")
    index = ShardIndex.read(tmp_path / "shards.parquet")
    assert list(index) == SHARDS
    assert len(index) == len(SHARDS)
    assert [index[k] for k in (3, -1)] == [SHARDS[3], SHARDS[-1]]
    assert list(index[2:9:3]) == SHARDS[2:9:3]
    with pytest.raises(IndexError):
        index[len(SHARDS)]


def test_equal_entries_give_equal_bytes(tmp_path: Path) -> None:
    whole, parts = ShardIndex.of(SHARDS), [ShardIndex.of(SHARDS[k : k + 1]) for k in range(len(SHARDS))]
    whole.write(tmp_path / "whole.parquet")
    joined = ShardIndex.merged(parts[::-1])
    joined.select([shard.file for shard in SHARDS]).write(tmp_path / "parts.parquet")
    assert (tmp_path / "whole.parquet").read_bytes() == (tmp_path / "parts.parquet").read_bytes()
    assert joined != whole == ShardIndex.merged(parts)


def test_columns_and_sums_are_those_of_the_entries() -> None:
    index = ShardIndex.of(SHARDS)[3:]
    shards = SHARDS[3:]
    assert index.files == [shard.file for shard in shards]
    assert index.digests == [shard.sha256 for shard in shards]
    assert index.scenarios == [shard.episode.scenario for shard in shards]
    assert index.numbers("seed").tolist() == [shard.episode.seed for shard in shards]
    assert index.numbers("samples").tolist() == [shard.samples for shard in shards]
    assert index.by_intention().tolist() == [
        [shard.by_intention.get(name, 0) for name in CLASS_NAMES] for shard in shards
    ]
    for column in ("events", "counts", "left_out"):
        assert index.totals(column) == sum((Counter(getattr(shard.episode, column)) for shard in shards), Counter())
    assert index.totals("by_origin") == sum((Counter(shard.by_origin) for shard in shards), Counter())


def test_of_several_entries_for_a_file_the_last_counts() -> None:
    changed = SHARDS[2].model_copy(update={"bytes": 7})
    merged = ShardIndex.merged([ShardIndex.of(SHARDS), ShardIndex.of([changed])])
    assert list(merged) == [*SHARDS[:2], changed, *SHARDS[3:]]


def test_an_empty_index_is_one(tmp_path: Path) -> None:
    ShardIndex.of([]).write(tmp_path / "shards.parquet")
    index = ShardIndex.read(tmp_path / "shards.parquet")
    assert list(index) == index.files == []
    assert index.totals("events") == Counter()
    assert index.by_intention().shape == (0, 7)


def test_pandas_alone_chooses_shards(tmp_path: Path) -> None:
    """As docs/dataset.md shows it."""
    ShardIndex.of(SHARDS).write(tmp_path / "shards.parquet")
    frame = pd.read_parquet(tmp_path / "shards.parquet")
    brakes = pd.json_normalize(frame["by_intention"].tolist())["hard_brake"]
    chosen = frame.loc[(frame["scenario"] == "road") & (brakes > 1), "file"]
    assert chosen.tolist() == ["road-2.parquet", "road-5.parquet"]
    assert dict(frame["events"][3]) == SHARDS[3].episode.events


def test_a_large_index_opens_without_its_entries_and_shards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """200,000 shards: counted, listed and chosen from whole columns, after one look into the folder."""
    count, looks = 200_000, []
    shards = write_many(tmp_path / "shards.parquet", count, "f")
    write_meta(tmp_path, meta_of(shards))

    def unwanted(*_: object) -> None:
        raise AssertionError("an entry is created, or a shard is opened")

    def files_in(folder: Path) -> dict[str, int]:
        looks.append(folder)
        return dict.fromkeys(shards.files, 1001)

    monkeypatch.setattr(shard_index, "_shards", unwanted)
    monkeypatch.setattr(isac_cosim.labeling.dataset.dataset, "read_table", unwanted)
    monkeypatch.setattr(isac_cosim.labeling.dataset.dataset, "files_in", files_in)
    dataset = Dataset.open(tmp_path)
    assert looks == [tmp_path / "shards"]
    assert len(dataset) == 4 * count
    assert dataset.meta.by_intention() == dict.fromkeys(CLASS_NAMES, 0) | {
        "hard_brake": count, "overtake": 2 * count, "following": count,
    }  # fmt: skip
    assert (dataset.meta.by_origin(), dataset.meta.left_out()) == (
        {"commanded": 2 * count, "natural": 2 * count}, {"no_uv": 3 * count},
    )  # fmt: skip
    assert len(dataset.digest) == 64
    assert (tmp_path / "dataset.json").stat().st_size < 2000
    monkeypatch.undo()
    assert dataset.meta.shards[count - 1].file == f"road-{count}.parquet"


def column(name: str, value: object) -> Callable[[pa.Table], pa.Table]:
    """A change of a column's third value."""

    def changed(table: pa.Table) -> pa.Table:
        values = table[name].to_pylist()
        values[2] = value
        position = table.schema.get_field_index(name)
        return table.set_column(position, table.schema.field(name), pa.array(values, table.schema.field(name).type))

    return changed


WRONG = {
    "outside": ("a file's name is wrong", column("file", "../../evil-1.parquet")),
    "line break": ("a file's name is wrong", column("file", "ramp-0.parquet\n")),
    "other scenario": ("not of its episode is wrong", column("scenario", "ramp")),
    "other seed": ("not of its episode is wrong", column("seed", 9)),
    "digest": ("a digest is wrong", column("sha256", "0" * 63)),
    "version": ("a schema version is wrong", column("schema_version", 9)),
    "twice": ("listed twice", lambda table: pa.concat_tables([table, table])),
    "columns": ("its columns differ", lambda table: table.drop_columns("seed")),
}


@pytest.mark.parametrize("fault", WRONG)
def test_rows_that_no_shard_can_have_are_noticed(tmp_path: Path, fault: str) -> None:
    """Names above all, which could lead out of the folder."""
    path = tmp_path / "shards.parquet"
    ShardIndex.of(SHARDS).write(path)
    message, change = WRONG[fault]
    pq.write_table(change(pq.read_table(path)), path)
    with pytest.raises(InputError, match=rf"shards\.parquet: not the index of a dataset \(.*{message}"):
        ShardIndex.read(path)


def test_a_damaged_or_missing_index_is_noticed(tmp_path: Path) -> None:
    write_meta(tmp_path, meta_of(ShardIndex.of(SHARDS)))
    path = tmp_path / "shards.parquet"
    content = path.read_bytes()
    ShardIndex.of(SHARDS[1:]).write(path)
    with pytest.raises(InputError, match=r"its bytes differ from the digest in dataset\.json; run the same `cosim gen"):
        read_meta(tmp_path)
    for damaged in (content[:-9], b"", bytes(100)):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=r"not the index of a dataset .*; run the same `cosim generate` again"):
            read_meta(tmp_path)
    path.unlink()
    with pytest.raises(InputError, match=r"not the index of a dataset .*No such file.*; run the same `cosim generate`"):
        Dataset.open(tmp_path)


def test_a_scenario_that_is_not_listed_is_noticed(tmp_path: Path) -> None:
    write_meta(tmp_path, meta_of(ShardIndex.of(SHARDS)).model_copy(update={"scenarios": SCENARIOS[1:]}))
    with pytest.raises(InputError, match="has shards of scenarios that it does not list: ramp"):
        read_meta(tmp_path)


def test_datasets_without_an_index_have_the_same_shards(tmp_path: Path) -> None:
    write_meta(tmp_path, meta_of(ShardIndex.of(SHARDS)))
    assert "shards" not in json.loads((tmp_path / "dataset.json").read_text())
    without_index(tmp_path)
    former = read_meta(tmp_path)
    assert former is not None
    assert former.shards == ShardIndex.of(SHARDS)
    assert np.sum(former.shards.by_intention()) == former.samples
