"""Boosted trees on disk: the same trees give the same bytes, and reading them executes nothing."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path, PurePosixPath
from typing import Any

from sklearn.ensemble import HistGradientBoostingClassifier

from isac_cosim.base.files import replace_file

TRUSTED = (
    "numpy.dtype",
    "sklearn._loss.link.Interval",
    "sklearn._loss.link.LogLink",
    "sklearn._loss.link.LogitLink",
    "sklearn._loss.link.MultinomialLogit",
    "sklearn._loss.loss.HalfBinomialLoss",
    "sklearn._loss.loss.HalfMultinomialLoss",
    "sklearn.ensemble._hist_gradient_boosting.binning._BinMapper",
    "sklearn.ensemble._hist_gradient_boosting.predictor.TreePredictor",
)
"""The only types, beside plain ones, that a file of trees may hold."""
SCHEMA = "schema.json"
"""The member of a skops archive that describes the object; the others are its arrays."""


def write_trees(path: Path, trees: HistGradientBoostingClassifier) -> None:
    """Write trees as a skops archive, completely or not at all. Raises OutputError."""
    import skops.io

    content = reproducible(skops.io.dumps(trees))
    replace_file(path, lambda partial: partial.write_bytes(content))


def read_trees(path: Path) -> HistGradientBoostingClassifier:
    """Read what `write_trees` wrote. Raises ValueError, or what skops raises, if the file holds anything else."""
    import skops.io

    trees = skops.io.load(path, trusted=list(TRUSTED))
    if not isinstance(trees, HistGradientBoostingClassifier):
        raise ValueError(f"{path.name} holds no trees")
    return trees


def reproducible(archive: bytes) -> bytes:
    """Return a skops archive without what differs from one writing to the next.

    skops stamps the members with the time of day, and numbers objects, and the files of their arrays, by their address
    in memory. Here objects are numbered in the order of the description, and every time is that of the zip epoch.
    """
    with zipfile.ZipFile(io.BytesIO(archive)) as source:
        members = {name: source.read(name) for name in source.namelist()}
    numbers: dict[str, int] = {}
    schema = _renumbered(json.loads(members.pop(SCHEMA)), numbers)
    renamed = {_renamed(name, numbers): content for name, content in members.items()}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as target:
        for name in sorted(renamed):
            target.writestr(zipfile.ZipInfo(name), renamed[name])
        target.writestr(zipfile.ZipInfo(SCHEMA), json.dumps(schema, indent=2))
    return buffer.getvalue()


def _renumbered(node: Any, numbers: dict[str, int]) -> Any:
    """Return a node of the description with objects numbered from 0; numbers: from the addresses met so far."""
    if isinstance(node, list):
        return [_renumbered(item, numbers) for item in node]
    if not isinstance(node, dict):
        return node
    content: dict[str, Any] = {}
    for key, value in node.items():
        if key == "__id__":
            content[key] = numbers.setdefault(str(value), len(numbers))
        elif key == "file" and isinstance(value, str):
            content[key] = _renamed(value, numbers)
        else:
            content[key] = _renumbered(value, numbers)
    return content


def _renamed(name: str, numbers: dict[str, int]) -> str:
    """Return the name of an array's file, which is the address of the array and a suffix, with its number instead."""
    path = PurePosixPath(name)
    return f"{numbers.setdefault(path.stem, len(numbers))}{path.suffix}"
