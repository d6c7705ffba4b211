"""Datasets as former versions of the tool stored them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from isac_cosim.labeling.dataset.dataset import INDEX_FILE, META_FILE, read_meta


def without_index(folder: Path) -> dict[str, Any]:
    """Replace the index of a dataset by a list of its shards in `dataset.json`, and return that file's content."""
    meta = read_meta(folder)
    assert meta is not None
    content: dict[str, Any] = json.loads((folder / META_FILE).read_text())
    for later in ("index_sha256", "roads", "sha256"):
        del content[later]
    content["shards"] = [shard.model_dump(mode="json") for shard in meta.shards]
    (folder / META_FILE).write_text(json.dumps(content))
    (folder / INDEX_FILE).unlink()
    return content
