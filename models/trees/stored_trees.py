"""Boosted trees on disk: the same trees give the same bytes, and reading them executes nothing."""

from __future__ import annotations

import io
import json
import warnings
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from isac_cosim.base.files import replace_file
from isac_cosim.base.stored.archives import check_archive
from isac_cosim.base.stored.errors import READ_ERRORS, reason_of

if TYPE_CHECKING:
    from sklearn.ensemble import HistGradientBoostingClassifier

OBJECTS = (
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
"""The only types, beside plain ones and the classifier, that a file of trees may hold."""
TYPES = (
    *OBJECTS,
    "sklearn.ensemble._hist_gradient_boosting.gradient_boosting.HistGradientBoostingClassifier",
    "sklearn._loss._loss.CyHalfBinomialLoss",
    "sklearn._loss._loss.CyHalfMultinomialLoss",
    "sklearn.preprocessing._label.LabelEncoder",
    "numpy.random._generator.Generator",
    *(f"numpy.{name}" for name in ("ndarray", "bool", "bool_", "float32", "float64", "int32", "int64", "uint8")),
    *(f"numpy.{name}" for name in ("uint32", "uint64")),
    *(f"builtins.{name}" for name in ("dict", "list", "tuple", "str", "int", "float", "bool", "NoneType")),
)
"""All types in a file of trees; skops by itself allows every estimator of scikit-learn."""
SCHEMA = "schema.json"
"""The member of a skops archive that describes the object; the others are its arrays."""


def write_trees(path: Path, trees: HistGradientBoostingClassifier) -> None:
    """Write trees as a skops archive, completely or not at all. Raises OutputError."""
    import skops.io

    # The mapper remembers on how many threads it was fitted, of which nothing else depends.
    trees._bin_mapper.n_threads = 1
    content = reproducible(skops.io.dumps(trees))
    replace_file(path, lambda partial: partial.write_bytes(content))


def read_trees(
    path: Path, n_features: int | Sequence[int] | None, classes: Sequence[int]
) -> HistGradientBoostingClassifier:
    """Read what `write_trees` wrote.

    n_features: that the trees have to take, one number or several to choose from; None for any. classes: the numbers of
    which theirs are some.
    Raises one of READ_ERRORS, which names the tree, if the file holds anything else, or trees that do not end or look
    at what is not there: scikit-learn's compiled loops do not check.
    """
    import skops.io
    from sklearn.ensemble import HistGradientBoostingClassifier
    from sklearn.exceptions import InconsistentVersionWarning

    check_archive(path)
    with zipfile.ZipFile(path) as archive:
        for kind in _types_in(json.loads(archive.read(SCHEMA))):
            if kind not in TYPES:
                raise ValueError(f"{path.name}: holds an object of the type {kind}, which trees have not")
    try:
        with warnings.catch_warnings():
            # Whether trees of another version can answer is found out below.
            warnings.simplefilter("ignore", InconsistentVersionWarning)
            trees = skops.io.load(path, trusted=list(OBJECTS))
    except READ_ERRORS as error:
        raise ValueError(f"{path.name}: {reason_of(error)}") from None
    if not isinstance(trees, HistGradientBoostingClassifier):
        raise ValueError(f"{path.name}: holds no trees")
    for fault in _faults(trees, [n_features] if isinstance(n_features, int) else n_features, classes):
        raise ValueError(f"{path.name}: {fault}")
    return trees


def _types_in(node: Any) -> Iterator[str]:
    """Yield the types of all objects in a description."""
    if isinstance(node, dict):
        if "__loader__" in node:
            yield f"{node.get('__module__')}.{node.get('__class__')}"
        # What `type` nodes hold is a name, which skops looks up.
        node = list(node.values())
    for item in node if isinstance(node, list) else ():
        yield from _types_in(item)


def _faults(
    trees: HistGradientBoostingClassifier, widths: Sequence[int] | None, classes: Sequence[int]
) -> Iterator[str]:
    """Yield what is wrong with trees, so far as their answers depend on it."""
    state = vars(trees)
    if _hides_a_part(trees):
        yield "an attribute hides a part of the classifier"
        return
    known = state.get("classes_")
    if not isinstance(known, np.ndarray) or known.ndim != 1 or known.dtype.kind not in "iu" or len(known) < 2:
        yield "classes_: are not two or more whole numbers"
        return
    if (np.diff(known.astype(np.int64)) <= 0).any() or not set(known.tolist()) <= set(classes):
        yield f"classes_: are {known.tolist()}, not some of {[int(known) for known in classes]} in order"
    width = state.get("n_features_in_")
    if type(width) is not int or width < 1 or (widths is not None and width not in widths):
        wanted = "a positive whole number" if widths is None else " or ".join(map(str, widths))
        yield f"n_features_in_: is {width!r}, not {wanted}"
        return
    each = 1 if len(known) == 2 else len(known)
    if type(state.get("n_trees_per_iteration_")) is not int or state["n_trees_per_iteration_"] != each:
        yield f"n_trees_per_iteration_: is not {each}, which {len(known)} classes need"
    baseline = state.get("_baseline_prediction")
    if not isinstance(baseline, np.ndarray) or baseline.shape != (1, each) or baseline.dtype != np.float64:
        yield "_baseline_prediction: is not a number for each class"
    elif not np.isfinite(baseline).all():
        yield "_baseline_prediction: is not finite"
    loss = "HalfBinomialLoss" if each == 1 else "HalfMultinomialLoss"
    if type(state.get("_loss")).__name__ != loss or (each > 1 and getattr(state["_loss"], "n_classes", 0) != each):
        yield f"_loss: is not that of {len(known)} classes"
    if state.get("_preprocessor") is not None or hasattr(trees, "feature_names_in_") or hasattr(trees, "_in_fit"):
        yield "_preprocessor: there is one, or names of features, which trees have not"
    mapper = state.get("_bin_mapper")
    categorical = getattr(mapper, "is_categorical_", None)
    if type(mapper).__name__ != "_BinMapper" or _hides_a_part(mapper):
        yield "_bin_mapper: is none"
    elif not isinstance(categorical, np.ndarray) or categorical.shape != (width,) or categorical.any():
        yield "_bin_mapper: has features that are categories"
    yield from _tree_faults(state.get("_predictors"), width, each)


def _tree_faults(rounds: Any, width: int, each: int) -> Iterator[str]:
    """Yield what is wrong with the nodes of all trees. width: number of features. each: trees in a round."""
    from sklearn.ensemble._hist_gradient_boosting.common import PREDICTOR_RECORD_DTYPE
    from sklearn.ensemble._hist_gradient_boosting.predictor import TreePredictor

    if not isinstance(rounds, list) or not all(isinstance(part, list) and len(part) == each for part in rounds):
        yield f"_predictors: are not rounds of {each} trees"
        return
    for number, tree in enumerate(tree for part in rounds for tree in part):
        nodes = getattr(tree, "nodes", None)
        if type(tree) is not TreePredictor or _hides_a_part(tree):
            yield f"tree {number}: is none"
        elif not isinstance(nodes, np.ndarray) or nodes.dtype != PREDICTOR_RECORD_DTYPE or nodes.ndim != 1:
            yield f"tree {number}: its nodes are not those of a tree"
        elif not len(nodes):
            yield f"tree {number}: has no nodes"
        else:
            yield from (f"tree {number}: {fault}" for fault in _node_faults(nodes, width))
            yield from (
                f"tree {number}: {name} is not an array of sets"
                for name in ("raw_left_cat_bitsets", "binned_left_cat_bitsets")
                if not _are_bitsets(getattr(tree, name, None))
            )


def _node_faults(nodes: np.ndarray[Any, Any], width: int) -> Iterator[str]:
    """Yield what is wrong with a tree's nodes. Each child comes after its parent, so that every path ends at a leaf."""
    place = np.arange(len(nodes))
    inner = nodes["is_leaf"] == 0
    for side in ("left", "right"):
        child = nodes[side].astype(np.int64)
        if wrong := np.flatnonzero(inner & ((child <= place) | (child >= len(nodes)))).tolist():
            yield f"the {side} child of node {wrong[0]} is node {child[wrong[0]]}, of {len(nodes)}"
    feature = nodes["feature_idx"]
    if wrong := np.flatnonzero(inner & ((feature < 0) | (feature >= width))).tolist():
        yield f"node {wrong[0]} asks for feature {feature[wrong[0]]}, of {width}"
    if nodes["is_categorical"].any():
        yield "a node asks for a category"
    if np.isnan(nodes["num_threshold"][inner]).any() or not np.isfinite(nodes["value"]).all():
        yield "a threshold or a value is not a number"


def _hides_a_part(instance: object) -> bool:
    """Return whether an attribute of an object takes the place of one of its class, such as a method."""
    return any(hasattr(type(instance), name) for name in vars(instance))


def _are_bitsets(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype == np.uint32 and value.ndim == 2 and value.shape[1] == 8


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
