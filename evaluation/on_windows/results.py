"""What an evaluation measured, typed: the content of `metrics.json`.

Every figure in it can be recomputed from `predictions.parquet` beside it (`evaluation.on_windows.prediction_table`).
A score is None (`null` in the file) where it is undefined, for example the F1 of an intention without a true window.
Parts that do not apply to an evaluation, such as `held_out` where no intention was held out, are absent from the file.
Scores are between 0 and 1. Windows are those of scenario seeds that no compared run was trained or chosen on.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Literal

from pydantic import Field, JsonValue, model_validator

from isac_cosim.base.settings import Settings, WithOptionalParts, read_json
from isac_cosim.evaluation.on_windows.explained import ExplainedIntention
from isac_cosim.evaluation.on_windows.score_results import (
    AfterCommit,
    BeforeCommit,
    Calibration,
    FiveClassScores,
    HeldOutScores,
    LeadDifference,
    LeadTimeBin,
    ManeuverScores,
    PairedDifference,
    PairScores,
    PairSpreads,
    Separation,
    SnrBin,
    Spread,
    WindowEndScores,
)
from isac_cosim.evaluation.on_windows.settings import WindowEndCurveSettings, with_current_key
from isac_cosim.labeling.dataset.dependence import Dependence
from isac_cosim.models.data.windows import WindowSettings
from isac_cosim.models.runs.former_names import OpenSetScore
from isac_cosim.models.runs.run import RunCard

METRICS_FILE = "metrics.json"
ScoreName = Literal["before_commit_macro_f1", "macro_f1", "accuracy", "auroc_unknown"]
"""The scores that sum up a run in one number."""


class PredictorResult(WithOptionalParts):
    """The runs of one predictor, which differ in the training seed alone, summed up.

    name: of the predictor.
    training_seeds: training seed of each run.
    accuracy, macro_f1, before_commit_macro_f1, auroc_unknown, per_class_f1, overtake_against_left: as in
    `ScoreSpreads`.
    paired_difference: mean scores of the first predictor minus those of this one; absent for the first.
    paired_difference_before_commit: the same on the windows before the commit.
    paired_difference_by_lead: the same on the windows at each lead time; absent in files of earlier versions.
    """

    optional_parts: ClassVar[frozenset[str]] = frozenset(
        {"paired_difference", "paired_difference_before_commit", "paired_difference_by_lead"}
    )

    name: str
    training_seeds: list[int]
    accuracy: Spread
    macro_f1: Spread
    before_commit_macro_f1: Spread | None = None
    auroc_unknown: Spread
    per_class_f1: dict[str, Spread]
    overtake_against_left: PairSpreads
    paired_difference: PairedDifference | None = None
    paired_difference_before_commit: PairedDifference | None = None
    paired_difference_by_lead: list[LeadDifference] | None = None


class RunResult(WithOptionalParts):
    """All metrics of one run.

    The first block of scores is on all windows of known intentions, wherever they end: the windows of the papers. Those
    that end before the commit, which alone are predictions, are in `before_commit`. Files of earlier versions lack
    `groups`, the bounds, `before_commit`, `after_commit` and `five_classes`.

    model: the predictor, as `training.model` names it.
    name: of the run in tables and figures; unique among the runs that are compared.
    classes: names of the known intentions, in the order of the confusion matrix.
    n, accuracy, macro_f1, macro_f1_over, per_class_f1, confusion: as in `Summary`.
    groups: number of scenario seeds that the windows come from.
    macro_f1_low, macro_f1_high: 95 % interval of `macro_f1` over scenario seeds; absent with fewer than two.
    before_commit: prediction: scores of the windows that end before the commit, and at fixed times before it.
    after_commit: recognition: scores of the windows that end after the commit.
    five_classes: scores with overtake and left lane change as one intention; where traffic keeps left, right lane
    change.
    maneuvers: precision, recall and F1 on windows of known intentions.
    maneuvers_with_background: the same with `following` as background; rejected windows count as background.
    overtake_against_left: how well a left lane change (right, where traffic keeps left) and an overtake are
    distinguished.
    n_unknown: number of windows of `following`.
    auroc_unknown: separation of `following` by the run's own open-set score.
    unknown_score: name of that score, chosen on the validation seeds.
    unknown_scores: separation of `following` by each open-set score, by the score's name.
    held_out: the same for the intention left out of training; absent where none was.
    calibration: error of the probabilities.
    by_lead_time: scores against lead time.
    by_snr: scores against SNR; records without an SNR take no part.
    by_window_end: the window-end curve; absent where it was not measured.
    """

    optional_parts: ClassVar[frozenset[str]] = frozenset(
        {
            "held_out", "by_window_end", "groups", "macro_f1_low", "macro_f1_high", "before_commit", "after_commit",
            "five_classes", "macro_f1_over",
        }
    )  # fmt: skip

    model: str
    name: str
    classes: tuple[str, ...]
    n: int
    accuracy: float | None
    macro_f1: float | None
    macro_f1_over: list[str] | None = None
    per_class_f1: dict[str, float | None]
    confusion: list[list[int]]
    groups: int | None = None
    macro_f1_low: float | None = None
    macro_f1_high: float | None = None
    before_commit: BeforeCommit | None = None
    after_commit: AfterCommit | None = None
    five_classes: FiveClassScores | None = None
    maneuvers: ManeuverScores
    maneuvers_with_background: ManeuverScores
    overtake_against_left: PairScores
    n_unknown: int
    auroc_unknown: float | None
    unknown_score: OpenSetScore
    unknown_scores: dict[OpenSetScore, Separation]
    held_out: HeldOutScores | None = None
    calibration: Calibration
    by_lead_time: list[LeadTimeBin]
    by_snr: list[SnrBin]
    by_window_end: list[WindowEndScores] | None = None

    @property
    def before_commit_macro_f1(self) -> float | None:
        """Macro-F1 of the windows before the commit; None where that was not measured."""
        return None if self.before_commit is None else self.before_commit.macro_f1

    def score(self, name: ScoreName) -> float | None:
        """Return one of the scores that sum up a run."""
        scores: dict[ScoreName, float | None] = {
            "before_commit_macro_f1": self.before_commit_macro_f1,
            "macro_f1": self.macro_f1,
            "accuracy": self.accuracy,
            "auroc_unknown": self.auroc_unknown,
        }
        return scores[name]


class ComparedResult(RunResult):
    """Metrics of a run that the evaluated one is compared with.

    paired_difference: scores of the evaluated run minus those of this one, on the windows of
    intentions that both were trained on.
    paired_difference_before_commit: the same on those that end before the commit; absent in files of earlier versions.
    paired_difference_by_lead: the same on those at each lead time; absent in files of earlier versions.
    """

    optional_parts: ClassVar[frozenset[str]] = RunResult.optional_parts | {
        "paired_difference_before_commit",
        "paired_difference_by_lead",
    }

    paired_difference: PairedDifference
    paired_difference_before_commit: PairedDifference | None = None
    paired_difference_by_lead: list[LeadDifference] | None = None

    def difference_at(self, lead_s: float) -> LeadDifference | None:
        """Return the paired difference at a lead time, s; None where it was not measured."""
        return next((paired for paired in self.paired_difference_by_lead or () if paired.lead_s == lead_s), None)


class MeasuredWindows(WindowSettings):
    """The windows of an evaluation: those of the run, with the range of ends that was measured.

    ends_per_record: fixed windows of each record.
    leads_s: lead times of `before_commit.by_lead`, s; empty in files of earlier versions.
    seed: of the window ends.
    window_end_curve: settings of `by_window_end`; None where it was not measured. Formerly `sweep`.
    """

    ends_per_record: int
    leads_s: tuple[float, ...] = ()
    seed: int
    window_end_curve: WindowEndCurveSettings | None

    @model_validator(mode="before")
    @classmethod
    def _accept_former_key(cls, content: object) -> object:
        return with_current_key(content)


class DatasetOrigin(Settings):
    """The dataset that a result comes from.

    digest: of its shards.
    study: the settings that made it.
    """

    digest: str
    study: dict[str, JsonValue]


class MadeBy(Settings):
    """What made the result of an evaluation.

    dataset: the measured dataset.
    seeds: measured scenario seeds, `<scenario>-<seed>`.
    runs: cards of the evaluated run and of those compared with it, in that order.
    versions: of the packages that scores depend on, by the package's name.
    """

    dataset: DatasetOrigin
    seeds: list[str]
    runs: list[RunCard]
    versions: dict[str, str]


class EvaluationResult(RunResult):
    """The content of `metrics.json`: all metrics of the evaluated run, and its comparison with others.

    compared: metrics of the other runs.
    over_training_seeds: runs that differ in the training seed alone, summed up; absent where there are none.
    passing: whether the TV passes the UV soon after the window, for pull-outs of every outcome; absent where the
    dataset does not say, and in files of earlier versions.
    dependence: how many test samples have a twin, the same vehicle or a near copy, among the samples that the evaluated
    run was trained or chosen on; absent where the dataset holds none of these, and in files of earlier versions.
    explained: what the modules of a CaSTFormer do, by intention; absent where it was not asked for.
    answers: what result parts of installed packages measured, by the part's name; absent where there are none.
    windows: the windows that were measured.
    made_by: dataset, runs and versions behind the result.
    """

    optional_parts: ClassVar[frozenset[str]] = RunResult.optional_parts | {
        "over_training_seeds", "passing", "dependence", "explained", "answers",
    }  # fmt: skip

    compared: list[ComparedResult] = Field(default_factory=list)
    over_training_seeds: list[PredictorResult] | None = None
    passing: list[PassScores] | None = None
    dependence: Dependence | None = None
    explained: dict[str, ExplainedIntention] | None = None
    answers: dict[str, JsonValue] | None = None
    windows: MeasuredWindows
    made_by: MadeBy

    @property
    def runs(self) -> list[RunResult]:
        """The evaluated run's metrics, then those of the compared runs."""
        return [self, *self.compared]


