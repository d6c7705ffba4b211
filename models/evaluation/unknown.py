"""How well a run tells what it was never trained on: `following`, and an intention that was held out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from isacsim.arrays import Array
from models.evaluation.predictions import Answers
from models.run import Run
from models.scores import open_set


def entries(known: Array, unknown: Array) -> dict[str, float | None]:
    """`auroc_unknown` and `fpr_at_95_recall` of a score's values on known and on unknown windows."""
    found = open_set.told_apart(known, unknown)
    return {"auroc_unknown": found["auroc"], "fpr_at_95_recall": found["fpr_at_95_recall"]}


def against_rows(known: Array, unknown: Array) -> Callable[[npt.NDArray[np.bool_]], dict[str, float | None]]:
    """`entries` of some of the known windows, a mask (n,), against all unknown ones.

    `following` does not commit and has no lead time, so every bin of the known is held against all of it.
    """
    return lambda rows: entries(known[rows], unknown)


def unknown_metrics(run: Run, given: Answers, value: Mapping[str, Array]) -> dict[str, Any]:
    """AUROC and false-positive rate at 95 % recall of every score; `auroc_unknown` is of the run's chosen score.

    value: of every score, (n,). Of a run that an intention was held out of, `held_out` has the same for its windows.
    """
    each = {name: open_set.told_apart(v[given.known], v[given.unknown]) for name, v in value.items()}
    result: dict[str, Any] = {
        "n_unknown": int(given.unknown.sum()),
        "auroc_unknown": each[run.card.unknown_score]["auroc"],
        "unknown_score": run.card.unknown_score,
        "unknown_scores": each,
    }
    if given.left_out is not None:
        result["held_out"] = {
            "intention": given.left_out.text,
            "n": int(given.held_out.sum()),
            "unknown_scores": {
                name: open_set.told_apart(v[given.known], v[given.held_out]) for name, v in value.items()
            },
        }
    return result
