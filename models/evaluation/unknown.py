"""How well a run separates what it was never trained on: `following`, and an intention that was held out."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from isacsim.arrays import Array
from models.evaluation.metrics import BoolArray
from models.evaluation.predictions import Predictions
from models.evaluation.score_results import HeldOutScores, Separation
from models.scores import open_set


def separation(known: Array, unknown: Array) -> Separation:
    """Return how well a score separates known windows, values (n,), from unknown ones, values (m,)."""
    return Separation(auroc=open_set.auroc(known, unknown), fpr_at_95_recall=open_set.accepted_unknown(known, unknown))


def separation_of_rows(known: Array, unknown: Array) -> Callable[[BoolArray], Separation]:
    """Return `separation` as a function of some of the known windows, a mask (n,), against all unknown ones.

    `following` does not commit and has no lead time, so every bin of the known is compared with all of it.
    """
    return lambda rows: separation(known[rows], unknown)


def following_scores(predictions: Predictions, values: Mapping[str, Array]) -> dict[str, Separation]:
    """Return how well each score separates `following`; values: of every score, (n,), by its name."""
    return {name: separation(value[predictions.known], value[predictions.unknown]) for name, value in values.items()}


def held_out_scores(predictions: Predictions, values: Mapping[str, Array]) -> HeldOutScores | None:
    """Return how well each score separates the intention left out of training, or None where none was.

    values: of every score, (n,), by its name.
    """
    if predictions.left_out is None:
        return None
    return HeldOutScores(
        intention=predictions.left_out.text,
        n=int(predictions.held_out.sum()),
        unknown_scores={
            name: separation(value[predictions.known], value[predictions.held_out]) for name, value in values.items()
        },
    )
