"""Boosted trees that learn one thing: whether the TV passes the UV within a time after the end of the window.

They see the same statistics of a window as the predictor `trees`. They are trained on the pull-outs of the training
seeds, the dropped ones included, and calibrated on those of the validation seeds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit
from sklearn.ensemble import HistGradientBoostingClassifier

from isacsim.arrays import Array, BoolArray, Float32Array
from models.data.windows import Records, WindowSettings, batches
from models.evaluation.pull_outs import PassWindows, PullOuts, ends_of
from models.predictors.trees import TreesSettings, statistics

TREES = TreesSettings(rounds=100)
"""Settings of the trees. There are fewer windows than a predictor of intentions has, and two answers."""
LEAST_OF_EACH = 5
"""With fewer windows of either answer, on the training or on the validation side, nothing is trained."""
LEAST_SCALE = 1e-3
"""Least scale of the calibration: it never turns the ranking round, even if the validation seeds would."""
BATCH = 256
"""Windows whose statistics are taken at once."""


@dataclass(frozen=True)
class PassFeatures:
    """Windows of pull-outs with their statistics, (n, 120)."""

    windows: PassWindows
    features: Float32Array

    @classmethod
    def of(
        cls,
        pull_outs: PullOuts,
        records: Records,
        groups: list[str],
        settings: WindowSettings,
        seed: int,
        per_record: int,
    ) -> PassFeatures:
        """Return all pull-outs of some scenario seeds, at the ends that the evaluation draws.

        records: of the dataset's samples. seed, per_record: of the draw of ends.
        """
        sample_id, group, end_s, features = [], [], [], [np.empty((0, 120), np.float32)]
        for part in pull_outs.parts(records, groups):
            ends = ends_of(part, settings, seed, per_record)
            sample_id.append(part.table["sample_id"].to_numpy(dtype=object)[ends.row])
            group.append(part.groups[ends.row])
            end_s.append(ends.times(part))
            features += [statistics(windows) for windows in batches(part, ends, settings, BATCH)]
        windows = PassWindows.of(pull_outs, np.concatenate(sample_id), np.concatenate(group), np.concatenate(end_s))
        return cls(windows, np.concatenate(features))


@dataclass(frozen=True)
class PassModel:
    """Trees with their calibration: their log-odds, times `scale`, plus `shift`.

    training_windows, calibration_windows: number of windows that they were fitted to.
    """

    trees: HistGradientBoostingClassifier
    scale: float
    shift: float
    training_windows: int
    calibration_windows: int

    def probability(self, features: Float32Array) -> Array:
        """Return the probability that the TV passes in time, (n,), for statistics of windows (n, 120)."""
        if not len(features):
            return np.empty(0)
        return np.asarray(expit(self.scale * self.trees.decision_function(features) + self.shift))


def fit_pass_model(training: PassFeatures, validation: PassFeatures, within_s: float) -> PassModel | None:
    """Return a model trained on windows of training seeds and calibrated on those of validation seeds.

    within_s: time after the end of the window in which the TV may pass, s. Returns None where either side has too few
    windows with one of the answers.
    """
    sides = [_known(side, within_s) for side in (training, validation)]
    if any(min(answer.sum(), (~answer).sum()) < LEAST_OF_EACH for _, answer in sides):
        return None
    (features, answer), (held_features, held_answer) = sides
    trees = HistGradientBoostingClassifier(
        max_iter=TREES.rounds, learning_rate=TREES.learning_rate, max_leaf_nodes=TREES.leaves,
        l2_regularization=TREES.l2, early_stopping=False, random_state=0,
    ).fit(features, answer)  # fmt: skip
    scale, shift = fit_calibration(np.asarray(trees.decision_function(held_features)), held_answer)
    return PassModel(trees, scale, shift, len(answer), len(held_answer))


def fit_calibration(log_odds: Array, answer: BoolArray) -> tuple[float, float]:
    """Return the scale, at least LEAST_SCALE, and the shift of log-odds (n,) that make answers (n,) most likely.

    Source: Platt 1999, without smoothed targets.
    """

    def loss(parameters: Array) -> float:
        logit = parameters[0] * log_odds + parameters[1]
        return float((np.logaddexp(0.0, logit) - answer * logit).mean())

    fitted = minimize(loss, np.array([1.0, 0.0]), method="L-BFGS-B", bounds=[(LEAST_SCALE, None), (None, None)])
    return float(fitted.x[0]), float(fitted.x[1])


def _known(side: PassFeatures, within_s: float) -> tuple[Float32Array, BoolArray]:
    """Return the statistics and the answers of the windows whose answer is known."""
    asked = side.windows.asked(within_s)
    return side.features[asked], side.windows.passes(within_s)[asked]
