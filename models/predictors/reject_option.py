"""The reject option: trees that tell maneuvers from mere driving, without ever seeing the unknown class.

Windows that end before the onset of their record's maneuver show mere driving. The trees learn to tell them from the
training windows by the predictor's features, and so score how much a window looks like a maneuver at all. No sample of
`following` is used; whether it is recognised as mere driving, too, is for the evaluation to find out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from isac_cosim.base.arrays import Float32Array
from isac_cosim.models.data.pre_onset import PreOnsetSettings, has_pre_onset_windows, pre_onset_windows
from isac_cosim.models.data.windows import batches, draw_ends
from isac_cosim.models.predictors.protocol import FitTask, Predictor
from isac_cosim.models.trees.boosting import boosted_trees, fitted

if TYPE_CHECKING:
    from sklearn.ensemble import HistGradientBoostingClassifier

BATCH = 64


def fit_reject_option(predictor: Predictor, task: FitTask) -> HistGradientBoostingClassifier | None:
    """Fit the reject option of a predictor, or return None if it is turned off or no record reaches far enough back.

    Each training record gives as many windows of its maneuver as pre-onset windows.
    """
    settings, windows, training = task.settings.pre_onset, task.settings.windows, task.training
    if not settings.use or not has_pre_onset_windows(training, windows, settings):
        return None
    features = []
    # The names of the draws are those of earlier versions, whose runs these settings reproduce.
    for purpose, shown in (("maneuvers", windows), ("preludes", pre_onset_windows(windows, settings))):
        ends = draw_ends(training, shown, purpose, task.settings.seed, per_record=settings.ends_per_record)
        parts = [predictor(batch).features for batch in batches(training, ends, shown, BATCH)]
        features.append(np.concatenate(parts).astype(np.float32))
    return fit_trees(features[0], features[1], settings, task.settings.seed)


def fit_trees(
    maneuvers: Float32Array, pre_onset: Float32Array, settings: PreOnsetSettings, seed: int
) -> HistGradientBoostingClassifier:
    """Fit trees to features of maneuver windows (n, F), class 1, and of pre-onset windows (m, F), class 0."""
    trees = boosted_trees(settings, seed, balanced=True)
    label = np.repeat([1, 0], [len(maneuvers), len(pre_onset)])
    return fitted(trees, np.concatenate([maneuvers, pre_onset]), label)
