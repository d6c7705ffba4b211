"""Open-set scores: how well a window fits the known intentions, and how well that separates the unknown class.

Every score is higher for known intentions, and none is fitted to windows of `following`, the unknown class. Two things
still tell a run about mere driving, and a result has to name them:

- `pre_onset` is a detector, trained on windows that end before the onset of the training records' maneuvers, where the
  vehicle merely drives. It recognises driving like that, which `following` resembles. It does not recognise novelty.
- Which score a run uses is chosen by its AUROC on the validation seeds, `following` of these seeds included
  (`models.training.training`). The scores of the test seeds are not looked at.

Scores that saw no driving at all are in WITHOUT_DRIVING (unless the network was trained with outlier exposure). Compare
other work with these, first of all with `msp`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, get_args

import numpy as np

from isac_cosim.base.arrays import Array, Float32Array, IntArray
from isac_cosim.models.predictors.protocol import Outputs
from isac_cosim.models.runs.former_names import SCORE
from isac_cosim.models.runs.run import Run, UnknownScore

if TYPE_CHECKING:
    from sklearn.ensemble import HistGradientBoostingClassifier

Score = Callable[[Outputs], Array]

NEIGHBOURS = 10
"""The `knn` score is the distance to the neighbour of this rank."""
PRE_ONSET_DETECTOR = SCORE
"""Name of the reject option's score: trees that were trained on pre-onset windows of the training records."""
SCORES: tuple[str, ...] = get_args(UnknownScore)
"""Names of all scores."""
WITHOUT_DRIVING = tuple(name for name in SCORES if name != PRE_ONSET_DETECTOR)
"""Names of the scores that are computed from windows of maneuvers alone."""
PLAIN = "msp"
"""The score of the papers, always reported, and used if there is nothing to choose on."""


def scores(
    reference: tuple[Float32Array, IntArray], reject_option: HistGradientBoostingClassifier | None = None
) -> dict[str, Score]:
    """Return all SCORES, by name.

    reference: features (n, F) and labels (n,) of training windows, for `knn` and `mahalanobis`. reject_option: trees of
    `models.predictors.reject_option`; without them the score `pre_onset` is absent.
    Sources: Hendrycks & Gimpel 2017 (msp), Liu et al. 2020 (energy), Sun et al. 2022 (knn), Lee et al. 2018
    (mahalanobis).
    """
    features, label = reference[0].astype(np.float64), reference[1]
    by_name: dict[str, Score] = {
        "msp": lambda out: np.asarray(out.probabilities.max(axis=1)),
        "max_logit": lambda out: np.asarray(out.logits.max(axis=1)),
        "energy": _energy,
        "entropy": _negative_entropy,
        "knn": _neighbours(features),
        "mahalanobis": _mahalanobis(features, label),
    }
    if reject_option is not None:
        # The trees were trained on float32 features, and split between such values.
        by_name[PRE_ONSET_DETECTOR] = lambda out: np.asarray(
            reject_option.decision_function(out.features.astype(np.float32))
        )
    return by_name


def of_run(run: Run) -> dict[str, Score]:
    """Return the scores of a run, by name."""
    return scores(run.reference, run.reject_option)


def chosen(run: Run) -> Score:
    """Return the score that was chosen on the run's validation seeds."""
    return of_run(run)[run.card.unknown_score]


def auroc(known: Array, unknown: Array) -> float | None:
    """Return the area under the ROC of separating known from unknown windows by a score; None if either is empty."""
    if not len(known) or not len(unknown):
        return None
    from sklearn.metrics import roc_auc_score  # loaded only here, because it takes long

    truth = np.repeat([1, 0], [len(known), len(unknown)])
    return float(roc_auc_score(truth, np.concatenate([known, unknown])))


def threshold_at_recall(known: Array, recall: float = 0.95) -> float:
    """Return the score that a share `recall` of the known windows reach; windows below it are rejected."""
    return float(np.quantile(known, 1 - recall))


def accepted_unknown(known: Array, unknown: Array, recall: float = 0.95) -> float | None:
    """Return the false-positive rate at that recall: the share of unknown windows accepted as known; None if empty."""
    if not len(known) or not len(unknown):
        return None
    return float(np.mean(unknown >= threshold_at_recall(known, recall)))


def _energy(out: Outputs) -> Array:
    """Return the logarithm of the summed exponentials of the logits, (n,)."""
    from scipy.special import logsumexp  # loaded only here, because it takes long

    return np.asarray(logsumexp(out.logits, axis=1))


def _negative_entropy(out: Outputs) -> Array:
    """Return minus the entropy of the probabilities, (n,)."""
    p = out.probabilities
    return np.asarray((p * np.log(np.maximum(p, 1e-300))).sum(axis=1))


def _neighbours(features: Array) -> Score:
    """Return the score: minus the distance to the NEIGHBOURS-th nearest training window, in standardised features."""
    from sklearn.neighbors import NearestNeighbors  # loaded only here, because it takes long

    mean, sd = features.mean(axis=0), features.std(axis=0) + 1e-9
    index = NearestNeighbors(n_neighbors=min(NEIGHBOURS, len(features))).fit((features - mean) / sd)
    return lambda out: np.asarray(-index.kneighbors((out.features - mean) / sd)[0][:, -1])


def _mahalanobis(features: Array, label: IntArray) -> Score:
    """Return the score: minus the least squared distance to a class mean, by the shrunk within-class covariance."""
    from sklearn.covariance import LedoitWolf  # loaded only here, because it takes long

    sd = features.std(axis=0) + 1e-9
    scaled = features / sd
    means = np.stack([scaled[label == g].mean(axis=0) for g in np.unique(label)])
    centred = scaled - means[np.searchsorted(np.unique(label), label)]
    precision = LedoitWolf(assume_centered=True).fit(centred).precision_

    def score(out: Outputs) -> Array:
        apart = (out.features / sd)[:, None, :] - means
        return np.asarray(-np.einsum("ngf,fh,ngh->ng", apart, precision, apart).min(axis=1))

    return score
