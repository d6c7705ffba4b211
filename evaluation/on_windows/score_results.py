"""Scores on a set of windows, typed: what results are made of.

A score is None (`null` in a file) where it is undefined, for example the F1 of an intention without a true window.
Scores lie between 0 and 1.
"""

from __future__ import annotations

from isac_cosim.base.settings import Settings
from isac_cosim.models.runs.former_names import OpenSetScore

LEAST_FOR_VERDICT = 3
"""With fewer scenario seeds than this, no predictor is called better than another."""


class Summary(Settings):
    """How well n windows were classified.

    n: number of windows.
    accuracy: share of windows classified correctly.
    macro_f1: mean F1 over the classes that have a true window.
    macro_f1_over: names of the classes in that mean; None in files of earlier versions.
    per_class_f1: F1 of each class, by its name.
    confusion: number of windows, G x G, rows true and columns predicted.
    """

    n: int
    accuracy: float | None
    macro_f1: float | None
    macro_f1_over: list[str] | None = None
    per_class_f1: dict[str, float | None]
    confusion: list[list[int]]


class ManeuverScores(Settings):
    """Macro-averaged precision and recall over maneuvers, and their harmonic mean. Source: CaSTFormer, Eq. (13)."""

    precision: float | None
    recall: float | None
    f1: float | None


class ClassScores(Settings):
    """How well the windows of one intention were recognised.

    n: number of its windows.
    recall, f1: None without any.
    """

    n: int
    recall: float | None
    f1: float | None


class ClassifiedWindows(Settings):
    """How well n windows were classified, with the number of scenario seeds behind it.

    n: number of windows.
    groups: number of scenario seeds that they come from.
    accuracy: share of windows classified correctly.
    macro_f1: mean F1 over the intentions with at least `evaluation.on_windows.metrics.LEAST_IN_BIN` windows.
    macro_f1_low, macro_f1_high: its 95 % interval over scenario seeds; None with fewer than two.
    macro_f1_over: names of the intentions in that mean.
    per_class: scores of each intention, by its name.
    """

    n: int
    groups: int
    accuracy: float | None
    macro_f1: float | None
    macro_f1_low: float | None
    macro_f1_high: float | None
    macro_f1_over: list[str]
    per_class: dict[str, ClassScores]


class LeadScores(ClassifiedWindows):
    """Scores of windows that all end at the same time before the commit, and not before the onset.

    lead_s: that time, s. Intentions that commit sooner after their onset have no window here.
    by_origin: the same scores by the origin of the maneuver.
    """

    lead_s: float
    by_origin: dict[str, ClassifiedWindows]


class CommitDelay(Settings):
    """How long after its onset an intention commits.

    n: number of measured records.
    median_s: median time from onset to commit, s; None without a record.
    at_once: whether the median is so short (`commit.AT_ONCE_S`) that the intention can be recognised,
    but hardly predicted.
    """

    n: int
    median_s: float | None
    at_once: bool


class BeforeCommit(ClassifiedWindows):
    """Prediction: scores of the windows that end at or after the onset and before the commit.

    confusion: number of windows, G x G, rows true and columns predicted.
    by_lead: scores at fixed times before the commit; these windows are cut for the purpose, and are not among the n.
    by_origin: scores by the origin of the maneuver.
    onset_to_commit: how long each intention takes from onset to commit, by its name.
    """

    confusion: list[list[int]]
    by_lead: list[LeadScores]
    by_origin: dict[str, ClassifiedWindows]
    onset_to_commit: dict[str, CommitDelay]


class AfterCommit(ClassifiedWindows):
    """Recognition: scores of the windows that end at or after the commit.

    confusion: number of windows, G x G, rows true and columns predicted.
    """

    confusion: list[list[int]]


class FiveClassScores(Settings):
    """Scores with overtake and left lane change as one intention, which begin alike.

    Where traffic keeps left, an overtake begins like a right lane change, and these two are one.

    classes: names of the five intentions.
    n, accuracy, macro_f1, macro_f1_over, per_class_f1: as in `Summary`, with predictions of either intention counted as
    the joint one.
    before_commit_macro_f1, before_commit_macro_f1_over: the macro-F1 of the windows before the commit, as in
    `ClassifiedWindows`.
    """

    classes: list[str]
    n: int
    accuracy: float | None
    macro_f1: float | None
    macro_f1_over: list[str] | None = None
    per_class_f1: dict[str, float | None]
    before_commit_macro_f1: float | None
    before_commit_macro_f1_over: list[str] | None = None


class PairScores(Settings):
    """How well two intentions are distinguished, on windows of these two only.

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
    unknown_scores: dict[OpenSetScore, Separation]


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
    macro_f1_over: names of the intentions in that mean; None in files of earlier versions.
    auroc_unknown, fpr_at_95_recall: separation of those windows from all windows of `following`, which has no commit.
    """

    from_s: float
    to_s: float
    n: int
    accuracy: float | None
    macro_f1: float | None
    macro_f1_over: list[str] | None = None
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
    macro_f1_over: names of the intentions in that mean; None in files of earlier versions.
    """

    from_db: float
    to_db: float
    n: int
    accuracy: float | None
    macro_f1: float | None
    macro_f1_over: list[str] | None = None


class WindowEndScores(Settings):
    """Scores when every window ends at the same time relative to onset or commit: one point of the window-end curve.

    end_s: end of the windows, s after that instant.
    n: number of known windows; records that cannot hold such a window take no part.
    accuracy, macro_f1, macro_f1_over, per_class_f1: on those windows, as in `Summary`.
    auroc_unknown, fpr_at_95_recall: separation of those windows from windows of `following` with the same end.
    """

    end_s: float
    n: int
    accuracy: float | None
    macro_f1: float | None
    macro_f1_over: list[str] | None = None
    per_class_f1: dict[str, float | None]
    auroc_unknown: float | None
    fpr_at_95_recall: float | None


class Difference(Settings):
    """A difference with the bounds of its 95 % interval, which are None where there is none."""

    difference: float | None
    low: float | None
    high: float | None


class PairedDifference(Settings):
    """Scores of one predictor minus those of another on the same windows.

    groups: number of scenario seeds behind the intervals.
    macro_f1: difference in macro-F1.
    macro_f1_over: names of the intentions in both means; None in files of earlier versions.
    per_class_f1: difference in F1 of each intention, by its name.
    """

    groups: int
    macro_f1: Difference
    macro_f1_over: list[str] | None = None
    per_class_f1: dict[str, Difference]

    @property
    def has_interval(self) -> bool:
        """Whether `low` and `high` mean anything: a single scenario seed says nothing about others."""
        return self.groups > 1

    @property
    def allows_verdict(self) -> bool:
        """Whether there are enough scenario seeds to call one predictor better than the other."""
        return self.groups >= LEAST_FOR_VERDICT


class LeadDifference(PairedDifference):
    """The paired difference on windows that all end at the same time before the commit, and not before the onset.

    lead_s: that time, s.
    """

    lead_s: float


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
    """Mean and spread of a predictor's scores over its training seeds; keys as in `RunResult`.

    before_commit_macro_f1: macro-F1 of the windows before the commit; None in files that do not have it.
    """

    accuracy: Spread
    macro_f1: Spread
    before_commit_macro_f1: Spread | None = None
    auroc_unknown: Spread
    per_class_f1: dict[str, Spread]
    overtake_against_left: PairSpreads
