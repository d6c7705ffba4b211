"""Asks of every pull-out whether the TV passes the UV soon after the window, and scores the answers.

An overtake is decided up to 30 s after its onset, and pull-outs that pass without returning are in no class. This
question has an answer for all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import expit
from sklearn.metrics import roc_auc_score

from isacsim.arrays import Array, BoolArray
from labeling.intentions import Intention, outward
from models.data.windows import Records, WindowSettings
from models.evaluation.intervals import jackknife_interval
from models.evaluation.pass_model import PassFeatures, PassModel, fit_pass_model
from models.evaluation.pass_results import PassAnswer, PassScores, ReliabilityBin, TrainedPassAnswer
from models.evaluation.predictions import Predictions
from models.evaluation.pull_outs import PassWindows, PullOuts
from models.evaluation.repeats import Measured
from models.evaluation.settings import EvaluateSettings

WITHIN_S = (5.0, 10.0)
"""Times after the end of the window within which the TV may pass, s."""
TRAINED_NAME = "boosted trees trained on this question"
RELIABILITY_BINS = 10
"""Equal bins of probability."""


@dataclass(frozen=True)
class Passing:
    """The windows of pull-outs that are measured, and what the trained models answer.

    pull_outs: of the dataset. windows: those of the pull-outs that are samples, in the order of the predictions, then
    those of the dropped ones. models: by `within_s`; without those for which there are too few windows.
    probability: their answers for every window, (n,), by `within_s`.
    """

    pull_outs: PullOuts
    windows: PassWindows
    models: Mapping[float, PassModel]
    probability: Mapping[float, Array]


def ask(
    pull_outs: PullOuts, records: Records, measured: Measured, windows: WindowSettings, settings: EvaluateSettings
) -> Passing:
    """Return the measured windows of pull-outs, and the answers of models that are trained on the question.

    records: of all samples of the dataset. measured: a run, on whose training and validation seeds the models are
    trained and calibrated. windows: of the evaluation.
    """
    split = measured.run.card.split
    test = sorted({str(group) for group in measured.predictions.group})
    training, validation, tested = (
        PassFeatures.of(pull_outs, records, groups, windows, settings.seed, settings.ends_per_record)
        for groups in (split["train"], split["validation"], test)
    )
    fitted = {within_s: fit_pass_model(training, validation, within_s) for within_s in WITHIN_S}
    models = {within_s: model for within_s, model in fitted.items() if model is not None}
    probability = {within_s: model.probability(tested.features) for within_s, model in models.items()}
    return Passing(pull_outs, tested.windows, models, probability)


def pass_scores(passing: Passing, measured: Sequence[Measured]) -> list[PassScores]:
    """Return the scores of the runs' own answers and of the trained models, for each time in WITHIN_S."""
    own = {member.result.name: own_answer(passing.pull_outs, member) for member in measured}
    return [_scores(passing, own, within_s) for within_s in WITHIN_S]


def own_answer(pull_outs: PullOuts, measured: Measured) -> Array | None:
    """Return what a run's probabilities say about passing, (n,), for the windows of `Passing.windows`.

    It is the probability of an overtake as a share of that of an overtake or a change to the faster side. None for a
    run that was not trained on one of the two.
    """
    parts = [measured.predictions, *([] if measured.dropped is None else [measured.dropped])]
    if measured.run.card.settings.left_out in (Intention.OVERTAKE, *_changes_out(parts)):
        return None
    return np.concatenate([_share(part)[pull_outs.among(part.sample_id)] for part in parts])


def _changes_out(parts: Sequence[Predictions]) -> set[Intention]:
    """Return the changes to the faster side in the scenarios of some predictions."""
    return {outward(keeps_left) for part in parts for keeps_left in set(part.keeps_left.tolist())}


def _share(predictions: Predictions) -> Array:
    """Return the share of an overtake in its sum with the change to the faster side, (n,)."""
    change_out = np.where(predictions.keeps_left, outward(lefthand=True), outward(lefthand=False))
    logits = predictions.outputs.logits
    change_logit = np.take_along_axis(logits, change_out[:, None].astype(np.int64), axis=1)[:, 0]
    return np.asarray(expit(logits[:, Intention.OVERTAKE] - change_logit))


def _scores(passing: Passing, own: Mapping[str, Array | None], within_s: float) -> PassScores:
    """Return the scores for one time; own: each run's answers, (n,), by its name."""
    windows = passing.windows
    asked = windows.asked(within_s)
    passes, group = windows.passes(within_s)[asked], windows.group[asked]
    _, first = np.unique(windows.sample_id[asked].astype(str), return_index=True)
    outcomes, counts = np.unique(windows.outcome[asked][first].astype(str), return_counts=True)
    base_rate = float(passes.mean()) if len(passes) else None
    trained = None
    if (model := passing.models.get(within_s)) is not None:
        trained = _trained(model, passes, passing.probability[within_s][asked], group)
    return PassScores(
        within_s=within_s,
        n=len(passes),
        pull_outs=dict(zip(outcomes.tolist(), counts.tolist(), strict=True)),
        groups=len(set(group)),
        already_passed=int(windows.already_passed.sum()),
        censored=int(windows.censored(within_s).sum()),
        base_rate=base_rate,
        brier_of_base_rate=None if base_rate is None else base_rate * (1 - base_rate),
        answers=[
            _answer(name, passes, None if answer is None else answer[asked], group) for name, answer in own.items()
        ],
        trained=trained,
    )


def _answer(name: str, passes: BoolArray, answer: Array | None, group: npt.NDArray[np.object_]) -> PassAnswer:
    """Return how well answers rank windows by whether the TV passes; arrays (n,)."""
    if answer is None:
        return PassAnswer(name=name, auroc=None, auroc_low=None, auroc_high=None)

    def auroc(rows: BoolArray) -> float:
        both = passes[rows].any() and not passes[rows].all()
        return float(roc_auc_score(passes[rows], answer[rows])) if both else np.nan

    value, low, high = jackknife_interval(auroc, group)
    return PassAnswer(name=name, auroc=value, auroc_low=low, auroc_high=high)


def _trained(
    model: PassModel, passes: BoolArray, probability: Array, group: npt.NDArray[np.object_]
) -> TrainedPassAnswer:
    """Return the scores of a model that is trained on the question; probability: its answers; arrays (n,)."""
    bins = reliability(probability, passes)
    gap = sum(part.n * abs(part.mean_probability - part.share_passed) for part in bins)
    return TrainedPassAnswer(
        **dict(_answer(TRAINED_NAME, passes, probability, group)),
        training_windows=model.training_windows,
        calibration_windows=model.calibration_windows,
        brier=float(((probability - passes) ** 2).mean()) if len(passes) else None,
        calibration_error=gap / len(passes) if len(passes) else None,
        reliability=bins,
    )


def reliability(probability: Array, passes: BoolArray) -> list[ReliabilityBin]:
    """Return mean probability and share of passes in equal bins of probability, without empty ones; arrays (n,)."""
    number = np.minimum((probability * RELIABILITY_BINS).astype(np.int64), RELIABILITY_BINS - 1)
    return [
        ReliabilityBin(
            from_probability=round(k / RELIABILITY_BINS, 6),
            to_probability=round((k + 1) / RELIABILITY_BINS, 6),
            n=int((number == k).sum()),
            mean_probability=float(probability[number == k].mean()),
            share_passed=float(passes[number == k].mean()),
        )
        for k in np.unique(number).tolist()
    ]
