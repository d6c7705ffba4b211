"""What may happen to a file of a run or a dataset: bytes that change, and content that another hand has changed.

Everything is drawn from one `random.Random`, so that a case is known by its number.
"""

from __future__ import annotations

import copy
import io
import json
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import torch

from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.trees.stored_trees import read_trees, write_trees
from tests.support.mutations import INSERTED, KEYS, ODD_NUMBERS, ODD_TEXTS, nested, paths

ODD_VALUES: tuple[Any, ...] = (
    *ODD_NUMBERS, *ODD_TEXTS, None, True, False, [], {}, [1, 2], ["a"], {"a": 1}, nested(60), np.nan, np.inf,
)  # fmt: skip
ODD_FLOATS = (0.0, -1.0, 1.0, np.nan, np.inf, -np.inf, 1e30, 3e38, -1e9, 1e-30)
TREE_ATTRIBUTES = (
    "classes_", "n_features_in_", "n_trees_per_iteration_", "_baseline_prediction", "_predictors", "_loss",
    "_preprocessor", "_bin_mapper", "decision_function", "_label_encoder", "max_iter", "class_weight",
)  # fmt: skip


def damage(path: Path, random: Random) -> str:
    """Change a file in one way or more, and return what was done."""
    return changed(path, random, BY_CONTENT.get(path.suffix))


def changed(path: Path, random: Random, by_content: Callable[[Path, Random], str] | None) -> str:
    """Change a file in one way or more, mostly by its content, if that is known; return what was done."""
    done = []
    for _ in range(random.choice((1, 1, 1, 2))):
        if not path.is_file():
            break
        kinds: list[Callable[[Path, Random], str]] = [bytes_changed, bytes_changed, replaced]
        if by_content is not None:
            kinds += [by_content] * 6
        try:
            done.append(random.choice(kinds)(path, random))
        except Exception as error:  # what an earlier change has left cannot be read
            done.append(f"nothing ({type(error).__name__})")
    return f"{path.name}: {', '.join(done)}"


def bytes_changed(path: Path, random: Random) -> str:
    content = bytearray(path.read_bytes())
    at = random.randrange(len(content) + 1)
    end = min(len(content), at + random.choice((1, 4, 40, 4000)))
    kind = random.choice(("flip", "flip", "flip", "cut", "insert", "zero", "double", "remove"))
    if kind == "flip" and content:
        content[min(at, len(content) - 1)] ^= 1 << random.randrange(8)
    elif kind == "cut":
        del content[at:]
    elif kind == "zero":
        content[at:end] = bytes(end - at)
    elif kind == "double":
        content[at:at] = content[at:end]
    elif kind == "remove":
        del content[at:end]
    else:
        content[at:at] = random.choice(INSERTED)
    path.write_bytes(content)
    return f"{kind} at {at}"


def replaced(path: Path, random: Random) -> str:
    kind = random.choice(("missing", "empty", "folder", "loop", "noise", "other"))
    others = [other for other in path.parents[1].rglob("*") if other.is_file() and other != path]
    path.unlink()
    if kind == "empty":
        path.touch()
    elif kind == "folder":
        path.mkdir()
    elif kind == "loop":
        path.symlink_to(path)
    elif kind == "noise":
        path.write_bytes(random.randbytes(500))
    elif kind == "other":
        same = [other for other in others if other.suffix == path.suffix]
        shutil.copy(other := random.choice(same or others), path)
        return f"replaced by {other.parent.name}/{other.name}"
    return kind


def json_changed(path: Path, random: Random) -> str:
    content = json.loads(path.read_bytes())
    where = random.choice(paths(content))
    *above, key = where
    place = content
    for step in above:
        place = place[step]
    before = place[key]
    kind = random.choice(("replace", "replace", "scale", "drop", "add"))
    if kind == "scale" and isinstance(before, int | float) and not isinstance(before, bool):
        place[key] = before * random.choice((-1, 0, 0.1, 2, 1000, 10**12, 1e300))
    elif kind == "drop" and isinstance(place, dict):
        del place[key]
    elif kind == "add" and isinstance(place, dict):
        place[random.choice(KEYS)] = copy.deepcopy(random.choice(ODD_VALUES))
    else:
        place[key] = copy.deepcopy(random.choice(ODD_VALUES))
    path.write_text(json.dumps(content))
    return f"{kind} {'.'.join(map(str, where))}"


