"""Datasets as former versions of the tool stored them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from isac_cosim.labeling.dataset.dataset import INDEX_FILE, META_FILE, read_meta
from isac_cosim.labeling.dataset.record_point import in_plane
from isac_cosim.labeling.dataset.shard import ARRAYS, PASSING, TRACK
from isac_cosim.labeling.dataset.state_columns import states_of


def without_index(folder: Path) -> dict[str, Any]:
    """Replace the index of a dataset by a list of its shards in `dataset.json`, and return that file's content."""
    meta = read_meta(folder)
    assert meta is not None
    content: dict[str, Any] = json.loads((folder / META_FILE).read_text())
    for later in ("index_sha256", "roads", "sha256"):
        del content[later]
    content["schema_version"] = 3
    content["shards"] = [shard.model_dump(mode="json") for shard in meta.shards]
    (folder / META_FILE).write_text(json.dumps(content))
    (folder / INDEX_FILE).unlink()
    return content


def as_schema(path: Path, version: int) -> None:
    """Rewrite a shard of the present schema as a former one stored it: before 4, positions in the scenario's plane."""
    table = pq.read_table(path)
    points = table["x0"].to_numpy(), table["y0"].to_numpy()
    for name in set(ARRAYS) & set(table.column_names) if version < 4 else ():
        place, field = table.schema.get_field_index(name), table.schema.field(name)
        flat = pa.array(in_plane(states_of(table[name]), *points).astype(np.float32).ravel())
        rows = pa.FixedSizeListArray.from_arrays(flat, type=field.type.value_type)
        table = table.set_column(place, field, pa.FixedSizeListArray.from_arrays(rows, type=field.type))
    lacking = [*TRACK]
    if version < 4:
        lacking += ["x0", "y0", "tv_departed"]
    if version < 3:
        lacking += ["cause", "cause_ttc_s", "tv_run_in", *PASSING]
        origins = ["stimulated" if name == "commanded" else "natural" for name in table["origin"].to_pylist()]
        place = table.schema.get_field_index("origin")
        table = table.set_column(place, table.schema.field(place), pa.array(origins))
    metadata = dict(table.schema.metadata)
    episode = json.loads(metadata[b"cosim.episode"]) | {"schema_version": version}
    table = table.drop_columns([name for name in lacking if name in table.column_names])
    pq.write_table(table.replace_schema_metadata({**metadata, b"cosim.episode": json.dumps(episode)}), path)
