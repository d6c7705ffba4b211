"""Asks of every pull-out whether the TV passes the UV soon after the window, and scores the answers.

An overtake is decided up to 30 s after its onset, and pull-outs that pass without returning are in no class. This
question has an answer for all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.optimize import minimize
from scipy.special import expit
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.metrics import roc_auc_score

from isac_cosim.base.arrays import Array, BoolArray, Float32Array
from isac_cosim.evaluation.on_windows.predictions import Predictions
from isac_cosim.evaluation.on_windows.repeats import MeasuredRun
from isac_cosim.evaluation.on_windows.results import PassAnswer, PassScores, ReliabilityBin, TrainedPassAnswer
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.evaluation.statistics import jackknife_interval
from isac_cosim.labeling.dataset.pull_outs import dropped_pull_outs
from isac_cosim.labeling.intentions import Intention, outward
from isac_cosim.models.data.statistics import N_RECENT, N_STATISTICS
from isac_cosim.models.data.windows import Ends, Records, WindowSettings, batches, draw_ends, end_bounds
from isac_cosim.models.predictors.trees import tree_features
from isac_cosim.models.trees.boosting import BoostingSettings, boosted_trees

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
    pull_outs: PullOuts, records: Records, measured: MeasuredRun, windows: WindowSettings, settings: EvaluateSettings
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


def pass_scores(passing: Passing, measured: Sequence[MeasuredRun]) -> list[PassScores]:
    """Return the scores of the runs' own answers and of the trained models, for each time in WITHIN_S."""
    own = {member.result.name: own_answer(passing.pull_outs, member) for member in measured}
    return [_scores(passing, own, within_s) for within_s in WITHIN_S]


def own_answer(pull_outs: PullOuts, measured: MeasuredRun) -> Array | None:
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


if TYPE_CHECKING:
    from isac_cosim.labeling.dataset.dataset import Dataset

COLUMNS = ("sample_id", "pull_out", "t_pass", "t_pair_end")
"""The scalar columns of a dataset that are read of pull-outs."""
TOLERANCE_S = 1e-6
"""Times that differ by less are equal but for rounding, s."""


@dataclass(frozen=True)
class PullOuts:
    """The pull-outs of a dataset.

    table: one row for each, by its sample id, with the other COLUMNS. dropped: the records of those that are in no
    class.
    """

    table: pd.DataFrame
    dropped: Records

    @classmethod
    def of(cls, dataset: Dataset, sensed: Literal["tv", "tv_truth"] = "tv") -> Self | None:
        """Return the pull-outs of a dataset, or None if it has none or does not say when they pass.

        Also None if its study keeps no dropped pull-outs: the others are chosen by what became of them.
        sensed: the column that gives the TV's states.
        """
        if dataset.meta.study.get("selection", {}).get("pull_outs") == 0:
            return None
        dropped = dropped_pull_outs(dataset)
        table = pd.concat([part.frame(COLUMNS) for part in (dataset, dropped)], ignore_index=True)
        table = table[table["pull_out"] != ""].set_index("sample_id")
        if not len(table):
            return None
        return cls(table, Records.of(dropped, sensed))

    def among(self, sample_id: npt.NDArray[np.object_]) -> BoolArray:
        """Return which of some samples are pull-outs, a mask (n,)."""
        return np.asarray(pd.Index(sample_id).isin(self.table.index))

    def parts(self, records: Records, groups: list[str]) -> list[Records]:
        """Return the records of all pull-outs of some scenario seeds: those that are samples, then the dropped ones.

        records: of the dataset's samples.
        """
        sampled = self.among(records.table["sample_id"].to_numpy(dtype=object)) & np.isin(records.groups, groups)
        return [records.take(sampled), self.dropped.take(np.isin(self.dropped.groups, groups))]


@dataclass(frozen=True)
class PassWindows:
    """Windows of pull-outs, each array (n,).

    passes_after_s: how long after the end of the window the TV passes the UV, s; NaN if that is not observed.
    observed_s: how long after the end of the window the pair is observed, s.
    """

    sample_id: npt.NDArray[np.object_]
    group: npt.NDArray[np.object_]
    outcome: npt.NDArray[np.object_]
    passes_after_s: Array
    observed_s: Array

    @classmethod
    def of(
        cls, pull_outs: PullOuts, sample_id: npt.NDArray[np.object_], group: npt.NDArray[np.object_], end_s: Array
    ) -> Self:
        """Return the windows of some pull-outs, given by sample and scenario seed; end_s: ends of the windows, s."""
        rows = pull_outs.table.loc[pd.Index(sample_id)]
        times = {name: rows[name].to_numpy(dtype=np.float64) - end_s for name in ("t_pass", "t_pair_end")}
        outcome = rows["pull_out"].to_numpy(dtype=object)
        return cls(sample_id, group, outcome, times["t_pass"], times["t_pair_end"])

    def __len__(self) -> int:
        return len(self.sample_id)

    @property
    def already_passed(self) -> BoolArray:
        """Windows at whose end the TV has passed the UV, which ask nothing, a mask (n,)."""
        return np.asarray(self.passes_after_s <= TOLERANCE_S)

    def censored(self, within_s: float) -> BoolArray:
        """Return the windows after which the pair is not observed for that long, s, a mask (n,).

        This does not depend on whether the TV passes: otherwise, shortly before the end of a recording only pull-outs
        that pass would count.
        """
        return np.asarray(~self.already_passed & (self.observed_s < within_s - TOLERANCE_S))

    def asked(self, within_s: float) -> BoolArray:
        """Return the windows for which it is known whether the TV passes within that time, s, a mask (n,)."""
        return np.asarray(~self.already_passed & ~self.censored(within_s))

    def passes(self, within_s: float) -> BoolArray:
        """Return whether the TV passes within that time after the end of each window, s, (n,); False if unknown."""
        return np.asarray(~self.already_passed & (self.passes_after_s <= within_s + TOLERANCE_S))


def ends_of(records: Records, windows: WindowSettings, seed: int, per_record: int) -> Ends:
    """Return the window ends that the evaluation draws from some records; none if no record holds such a window."""
    first, last = end_bounds(records, windows)
    if not (last >= first).any():
        return Ends(np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64))
    return draw_ends(records, windows, "evaluate", seed, per_record=per_record)


TREES = BoostingSettings(rounds=100)
"""Settings of the trees. There are fewer windows than a predictor of intentions has, and two answers."""
LEAST_OF_EACH = 5
"""With fewer windows of either answer, on the training or on the validation side, nothing is trained."""
LEAST_SCALE = 1e-3
"""Least scale of the calibration: it never turns the ranking round, even if the validation seeds would."""
BATCH = 256
"""Windows whose statistics are taken at once."""


@dataclass(frozen=True)
class PassFeatures:
    """Windows of pull-outs with what trees take of them, (n, 140)."""

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
        sample_id, group, end_s, features = [], [], [], [np.empty((0, N_STATISTICS + N_RECENT), np.float32)]
        for part in pull_outs.parts(records, groups):
            ends = ends_of(part, settings, seed, per_record)
            sample_id.append(part.table["sample_id"].to_numpy(dtype=object)[ends.row])
            group.append(part.groups[ends.row])
            end_s.append(ends.times(part))
            features += [tree_features(windows, part.tv_rate_hz) for windows in batches(part, ends, settings, BATCH)]
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
        """Return the probability that the TV passes in time, (n,), for what trees take of windows."""
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
    trees = boosted_trees(TREES).fit(features, answer)
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
