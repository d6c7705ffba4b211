"""What an evaluation measured, typed: the content of `metrics.json`.

A score is None (`null` in the file) where it is undefined, for example the F1 of an intention without a true window.
Parts that do not apply to an evaluation, such as `held_out` where no intention was held out, are absent from the file.
Scores are between 0 and 1. Windows are those of scenario seeds that no compared run was trained or chosen on.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Literal

from pydantic import Field, JsonValue, SerializerFunctionWrapHandler, model_serializer, model_validator

from isacsim.settings import Settings, read_json
from models.data.windows import WindowSettings
from models.evaluation.settings import WindowEndCurveSettings, with_current_key
from models.run import RunCard

METRICS_FILE = "metrics.json"
ScoreName = Literal["macro_f1", "accuracy", "auroc_unknown"]
"""The scores that sum up a run in one number."""


class ResultWithOptionalParts(Settings):
    """A result of which some parts are absent from the file, rather than null, where they do not apply."""

    optional_parts: ClassVar[frozenset[str]] = frozenset()

    @model_serializer(mode="wrap")
    def _leave_out_absent_parts(self, serialise: SerializerFunctionWrapHandler) -> dict[str, object]:
        content: dict[str, object] = serialise(self)
        return {key: value for key, value in content.items() if value is not None or key not in self.optional_parts}


class Summary(Settings):
    """How well n windows were classified.

    n: number of windows.
    accuracy: share of windows classified correctly.
    macro_f1: mean F1 over the classes that have a true window.
    per_class_f1: F1 of each class, by its name.
    confusion: number of windows, G x G, rows true and columns predicted.
    """

    n: int
    accuracy: float | None
    macro_f1: float | None
    per_class_f1: dict[str, float | None]
    confusion: list[list[int]]


class ManeuverScores(Settings):
    """Macro-averaged precision and recall over maneuvers, and their harmonic mean. Source: CaSTFormer, Eq. (13)."""

    precision: float | None
    recall: float | None
    f1: float | None


class PairScores(Settings):
    """How well two intentions are told from each other, on windows of these two only.

    intentions: names of the first and the second intention.
    n: number of windows.
    accuracy: share of windows for which the likelier of the two was the true one.
    confusion: number of windows, 2 x 2, rows true and columns predicted.
    auroc: area under the ROC curve of the second against the first, by the difference of their logits.
    """

    intentions: list[str]
    n: int
    accuracy: float | None
    confusion: list[list[int]]
    auroc: float | None


class Separation(Settings):
    """How well a score separates windows of known intentions from unknown ones.

    auroc: area under the ROC curve, known against unknown.
    fpr_at_95_recall: share of the unknown windows that pass the threshold which 95 % of the known windows pass.
    """

    auroc: float | None
    fpr_at_95_recall: float | None


class HeldOutScores(Settings):
    """How well the intention left out of training is separated from the known ones.

    intention: its name.
    n: number of its windows.
    unknown_scores: separation by each open-set score, by the score's name.
    """

    intention: str
    n: int
    unknown_scores: dict[str, Separation]


class Calibration(Settings):
    """Expected calibration error of the probabilities of known windows.

    error: of the probabilities as trained.
    temperature: what logits are divided by, chosen on the validation seeds.
    error_with_temperature: of the probabilities after that division.
    """

    error: float
    temperature: float
    error_with_temperature: float


class LeadTimeBin(Settings):
    """Scores of the windows whose lead time (commit minus end of the window) lies in one bin.

    from_s, to_s: bounds of the bin, s, the lower one included.
    n: number of known windows.
    accuracy, macro_f1: on those windows.
    auroc_unknown, fpr_at_95_recall: separation of those windows from all windows of `following`, which has no commit.
    """

    from_s: float
    to_s: float
    n: int
    accuracy: float | None
    macro_f1: float | None
    auroc_unknown: float | None
    fpr_at_95_recall: float | None

    @property
    def middle_s(self) -> float:
        """Middle of the bin, s."""
        return (self.from_s + self.to_s) / 2


class SnrBin(Settings):
    """Scores of the known windows of records whose mean per-element SNR lies in one bin.

    from_db, to_db: bounds of the bin, dB, the lower one included.
    n: number of windows.
    accuracy, macro_f1: on those windows.
    """

    from_db: float
    to_db: float
    n: int
    accuracy: float | None
    macro_f1: float | None


class WindowEndScores(Settings):
    """Scores when every window ends at the same time relative to onset or commit: one point of the window-end curve.

    end_s: end of the windows, s after that instant.
    n: number of known windows; records that cannot hold such a window take no part.
    accuracy, macro_f1, per_class_f1: on those windows.
    auroc_unknown, fpr_at_95_recall: separation of those windows from windows of `following` with the same end.
    """

    end_s: float
    n: int
    accuracy: float | None
    macro_f1: float | None
    per_class_f1: dict[str, float | None]
    auroc_unknown: float | None
    fpr_at_95_recall: float | None


class Interval(Settings):
    """A difference with the bounds of its 95 % interval."""

    difference: float | None
    low: float | None
    high: float | None


class PairedDifference(Settings):
    """Scores of one predictor minus those of another on the same windows.

    groups: number of scenario seeds over which the interval is bootstrapped.
    macro_f1: difference in macro-F1.
    per_class_f1: difference in F1 of each intention, by its name.
    """

    groups: int
    macro_f1: Interval
    per_class_f1: dict[str, Interval]

    @property
    def has_interval(self) -> bool:
        """Whether `low` and `high` mean anything: a bootstrap over a single scenario seed draws only that seed."""
        return self.groups > 1


class Spread(Settings):
    """Mean and spread of a score over trainings.

    mean: over the trainings that have the score.
    sd: sample standard deviation (n - 1); None with fewer than two trainings.
    n: number of trainings that have the score.
    """

    mean: float | None
    sd: float | None
    n: int


class PairSpreads(Settings):
    """Spread of the scores of `PairScores`."""

    accuracy: Spread
    auroc: Spread


class ScoreSpreads(Settings):
    """Mean and spread of a predictor's scores over its training seeds; keys as in `RunResult`."""

    accuracy: Spread
    macro_f1: Spread
    auroc_unknown: Spread
    per_class_f1: dict[str, Spread]
    overtake_against_left: PairSpreads