def read_metrics(folder: Path) -> EvaluationResult | None:
    """Return what `metrics.json` in a folder holds, or None where there is none.

    Raises InputError where it is damaged or was written by a version that this one cannot read.
    """
    return read_json(EvaluationResult, folder / METRICS_FILE)


class PassAnswer(Settings):
    """How well an answer ranks windows by whether the TV passes the UV.

    name: whose answer it is.
    auroc: area under the ROC curve of the windows with a pass against those without; None where one kind is missing,
    and for a run that was not trained on the intentions that it answers with.
    auroc_low, auroc_high: its 95 % interval over scenario seeds; None where there is none.
    """

    name: str
    auroc: float | None
    auroc_low: float | None
    auroc_high: float | None


class ReliabilityBin(Settings):
    """The windows whose probability lies in one bin.

    from_probability, to_probability: bounds of the bin, the lower one included.
    n: number of windows.
    mean_probability: of those windows.
    share_passed: share of them after which the TV passes.
    """

    from_probability: float
    to_probability: float
    n: int
    mean_probability: float
    share_passed: float


class TrainedPassAnswer(PassAnswer):
    """Scores of the model that is trained on this question alone.

    training_windows, calibration_windows: number of windows of training and validation seeds that it learned from.
    brier: mean squared error of its probabilities.
    calibration_error: expected calibration error, over the bins of `reliability`.
    """

    training_windows: int
    calibration_windows: int
    brier: float | None
    calibration_error: float | None
    reliability: list[ReliabilityBin]


class PassScores(Settings):
    """Whether the TV passes the UV within a time after the end of the window: one question, and the answers to it.

    Asked are the windows of pull-outs of unseen seeds, also of those in no class, at the ends that the evaluation
    draws.

    within_s: that time, s.
    n: number of windows for which the answer is known.
    pull_outs: number of pull-outs that they come from, by what became of them.
    groups: number of scenario seeds that they come from.
    already_passed: number of windows at whose end the TV had passed, which are not asked.
    censored: number of windows after which the pair was not observed for so long, which are not asked.
    base_rate: share of the n windows after which the TV passes.
    brier_of_base_rate: mean squared error of that share as the probability of every window.
    answers: of the runs, in their order: the probability of an overtake, as a share of that of an overtake or a change
    to the faster side.
    trained: of boosted trees that are trained on this question; None where the dataset has no windows of training and
    validation seeds with either answer.
    """

    within_s: float
    n: int
    pull_outs: dict[str, int]
    groups: int
    already_passed: int
    censored: int
    base_rate: float | None
    brier_of_base_rate: float | None
    answers: list[PassAnswer]
    trained: TrainedPassAnswer | None
