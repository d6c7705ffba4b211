"""Every prediction behind `metrics.json` as a table, so that anybody can recompute its figures with other tools.

One row a window and run. The columns are described in `docs/predictors.md`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from isac_cosim.base.files import replace_file
from isac_cosim.evaluation.on_windows.passing import Passing
from isac_cosim.evaluation.on_windows.predictions import Predictions
from isac_cosim.evaluation.on_windows.repeats import MeasuredRun
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.runs.run import Run
from isac_cosim.models.scores import open_set

PREDICTIONS_FILE = "predictions.parquet"
DRAWN, AT_LEAD, AT_END, DROPPED = "drawn", "at_lead", "at_end", "dropped_pull_out"
"""What a window is for: the scores of all windows, those at a fixed lead time, the window-end curve, or the question
whether the TV passes the UV, of a pull-out that is in no class."""


def write_predictions(measured: Sequence[MeasuredRun], folder: Path, passing: Passing | None = None) -> Path:
    """Write the predictions of all measured runs into a folder, completely or not at all. Returns the file's path.

    passing: the windows of pull-outs. The same predictions give the same bytes. Raises OutputError.
    """
    path = folder / PREDICTIONS_FILE
    # Without the metadata of pandas, which names the version that wrote it.
    rows = prediction_table(measured, passing)
    table = pa.Table.from_pandas(rows, preserve_index=False).replace_schema_metadata(None)
    replace_file(path, lambda partial: pq.write_table(table, partial, compression="zstd"))
    return path


def prediction_table(measured: Sequence[MeasuredRun], passing: Passing | None = None) -> pd.DataFrame:
    """Return one row a window and run, the evaluated run first.

    passing: the windows of pull-outs; without them, the table lacks the columns about passing.
    """
    parts = []
    for number, member in enumerate(measured):
        purposes = [
            (DRAWN, np.nan, member.predictions),
            *((AT_LEAD, lead_s, predictions) for lead_s, predictions in member.at_leads.items()),
            *((AT_END, end_s, predictions) for end_s, predictions in member.at_ends.items()),
            *(() if member.dropped is None else ((DROPPED, np.nan, member.dropped),)),
        ]
        of_run = []
        for purpose, at_s, predictions in purposes:
            part = _rows(member.run, predictions)
            part.insert(0, "run", np.int64(number))
            part.insert(1, "name", member.result.name)
            part.insert(2, "windows", purpose)
            part.insert(3, "at_s", at_s)
            of_run.append(part)
        table = pd.concat(of_run, ignore_index=True)
        parts.append(table if passing is None else _with_passing(table, passing))
    return pd.concat(parts, ignore_index=True)


def _with_passing(table: pd.DataFrame, passing: Passing) -> pd.DataFrame:
    """Return a run's rows with what is known and answered about passing; dropped pull-outs are of no known class."""
    pull_outs = passing.pull_outs.table.reindex(table["sample_id"]).reset_index(drop=True)
    pull_outs["pull_out"] = pull_outs["pull_out"].fillna("")
    asked = table["windows"].isin((DRAWN, DROPPED)) & (pull_outs["pull_out"] != "")
    for within_s, probability in passing.probability.items():
        # In the order of these rows: windows of samples first, then those of dropped pull-outs.
        pull_outs.loc[asked, f"p_pass_within_{within_s:g}_s"] = probability
    table["known"] &= table["windows"] != DROPPED
    return pd.concat([table, pull_outs], axis=1)


def _rows(run: Run, predictions: Predictions) -> pd.DataFrame:
    """Return a row for each predicted window."""
    card, outputs = run.card, predictions.outputs
    scenario, _, seed = zip(*(str(group).rpartition("-") for group in predictions.group), strict=True)
    scores = {name: score(outputs) for name, score in open_set.of_run(run).items()}
    rejected = np.zeros(len(predictions.label), dtype=bool)
    if card.unknown_threshold is not None:
        rejected = scores[card.unknown_score] < card.unknown_threshold
    return pd.DataFrame(
        {
            "sample_id": predictions.sample_id.astype(str),
            "scenario": scenario,
            "seed": np.array(seed, dtype=np.int64),
            "origin": predictions.origin.astype(str),
            "intention": [Intention(label).text for label in predictions.label],
            "label": predictions.label,
            "known": predictions.known,
            "end_s": predictions.end_s,
            "end_after_onset_s": predictions.after_onset_s,
            "lead_s": predictions.lead_s,
            "snr_db": predictions.snr_db,
            "n_sites": predictions.n_sites,
            "keeps_left": predictions.keeps_left,
            "predicted": [card.classes[k] for k in predictions.predicted],
            "rejected": rejected,
            **{f"p_{name}": outputs.probabilities[:, k] for k, name in enumerate(card.classes)},
            **{f"logit_{name}": outputs.logits[:, k] for k, name in enumerate(card.classes)},
            **{f"score_{name}": values for name, values in scores.items()},
        }
    )