def table_changed(path: Path, random: Random) -> str:
    table = pq.read_table(path)
    metadata = table.schema.metadata
    name = random.choice(table.column_names)
    at, field = table.schema.get_field_index(name), table.schema.field(name)
    kind = random.choice(("drop", "retype", "values", "values", "values", "rows", "nulls", "metadata", "twice"))
    if kind == "drop":
        table = table.drop_columns([name])
    elif kind == "retype":
        types = (pa.string(), pa.float64(), pa.int64(), pa.int8(), pa.bool_(), pa.list_(pa.float32()))
        new = random.choice(types)
        table = table.set_column(at, pa.field(name, new), pa.array([None] * len(table), new))
    elif kind == "rows":
        order = [random.randrange(len(table)) for _ in range(random.choice((0, 1, len(table), 3 * len(table))))]
        table = table.take(pa.array(order, pa.int64()))
    elif kind == "nulls":
        table = table.set_column(at, pa.field(name, field.type), pa.nulls(len(table), field.type))
    elif kind == "metadata":
        pairs = dict(metadata or {})
        if pairs:
            key = random.choice(sorted(pairs))
            pairs[key] = pairs[key].replace(*random.choice(((b"1", b"9"), (b"{", b"["), (b":", b""), (b"0", b"-1"))))
        metadata = pairs
    elif kind == "twice":
        table = table.append_column(field, table[name])
    else:
        table = table.set_column(at, field, _odd_column(table[name], random))
    pq.write_table(table.replace_schema_metadata(metadata), path, compression="zstd")
    return f"{kind} {name}"


def _odd_column(column: pa.ChunkedArray, random: Random) -> pa.Array:
    kind = column.type
    if pa.types.is_fixed_size_list(kind):
        array = pa.concat_arrays(column.chunks)
        inner = _odd_column(pa.chunked_array([array.flatten()]), random)
        return pa.FixedSizeListArray.from_arrays(inner, type=kind)
    values = column.to_pylist()
    for _ in range(random.choice((1, 3, len(values)))):
        if values:
            values[random.randrange(len(values))] = _odd_value(kind, random)
    return pa.array(values, kind)


def _odd_value(kind: pa.DataType, random: Random) -> Any:
    if pa.types.is_floating(kind):
        return random.choice(ODD_FLOATS)
    if pa.types.is_integer(kind):
        return random.choice((0, 1, -1, 99, 127, -128, 2 ** (kind.bit_width - 1) - 1, -(2 ** (kind.bit_width - 1))))
    if pa.types.is_string(kind) or pa.types.is_dictionary(kind):
        return random.choice([text for text in ODD_TEXTS if text.isprintable()])
    if pa.types.is_map(kind):
        return [(random.choice(("natural", "x")), random.choice((0, -1, 2**31 - 1)))]
    if pa.types.is_struct(kind):
        return {kind.field(k).name: random.choice((0, 1, -1, 2**31 - 1)) for k in range(kind.num_fields)}
    return [random.choice(ODD_FLOATS)] * random.choice((0, 1, 5))


def arrays_changed(path: Path, random: Random) -> str:
    with np.load(path) as stored:
        arrays = dict(stored)
    name = random.choice(sorted(arrays))
    arrays[name] = _odd_array(arrays[name], random)
    kind = random.choice(("values", "drop", "add", "claim"))
    if kind == "drop":
        del arrays[name]
    elif kind == "add":
        arrays["extra"] = np.zeros(3)
    np.savez(path, **arrays)
    if kind == "claim":
        content = path.read_bytes()
        shapes = [text for text in (b"(21,)", b", 120)", b", 8)", b", 6)") if text in content]
        for shape in shapes[:1]:
            path.write_bytes(content.replace(shape, shape.replace(b",", b"9,")[: len(shape)]))
    return f"{kind} {name}"


