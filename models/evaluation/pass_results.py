"""Whether the TV passes the UV soon after a window, typed: how well predictors answer that."""

from __future__ import annotations

from isacsim.settings import Settings


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
