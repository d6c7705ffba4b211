"""What is wrong with the rows of a shard: held against its entry in the index, the lengths of records, and sense.

Digests show that a file is the one that was written. These checks hold for files that others made, too.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from isac_cosim.base.stored.tables import check_types
from isac_cosim.labeling.dataset.meta import Meta
from isac_cosim.labeling.dataset.shard import ARRAYS, CLASS_NAMES, Shard, schema
from isac_cosim.labeling.dataset.state_columns import states_of

ORIGINS = ("natural", "reaction", "commanded")
LARGEST_DB = 1000.0
"""No SNR is larger, or smaller than its negative; NaN is that of a sensor without one."""
TIMES = ("t_start", "t_onset", "t_commit", "t_end")
"""The columns of times that every sample has, in their order."""


def check_rows(table: pa.Table, shard: Shard, meta: Meta, dropped: bool) -> None:
    """Raise ValueError with the first fault of a shard's columns, as `read_table` returns them: any of its columns.

    shard: its entry in the index. meta: of its dataset. dropped: whether it holds dropped pull-outs.
    """
    expected = schema(*meta.lengths)
    check_types(table, pa.schema([expected.field(name) for name in table.column_names if name in expected.names]))
    for fault in row_faults(table, shard, dropped):
        raise ValueError(fault)


def row_faults(table: pa.Table, shard: Shard, dropped: bool) -> Iterator[str]:
    """Yield what is wrong with the values in some columns of a shard, whose types are right; see `check_rows`."""
    if len(table) != shard.samples:
        yield f"it has {len(table)} rows, and {shard.samples} in the index"
        return
    names = set(table.column_names)
    for name, value in (("scenario", shard.episode.scenario), ("seed", shard.episode.seed)):
        if name in names and not _all(pc.equal(table[name], value)):
            yield f"{name}: is not that of the shard's episode, {value}"
    yield from _identity_faults(table, names, shard, dropped)
    yield from _label_faults(table, names, shard)
    yield from _time_faults(table, names)
    if "n_sites" in names and not _all(pc.greater_equal(table["n_sites"], 0)):
        yield "n_sites: is negative"
    if "breaks" in names and not _all(pc.greater_equal(table["breaks"], 0)):
        yield "breaks: is negative"
    for name, most in (("right_share", 1.0), ("position_sd_m", np.inf)):
        if name in names:
            values = table[name].to_numpy()
            if not (np.isnan(values) | ((values >= 0) & (values <= most) & np.isfinite(values))).all():
                yield f"{name}: is not between 0 and {most:g}"
    if "snr_db" in names and (np.abs(table["snr_db"].to_numpy()) > LARGEST_DB).any():
        yield f"snr_db: is beyond {LARGEST_DB:g} dB"
    for name in ("x0", "y0"):
        if name in names and not np.isfinite(table[name].to_numpy()).all():
            yield f"{name}: is not finite"
    for name in ARRAYS:
        if name in names and not np.isfinite(states_of(table[name])).all():
            yield f"{name}: holds values that are not finite"


def _identity_faults(table: pa.Table, names: set[str], shard: Shard, dropped: bool) -> Iterator[str]:
    """Yield what is wrong with the samples' ids, and with what they are."""
    if dropped and "pull_out" in names and not _all(pc.not_equal(table["pull_out"], "")):
        yield "pull_out: is missing in a dropped pull-out"
    if "sample_id" not in names:
        return
    ids = table["sample_id"]
    prefix = re.escape(shard.file.removesuffix(".parquet"))
    if pc.count_distinct(ids).as_py() != len(ids):
        yield "sample_id: sample ids are not unique"
    if not _all(pc.match_substring_regex(ids, rf"^{prefix}-{'p' if dropped else ''}\d+(-r\d+)?$")):
        yield "sample_id: sample ids do not belong to the shard's episode"


def _label_faults(table: pa.Table, names: set[str], shard: Shard) -> Iterator[str]:
    """Yield what is wrong with intentions, labels, origins and causes."""
    numbers = {name: k for k, name in enumerate(CLASS_NAMES)}
    labels: dict[str, npt.NDArray[Any]] = {}
    if "label" in names:
        labels["label"] = table["label"].to_numpy()
    if "intention" in names:
        labels["intention"] = np.array([numbers.get(name, -1) for name in table["intention"].to_pylist()], np.int64)
    for name, label in labels.items():
        if len(label) and not 0 <= label.min() <= label.max() < len(CLASS_NAMES):
            yield f"{name}: is not an intention in every row"
            return
    if len(labels) == 2 and (labels["label"] != labels["intention"]).any():
        yield "label: label and intention disagree"
    for name, label in labels.items():
        counts = np.bincount(label.astype(np.int64), minlength=len(CLASS_NAMES)).tolist()
        if counts != [shard.by_intention.get(intention, 0) for intention in CLASS_NAMES]:
            yield f"{name}: the numbers of samples by intention are not those in the index"
    if "origin" in names:
        if not _all(pc.is_in(table["origin"], pa.array(ORIGINS))):
            yield f"origin: is not one of {', '.join(ORIGINS)}"
        elif Counter(table["origin"].to_pylist()) != Counter(shard.by_origin):
            yield "origin: the numbers of samples by origin are not those in the index"
        if "cause" in names and not _all(
            pc.equal(pc.not_equal(table["cause"], ""), pc.equal(table["origin"], "reaction"))
        ):
            yield "cause: reactions are not the samples with a cause"


def _time_faults(table: pa.Table, names: set[str]) -> Iterator[str]:
    """Yield what is wrong with the times that are there."""
    present = [name for name in TIMES if name in names]
    times = [table[name].to_numpy() for name in present]
    for name, values in zip(present, times, strict=True):
        if not np.isfinite(values).all():
            yield f"{name}: times are not finite"
            return
    for k, name in enumerate(present[1:]):
        if (times[k + 1] < times[k]).any():
            yield f"{name}: times are not in the order start, onset, commit, end"
    for name in ("t_pass", "t_pair_end", "tv_departed"):
        if name in names and np.isinf(table[name].to_numpy()).any():
            yield f"{name}: times are not finite"


def _all(mask: Any) -> bool:
    """Return whether a mask is true in every row, of which there may be none."""
    return bool(pc.all(mask, min_count=0).as_py())