def _odd_array(array: np.ndarray[Any, Any], random: Random) -> np.ndarray[Any, Any]:
    kind = random.choice(("one", "all", "shape", "type", "cut"))
    array = array.copy()
    if kind == "one" and array.size:
        flat = array.reshape(-1)
        flat[random.randrange(len(flat))] = _number(array.dtype, random)
    elif kind == "all":
        array[...] = _number(array.dtype, random)
    elif kind == "shape":
        array = array.reshape(-1) if array.ndim != 1 else array[None]
    elif kind == "type":
        array = array.astype(random.choice(("f4", "f8", "i8", "i1", "U3", "?", "c16")))
    elif array.ndim:
        array = array[: random.choice((0, 1, max(0, len(array) - 1)))]
    return array


def _number(kind: np.dtype[Any], random: Random) -> Any:
    with np.errstate(all="ignore"):
        return np.array(random.choice(ODD_FLOATS if kind.kind == "f" else (0, 1, -1, 99, 5))).astype(kind)


def tensors_changed(path: Path, random: Random) -> str:
    state = torch.load(path, weights_only=True)
    name = random.choice(sorted(state))
    kind = random.choice(("one", "all", "shape", "type", "drop", "add", "expand", "other"))
    value = state[name].clone()
    if kind == "one":
        value.view(-1)[random.randrange(value.numel())] = random.choice(ODD_FLOATS)
    elif kind == "all":
        value.fill_(random.choice(ODD_FLOATS))
    elif kind == "shape":
        value = value.reshape(-1) if value.ndim != 1 else value[None]
    elif kind == "type":
        value = value.to(random.choice((torch.float64, torch.float16, torch.int64, torch.bool, torch.complex64)))
    elif kind == "expand":
        value = torch.ones(1).expand(2 ** random.choice((10, 40)))
    elif kind == "other":
        value = random.choice((None, 3, "x", [value], {"a": value}, value.to_sparse()))
    state[name] = value
    if kind == "drop":
        del state[name]
    elif kind == "add":
        state["extra"] = torch.ones(2)
    torch.save(state, path)
    return f"{kind} {name}"


def trees_changed(path: Path, random: Random) -> str:
    kind = random.choice(("nodes", "nodes", "attribute", "schema", "schema"))
    if kind == "schema":
        with zipfile.ZipFile(path) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        description = path.with_suffix(".json")
        description.write_bytes(members["schema.json"])
        done = json_changed(description, random)
        members["schema.json"] = description.read_bytes()
        description.unlink()
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w") as archive:
            for name, content in members.items():
                archive.writestr(name, content)
        path.write_bytes(buffer.getvalue())
        return f"schema, {done}"
    trees = read_trees(path, None, KNOWN)
    if kind == "attribute":
        name = random.choice(TREE_ATTRIBUTES)
        before = getattr(trees, name, None)
        odd = _odd_array(before, random) if isinstance(before, np.ndarray) else random.choice(ODD_VALUES[:60])
        setattr(trees, name, odd)
        write_trees(path, trees)
        return f"attribute {name}"
    rounds = [tree for part in trees._predictors for tree in part]
    nodes = random.choice(rounds).nodes
    field = random.choice(nodes.dtype.names)
    place = random.randrange(len(nodes))
    value = random.choice((0, 1, 2, len(nodes), 10**9, place, np.nan, np.inf, -1, 255))
    with np.errstate(all="ignore"):
        nodes[field][place] = np.array(value).astype(nodes[field].dtype)
    write_trees(path, trees)
    return f"nodes {field} of {place} is {value}"


BY_CONTENT: dict[str, Callable[[Path, Random], str]] = {
    ".json": json_changed, ".parquet": table_changed, ".npz": arrays_changed, ".pt": tensors_changed,
    ".skops": trees_changed,
}  # fmt: skip
"""How the content of a file is changed, by its suffix."""
