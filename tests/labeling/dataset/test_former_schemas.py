"""Datasets that former versions of the tool wrote: which open, and as what."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.labeling.dataset.dataset import (
    Dataset,
    ShardIndex,
    write_meta,
)
from isac_cosim.labeling.dataset.pull_outs import dropped_pull_outs
from isac_cosim.labeling.dataset.record_point import in_plane
from isac_cosim.labeling.dataset.shard import PASSING, SCALARS, read_shard
from tests.support.former_dataset import as_schema, without_index
from tests.support.small_dataset import make, sample


def test_a_dataset_of_a_version_that_is_read_no_longer_is_refused_with_its_version(tmp_path: Path) -> None:
    dataset = make(tmp_path / "data", (6,))
    meta = without_index(dataset.path) | {"schema_version": 1, "versions": {"isac-cosim": "0.1.0"}}
    (dataset.path / "dataset.json").write_text(json.dumps(meta))
    with pytest.raises(InputError, match=r"dataset\.json: was written by version 0\.1\.0, which is read no longer"):
        Dataset.open(dataset.path)


@pytest.mark.parametrize("version", [2, 3])
def test_datasets_of_former_schemas_open_with_the_present_columns(tmp_path: Path, version: int) -> None:
    """Before schema 4, positions are in the plane; before schema 3, nothing has a cause, and commands stimulate."""
    dataset = make(tmp_path / "data", (6, 3))
    shards = []
    for shard in dataset.meta.shards:
        path = dataset.shard_path(shard)
        as_schema(path, version)
        stored = Counter(pq.read_table(path, columns=["origin"])["origin"].to_pylist())
        shards.append(read_shard(path).model_dump(mode="json") | {"by_origin": dict(stored)})
    meta = without_index(dataset.path)
    meta |= {"schema_version": version, "shards": shards, "run_in_s": 0.0 if version < 3 else 0.5}
    (dataset.path / "dataset.json").write_text(json.dumps(meta))
    former = Dataset.open(dataset.path)
    former.verify()
    frame = former.frame()
    assert list(frame.columns) == list(SCALARS)
    assert former.meta.by_origin() == frame["origin"].value_counts().to_dict()
    assert (frame[["x0", "y0"]] == 0.0).all(axis=None)
    rows = [sample(k, seed) for seed, count in enumerate((6, 3)) for k in range(count)]
    for name in ("tv", "uv"):
        stored_states = np.stack([in_plane(getattr(row, name), row.x0, row.y0) for row in rows])
        np.testing.assert_array_equal(former.arrays(name)[name], stored_states.astype(np.float32))
    [first, *_] = samples = former.samples(former.meta.shards[0])
    assert (first.x0, first.y0) == (0.0, 0.0)
    if version == 3:
        assert set(frame["cause"]) == {"", "debris"}
        return
    assert set(frame["origin"]) == {"natural", "commanded"}
    assert (frame["cause"] == "").all()
    assert frame["cause_ttc_s"].isna().all()
    assert len(former.frame(["cause"])) == len(former) == 9
    assert {(row.origin, row.cause) for row in samples} == {("natural", ""), ("commanded", "")}


def test_the_first_datasets_of_schema_3_open_without_their_answers(tmp_path: Path) -> None:
    dataset = make(tmp_path / "data", (6, 3))
    written = dataset.frame()
    shards = []
    for shard in dataset.meta.shards:
        path = dataset.shard_path(shard)
        pq.write_table(pq.read_table(path).drop_columns(list(PASSING)), path)
        shards.append(read_shard(path))
    write_meta(dataset.path, dataset.meta.model_copy(update={"shards": ShardIndex.of(shards)}))
    former = Dataset.open(dataset.path)
    former.verify()
    frame = former.frame()
    assert list(frame.columns) == list(SCALARS)
    assert (frame["pull_out"] == "").all()
    assert frame[["t_pass", "t_pair_end"]].isna().all(axis=None)
    assert frame.drop(columns=list(PASSING)).equals(written.drop(columns=list(PASSING)))
    assert len(former.frame(["t_pass"])) == len(former) == 9
    [first, *_] = former.samples(former.meta.shards[0])
    assert first.pull_out == ""
    assert len(dropped_pull_outs(former)) == 0


def test_datasets_of_schema_4_open_and_have_no_tracks(tmp_path: Path) -> None:
    dataset = make(tmp_path / "data", (6, 3))
    paths = [dataset.shard_path(shard) for shard in dataset.meta.shards]
    for path in paths:
        as_schema(path, 4)
    shards = ShardIndex.of(map(read_shard, paths))
    write_meta(dataset.path, dataset.meta.model_copy(update={"schema_version": 4, "shards": shards}))
    former = Dataset.open(dataset.path)
    former.verify()
    frame = former.frame()
    assert ((frame["track_id"] == "") & (frame["breaks"] == 0)).all()
    assert frame[["right_share", "position_sd_m"]].isna().all(axis=None)
    assert frame["x0"].tolist() == [100.0 * k for count in (6, 3) for k in range(count)]
    assert len(former.samples(former.meta.shards[0])) == 6
