"""Runs and datasets in which something was changed and every digest made right again, as whoever forges one would."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from isac_cosim.base.files import content_digest, file_digest
from isac_cosim.labeling.dataset.dataset import DROPPED_PULL_OUTS, INDEX_FILE, META_FILE, ROADS, SHARDS

CARD_FILE = "run.json"
PULL_OUTS_KEY = b"cosim.pull_outs"


def resealed(content: dict[str, Any]) -> dict[str, Any]:
    """The content of a sealed file with the digest that belongs to it; unchanged if it has none."""
    if "sha256" not in content:
        return content
    values = {name: value for name, value in content.items() if name != "sha256"}
    return {**values, "sha256": content_digest(values)}


def reseal(path: Path) -> None:
    """Make the digest of a sealed file right; of one that is no JSON, there is none."""
    try:
        content = json.loads(path.read_bytes())
    except (OSError, RecursionError, ValueError):
        return
    if isinstance(content, dict):
        path.write_text(json.dumps(resealed(content)))


def forge_run(folder: Path) -> None:
    """Make all digests of a run right."""
    path = folder / CARD_FILE
    try:
        content = json.loads(path.read_bytes())
        for name in content["files"]:
            content["files"][name] = file_digest(folder / name)
        path.write_text(json.dumps(content))
    except (AttributeError, KeyError, OSError, RecursionError, TypeError, ValueError):
        return
    reseal(path)


def forge_dataset(folder: Path) -> None:
    """Make all digests of a dataset right, as far as its index and its description can still be read."""
    index, path = folder / INDEX_FILE, folder / META_FILE
    for dropped in (folder / DROPPED_PULL_OUTS).glob("*.parquet"):
        _belong_together(folder / SHARDS / dropped.name, dropped)
    try:
        table = pq.read_table(index)
        digests = [file_digest(folder / SHARDS / name) for name in table["file"].to_pylist()]
        if digests != table["sha256"].to_pylist():
            column = table.schema.get_field_index("sha256")
            table = table.set_column(column, table.schema.field("sha256"), pa.array(digests, pa.string()))
            pq.write_table(table, index, compression="zstd", write_page_checksum=True)
    except (KeyError, OSError, TypeError, ValueError):
        pass
    try:
        content = json.loads(path.read_bytes())
        content["index_sha256"] = file_digest(index)
        for name in content["roads"]:
            content["roads"][name] = file_digest(folder / ROADS / name)
        path.write_text(json.dumps(content))
    except (AttributeError, KeyError, OSError, RecursionError, TypeError, ValueError):
        return
    reseal(path)


def _belong_together(shard: Path, dropped: Path) -> None:
    """Make the digest right that a shard holds of its shard of dropped pull-outs."""
    try:
        table, digest = pq.read_table(shard), file_digest(dropped).encode()
        metadata = dict(table.schema.metadata)
        if metadata[PULL_OUTS_KEY] != digest:
            pq.write_table(table.replace_schema_metadata(metadata | {PULL_OUTS_KEY: digest}), shard, compression="zstd")
    except (KeyError, OSError, TypeError, ValueError):
        return


def as_former_run(folder: Path) -> None:
    """Make a run one of the versions that stored no digests."""
    path = folder / CARD_FILE
    content = json.loads(path.read_bytes())
    del content["files"], content["sha256"]
    path.write_text(json.dumps({**content, "schema_version": 1}))
