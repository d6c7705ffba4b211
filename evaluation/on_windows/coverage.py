"""What the scores of a training will lack, said before it begins: intentions that a side of the split does not hold."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from isac_cosim.evaluation.on_windows.metrics import LEAST_IN_BIN
from isac_cosim.evaluation.on_windows.predictions import TOLERANCE_S
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.intentions import KNOWN, Intention, spoken
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.split import split
from isac_cosim.models.data.windows import COLUMNS, Records, WindowSettings, draw_ends


def records_without_states(dataset: Dataset) -> Records:
    """Return the records of a dataset with zeros for states, which are not read: enough for splits and window ends."""
    meta, table = dataset.meta, dataset.frame(COLUMNS).reset_index(drop=True)
    # One zero in memory stands for all of them.
    tv, uv = (np.broadcast_to(np.float32(0), (len(table), 6, length)) for length in (meta.tv_length, meta.uv_length))
    return Records(tv, uv, meta.tv_rate_hz, meta.uv_rate_hz, table)


def lacking(
    dataset: Dataset,
    training: FitSettings,
    evaluation: EvaluateSettings,
    sides: dict[str, list[str]] | None = None,
) -> list[str]:
    """Return what the scores of a training on a dataset will lack, one line each; nothing where they lack nothing.

    sides: the scenario seeds of each side, where they are already decided. Raises InputError where the dataset has too
    few seeds, or no record holds a window.
    """
    records = records_without_states(dataset)
    sides = sides or split(records, training.split)
    label, groups = records.label, records.groups
    taught = [intention for intention in KNOWN if intention is not training.left_out]
    lines = []
    for side in ("validation", "test"):
        held = set(label[np.isin(groups, sides[side])].tolist())
        if missing := [intention for intention in taught if intention not in held]:
            lines.append(
                f"the {side} seeds hold no {_names(missing)}: every macro-F1 on them is over "
                f"{len(taught) - len(missing)} of {len(KNOWN)} intentions; generate more seeds"
            )
    windows = training.windows
    if evaluation.end_after_s is not None:
        windows = WindowSettings.model_validate({**windows.model_dump(), "end_after_s": evaluation.end_after_s})
    ends = draw_ends(records, windows, "evaluate", evaluation.seed, per_record=evaluation.ends_per_record)
    end_s = ends.times(records)
    onset_s, commit_s = (records.table[name].to_numpy(np.float64)[ends.row] for name in ("t_onset", "t_commit"))
    early = (end_s - onset_s > -TOLERANCE_S) & (commit_s - end_s > TOLERANCE_S)
    tested = early & np.isin(groups[ends.row], sides["test"])
    counts = np.bincount(label[ends.row][tested], minlength=len(Intention))
    if few := [intention for intention in taught if counts[intention] < LEAST_IN_BIN]:
        numbers = ", ".join(f"{spoken(intention.text)} {counts[intention]}" for intention in few)
        lines.append(
            f"fewer than {LEAST_IN_BIN} test windows end before the commit of {numbers}: macro-F1 before the commit is "
            f"over {len(taught) - len(few)} of {len(KNOWN)} intentions; generate more seeds"
        )
    return lines


def _names(intentions: Sequence[Intention]) -> str:
    return ", ".join(spoken(intention.text) for intention in intentions)
