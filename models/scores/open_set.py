"""Scores of how well a window fits the known intentions, and how they tell the unknown one apart.

Every score is higher for the known. None is fitted to samples of the unknown class.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp
from sklearn.covariance import LedoitWolf
from sklearn.metrics import roc_auc_score
from sklearn.neighbors import NearestNeighbors

from isacsim.arrays import Array, IntArray
from models.run import Outputs, Run

Score = Callable[[Outputs], Array]

NEIGHBOURS = 10
SCORES = ("msp", "max_logit", "energy", "entropy", "knn", "mahalanobis", "prelude")
PLAIN = "msp"
"""Always reported, and used where there is nothing to choose on."""


def scores(reference: tuple[npt.NDArray[np.float32], IntArray], preludes: Any | None = None) -> dict[str, Score]:
    """All SCORES; reference: features (n, F) and labels (n,) of training windows, for knn and mahalanobis.

    preludes: trees of `models.predictors.reject_option`; without them there is no score of that name.
    """
    features, label = reference[0].astype(np.float64), reference[1]
    found: dict[str, Score] = {
        "msp": lambda out: np.asarray(out.probabilities.max(axis=1)),
        "max_logit": lambda out: np.asarray(out.logits.max(axis=1)),
        "energy": lambda out: np.asarray(logsumexp(out.logits, axis=1)),
        "entropy": _negative_entropy,
        "knn": _neighbours(features),
        "mahalanobis": _mahalanobis(features, label),
    }
    if preludes is not None:
        # Trees split at float32 values, as they were trained on.
        found["prelude"] = lambda out: np.asarray(preludes.decision_function(out.features.astype(np.float32)))
    return found


def of_run(run: Run) -> dict[str, Score]:
    """The scores of a run's outputs."""
    return scores(run.reference, run.preludes)


def chosen(run: Run) -> Score:
    """The score that was chosen on the run's validation seeds."""
    return of_run(run)[run.card.unknown_score]


def auroc(known: Array, unknown: Array) -> float | None:
    """Area under the ROC of telling known from unknown by a score; None where either is empty."""
    if not len(known) or not len(unknown):
        return None
    truth = np.repeat([1, 0], [len(known), len(unknown)])
    return float(roc_auc_score(truth, np.concatenate([known, unknown])))


def threshold_at_recall(known: Array, recall: float = 0.95) -> float:
    """The score that `recall` of the known windows reach: what is below it is rejected."""
    return float(np.quantile(known, 1 - recall))


def accepted_unknown(known: Array, unknown: Array, recall: float = 0.95) -> float | None:
    """Share of the unknown taken for known where `recall` of the known are kept: the false-positive rate then."""
    if not len(known) or not len(unknown):
        return None
    return float(np.mean(unknown >= threshold_at_recall(known, recall)))


def told_apart(known: Array, unknown: Array) -> dict[str, float | None]:
    """`auroc` and `fpr_at_95_recall` of one score."""
    return {"auroc": auroc(known, unknown), "fpr_at_95_recall": accepted_unknown(known, unknown)}


def _negative_entropy(out: Outputs) -> Array:
    p = out.probabilities
    return np.asarray((p * np.log(np.maximum(p, 1e-300))).sum(axis=1))


def _neighbours(features: Array) -> Score:
    """Minus the distance to the NEIGHBOURS-th nearest training window, in standardised features."""
    mean, sd = features.mean(axis=0), features.std(axis=0) + 1e-9
    index = NearestNeighbors(n_neighbors=min(NEIGHBOURS, len(features))).fit((features - mean) / sd)
    return lambda out: np.asarray(-index.kneighbors((out.features - mean) / sd)[0][:, -1])


def _mahalanobis(features: Array, label: IntArray) -> Score:
    """Minus the least squared distance to a class mean, by the shrunk covariance within classes."""
    sd = features.std(axis=0) + 1e-9
    scaled = features / sd
    means = np.stack([scaled[label == g].mean(axis=0) for g in np.unique(label)])
    centred = scaled - means[np.searchsorted(np.unique(label), label)]
    precision = LedoitWolf(assume_centered=True).fit(centred).precision_

    def score(out: Outputs) -> Array:
        apart = (out.features / sd)[:, None, :] - means
        return np.asarray(-np.einsum("ngf,fh,ngh->ng", apart, precision, apart).min(axis=1))

    return score
