"""What a CaSTFormer does with windows of each intention: attention, gates, residuals and weights of its branches."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pydantic import Field

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import Settings
from isac_cosim.evaluation.on_windows.predictions import BATCH, Predictions
from isac_cosim.evaluation.statistics import Estimate, of_left_out
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.data.windows import Ends, Records, batches
from isac_cosim.models.networks.castformer_inspection import BRANCHES, STREAMS, Inspection
from isac_cosim.models.predictors.castformer import CastformerPredictor, CastformerSettings
from isac_cosim.models.runs.run import Run


class ExplainedIntention(Settings):
    """Means over the windows of one intention, with 95 % intervals over the scenario seeds.

    n: number of windows. age_s: mean age of what RSF attends to, s before the end of the window, by the stream that
    asks. gate, residual: of CPE by stream, as in `Inspection`. weight: of FSN by branch. Empty for modules that are
    off.
    """

    n: int = Field(ge=0)
    age_s: dict[str, Estimate] = Field(default_factory=dict)
    gate: dict[str, Estimate] = Field(default_factory=dict)
    residual: dict[str, Estimate] = Field(default_factory=dict)
    weight: dict[str, Estimate] = Field(default_factory=dict)


def check_explainable(run: Run) -> CastformerPredictor:
    """Return the predictor of a run. Raises InputError unless its inside can be shown."""
    if not isinstance(run.predictor, CastformerPredictor):
        raise InputError(
            f"--explain: {run.path} is of {run.card.settings.model}; only castformer has attention, gates and weights "
            "to show; leave the option out"
        )
    if not is_explainable(run):
        raise InputError(f"--explain: {run.path} has none of the modules rsf, cpe and fsn; leave the option out")
    return run.predictor


def is_explainable(run: Run) -> bool:
    """Return whether a run has modules whose inside can be shown."""
    return isinstance(run.predictor, CastformerPredictor) and bool(run.predictor.network.settings.modules)


def inspect_windows(run: Run, records: Records, ends: Ends) -> Inspection:
    """Return what the modules of a run do with windows of records. Raises InputError as `check_explainable`."""
    predictor = check_explainable(run)
    parts = [predictor.inspect(windows) for windows in batches(records, ends, run.card.settings.windows, BATCH)]
    return Inspection(
        **{
            name: None if getattr(parts[0], name) is None else np.concatenate([getattr(part, name) for part in parts])
            for name in ("attention", "gate", "residual", "weight")
        }
    )


def mean_age_s(attention: Array, frame_s: float) -> Array:
    """Return the mean age of the frames that are attended to, s, (n, 2); attention: (n, 2, T), as in `Inspection`."""
    weight = attention.sum(axis=2)
    ages = (attention @ (frame_s * np.arange(attention.shape[2]))) / np.maximum(weight, 1e-12)
    return np.asarray(ages)


def explain(run: Run, records: Records, ends: Ends, predictions: Predictions) -> dict[str, ExplainedIntention]:
    """Return the means over the windows of each intention, `following` included where there are windows of it.

    predictions: of the run on the same windows. Raises InputError as `check_explainable`.
    """
    seen = inspect_windows(run, records, ends)
    frame_s = run.card.settings.of(CastformerSettings).frame_s
    age = None if seen.attention is None else mean_age_s(seen.attention, frame_s)
    named = (("age_s", age, STREAMS), ("gate", seen.gate, STREAMS), ("residual", seen.residual, STREAMS))
    result = {}
    for intention in Intention:
        rows = predictions.label == intention
        if not rows.any():
            continue
        groups = predictions.group[rows].astype(str)
        means: Mapping[str, dict[str, Estimate]] = {
            name: {} if values is None else _means(values[rows], groups, columns)
            for name, values, columns in (*named, ("weight", seen.weight, BRANCHES))
        }
        result[intention.text] = ExplainedIntention(n=int(rows.sum()), **means)
    return result


def _means(values: Array, groups: Array, columns: tuple[str, ...]) -> dict[str, Estimate]:
    """Return the mean of each column of values (n, c), with its interval over the groups, (n,)."""
    names = np.unique(groups)
    left_out = np.array([values[groups != name].mean(axis=0) if (groups != name).any() else np.nan for name in names])
    if left_out.ndim == 1:
        left_out = np.full((len(names), values.shape[1]), np.nan)
    return {
        column: of_left_out(np.array([values[:, k].mean()]), left_out[None, :, k]) for k, column in enumerate(columns)
    }