class PredictorResult(ResultWithOptionalParts):
    """The runs of one predictor, which differ in the training seed alone, summed up.

    name: of the predictor.
    training_seeds: training seed of each run.
    accuracy, macro_f1, auroc_unknown, per_class_f1, overtake_against_left: as in `ScoreSpreads`.
    paired_difference: mean scores of the first predictor minus those of this one; absent for the first.
    """

    optional_parts: ClassVar[frozenset[str]] = frozenset({"paired_difference"})

    name: str
    training_seeds: list[int]
    accuracy: Spread
    macro_f1: Spread
    auroc_unknown: Spread
    per_class_f1: dict[str, Spread]
    overtake_against_left: PairSpreads
    paired_difference: PairedDifference | None = None


class RunResult(ResultWithOptionalParts):
    """All metrics of one run.

    model: the predictor, as `training.model` names it.
    name: of the run in tables and figures; unique among the runs that are compared.
    classes: names of the known intentions, in the order of the confusion matrix.
    n, accuracy, macro_f1, per_class_f1, confusion: as in `Summary`, on windows of known intentions.
    maneuvers: precision, recall and F1 on windows of known intentions.
    maneuvers_with_background: the same with `following` as background; rejected windows count as background.
    overtake_against_left: how well a left lane change and an overtake are told apart.
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

    optional_parts: ClassVar[frozenset[str]] = frozenset({"held_out", "by_window_end"})

    model: str
    name: str
    classes: tuple[str, ...]
    n: int
    accuracy: float | None
    macro_f1: float | None
    per_class_f1: dict[str, float | None]
    confusion: list[list[int]]
    maneuvers: ManeuverScores
    maneuvers_with_background: ManeuverScores
    overtake_against_left: PairScores
    n_unknown: int
    auroc_unknown: float | None
    unknown_score: str
    unknown_scores: dict[str, Separation]
    held_out: HeldOutScores | None = None
    calibration: Calibration
    by_lead_time: list[LeadTimeBin]
    by_snr: list[SnrBin]
    by_window_end: list[WindowEndScores] | None = None

    def score(self, name: ScoreName) -> float | None:
        """Return one of the scores that sum up a run."""
        return {"macro_f1": self.macro_f1, "accuracy": self.accuracy, "auroc_unknown": self.auroc_unknown}[name]


class ComparedResult(RunResult):
    """Metrics of a run that the evaluated one is compared with.

    paired_difference: scores of the evaluated run minus those of this one, on the windows that both know.
    """

    paired_difference: PairedDifference


class MeasuredWindows(WindowSettings):
    """The windows of an evaluation: those of the run, with the range of ends that was measured.

    ends_per_record: fixed windows of each record.
    seed: of the window ends.
    window_end_curve: settings of `by_window_end`; None where it was not measured. Formerly `sweep`.
    """

    ends_per_record: int
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
    windows: the windows that were measured.
    made_by: dataset, runs and versions behind the result.
    """

    optional_parts: ClassVar[frozenset[str]] = RunResult.optional_parts | {"over_training_seeds"}

    compared: list[ComparedResult] = Field(default_factory=list)
    over_training_seeds: list[PredictorResult] | None = None
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
