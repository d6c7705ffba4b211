"""What a sweep measured, typed: the content of `table.json`."""

from __future__ import annotations

from isac_cosim.base.settings import Settings
from isac_cosim.evaluation.on_windows.results import ScoreName
from isac_cosim.studies.study import Study
from isac_cosim.studies.sweep_axes import WayOfSensing


class TrainingScores(Settings):
    """Scores of one training of a cell.

    training_seed: its seed.
    before_commit_macro_f1: macro-F1 of the windows before the commit.
    macro_f1, accuracy, auroc_unknown: as in `metrics.json`.
    """

    training_seed: int
    before_commit_macro_f1: float | None
    macro_f1: float | None
    accuracy: float | None
    auroc_unknown: float | None


class SweepRow(Settings):
    """One row of the table: the predictors of one cell, measured on the test seeds of one network.

    network, sensor, snr, model: the cell; snr is None for the study's own channel and for other sensors than the sites.
    tested_on: network whose test seeds were measured.
    trainings: number of trainings, one for each training seed.
    test_seeds: number of scenario seeds that the windows come from.
    windows: number of windows of known intentions.
    before_commit_windows: number of those that end before the commit.
    before_commit_macro_f1: macro-F1 of those, mean over the trainings.
    before_commit_macro_f1_over, macro_f1_over: number of intentions in the two macro-F1s; None in files of earlier
    versions.
    macro_f1, accuracy, auroc_unknown: of all windows, mean over the trainings; None where none has the score.
    before_commit_macro_f1_sd, macro_f1_sd, accuracy_sd, auroc_unknown_sd: sample standard deviation; None with fewer
    than two trainings.
    before_commit_ahead_of_floor: mean macro-F1 before the commit minus that of the floor on the same windows; None for
    the floor itself.
    before_commit_low, before_commit_high: bounds of the 95 % interval of that difference; None with a single test seed.
    ahead_of_floor, low, high: the same on all windows.
    report: folder of the evaluation, relative to that of the sweep.
    runs: scores of each training.
    """

    network: str
    sensor: str
    snr: str | None
    model: str
    tested_on: str
    trainings: int
    test_seeds: int | None
    windows: int
    before_commit_windows: int | None
    before_commit_macro_f1: float | None
    before_commit_macro_f1_sd: float | None
    before_commit_macro_f1_over: int | None = None
    macro_f1: float | None
    macro_f1_sd: float | None
    macro_f1_over: int | None = None
    accuracy: float | None
    accuracy_sd: float | None
    auroc_unknown: float | None
    auroc_unknown_sd: float | None
    before_commit_ahead_of_floor: float | None
    before_commit_low: float | None
    before_commit_high: float | None
    ahead_of_floor: float | None
    low: float | None
    high: float | None
    report: str
    runs: list[TrainingScores]

    @property
    def sensing(self) -> WayOfSensing:
        """What sensed the records."""
        return WayOfSensing(self.sensor, self.snr)

    def over(self, name: ScoreName) -> int | None:
        """Return over how many intentions a score is a mean; None where it is not one, or that is not known."""
        return {
            "before_commit_macro_f1": self.before_commit_macro_f1_over, "macro_f1": self.macro_f1_over
        }.get(name)  # fmt: skip

    def score(self, name: ScoreName) -> tuple[float | None, float | None]:
        """Return mean and standard deviation of a score."""
        return {
            "before_commit_macro_f1": (self.before_commit_macro_f1, self.before_commit_macro_f1_sd),
            "macro_f1": (self.macro_f1, self.macro_f1_sd),
            "accuracy": (self.accuracy, self.accuracy_sd),
            "auroc_unknown": (self.auroc_unknown, self.auroc_unknown_sd),
        }[name]


class FailedTraining(Settings):
    """A training that failed and is left out of the table.

    cell, training_seed: which one.
    reason: why, in one line.
    """

    cell: str
    training_seed: int
    reason: str


class SweepMadeBy(Settings):
    """What made the table.

    study: the study, all defaults filled in.
    datasets: digest of each dataset, by `<network>/<sensing>`.
    seeds: scenario seeds of the sides train, validation and test, by network.
    versions: of the packages that scores depend on, by the package's name.
    """

    study: Study
    datasets: dict[str, str]
    seeds: dict[str, dict[str, list[str]]]
    versions: dict[str, str]


class SweepResult(Settings):
    """The content of `table.json`.

    study: name of the study.
    trainings: number of trainings, those that failed included.
    cells: rows of the table.
    failed: trainings that were left out.
    made_by: study, datasets and versions behind the table.
    """

    study: str
    trainings: int
    cells: list[SweepRow]
    failed: list[FailedTraining]
    made_by: SweepMadeBy
