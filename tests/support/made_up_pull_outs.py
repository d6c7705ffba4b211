"""Pull-outs among the made-up records, and others that are in no class; slower UVs are passed, and near ones sooner."""

from __future__ import annotations

import numpy as np
import pandas as pd

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.on_windows.passing import PullOuts
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.data.windows import Records
from tests.support.made_up import make_records

PULL_OUTS = (Intention.LEFT_LANE_CHANGE, Intention.OVERTAKE)


def passing_times(records: Records) -> tuple[Array, Array]:
    """When the TV of each record passes its UV, s, NaN for never, and until when the pair is observed, s, (N,) each."""
    tv, uv = np.asarray(records.tv, np.float64), np.asarray(records.uv, np.float64)
    gap = np.hypot(*(uv[:, :2, 0] - tv[:, :2, 0]).T)
    closing = np.hypot(*tv[:, 2:4].mean(axis=2).T) - np.hypot(*uv[:, 2:4].mean(axis=2).T)
    start, onset = (records.table[name].to_numpy() for name in ("t_start", "t_onset"))
    t_pass = np.maximum(start + gap / np.maximum(closing, 0.1), onset + 0.7)
    t_pair_end = onset + np.linspace(8.0, 30.0, len(t_pass))
    return np.where(t_pass <= t_pair_end, t_pass, np.nan), t_pair_end


def as_dropped(records: Records) -> Records:
    """The lane changes among some records, as pull-outs that are in no class."""
    changes = records.take(np.isin(records.label, PULL_OUTS))
    table = changes.table.assign(
        sample_id=changes.table["sample_id"].str.replace(r"-(\d+)$", r"-p\1", regex=True),
        label=int(Intention.LEFT_LANE_CHANGE),
    )
    return Records(changes.tv, changes.uv, changes.tv_rate_hz, changes.uv_rate_hz, table)


def make_pull_outs(records: Records, seeds: int = 8, per_class: int = 4) -> PullOuts:
    """The pull-outs of made-up records: their own changes to the left and overtakes, and dropped ones of each seed."""
    dropped = as_dropped(make_records(seeds, per_class, noise=0.5))
    sampled = records.take(np.isin(records.label, PULL_OUTS))
    parts = []
    for part, outcomes in ((sampled, ("not_passed", "overtaken")), (dropped, ("passed_did_not_return", "unresolved"))):
        t_pass, t_pair_end = passing_times(part)
        other = part.label == Intention.OVERTAKE if part is sampled else np.arange(len(part)) % 3 == 0
        columns = {"pull_out": np.where(other, outcomes[1], outcomes[0]), "t_pass": t_pass, "t_pair_end": t_pair_end}
        parts.append(pd.DataFrame(columns, index=pd.Index(part.table["sample_id"], name="sample_id")))
    return PullOuts(pd.concat(parts), dropped)
