"""Runs a sweep: the datasets, trainings and evaluations of many cells, and one table of them.

    OUT/datasets/<network>/<sensing>/               the first is generated, the others are its records sensed anew
    OUT/cells/<network>/<sensing>/<model>/
        seed-<n>/                                   the predictor trained with that seed
        report/                                     all of them on their network's test seeds, beside the floor
        report_<network>/                           the same on another network's test seeds
    OUT/table.csv, OUT/table.json                   a row for each cell
    OUT/report/                                     the table and its figure as a page, and what moves on it

All cells of a network train, validate and test on the same scenario seeds, and on the same records except those that a
sensor cannot use. Each part resumes where it stopped. A cell that fails is reported and left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from isac_cosim.base.errors import InputError, OutputError, RunError
from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.versions import OF_RUNS, versions
from isac_cosim.base.workers.attempts import describe
from isac_cosim.base.workers.engine import Engine
from isac_cosim.base.workers.kept_workers import kept_running
from isac_cosim.evaluation.on_windows.coverage import lacking, records_without_states
from isac_cosim.evaluation.on_windows.results import EvaluationResult, read_metrics
from isac_cosim.evaluation.report.page import PAGE
from isac_cosim.evaluation.report.replay.content import Replay
from isac_cosim.evaluation.report.replay.kept import read_replay
from isac_cosim.evaluation.report.replay.making import replay_of_test
from isac_cosim.labeling.dataset.dataset import Dataset, read_description
from isac_cosim.labeling.generation.cost_estimate import estimate, sensed_anew
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.resense import ResenseSettings, resense
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.models import FLOOR
from isac_cosim.models.data.split import SplitSettings, split
from isac_cosim.models.training.progress import Steps, slowdown_now
from isac_cosim.studies.cell_tasks import CellEvaluation, CellTraining, run_tasks
from isac_cosim.studies.cost_estimate import cell_s, estimate_study
from isac_cosim.studies.single import claim_study
from isac_cosim.studies.study import Study
from isac_cosim.studies.sweep_axes import Cell, WayOfSensing, sensings
from isac_cosim.studies.sweep_results import FailedTraining, SweepMadeBy, SweepResult, SweepRow
from isac_cosim.studies.sweep_table import REPORT, best_of, is_written, row_of, write_sweep


def run_sweep(study: Study, out: Path, engine: Engine, feedback: Feedback = SILENT) -> SweepResult:
    """Run all cells of a study in a folder of its own; return the table.

    engine: runs the episodes, trainings and evaluations; the results do not depend on it. feedback: where progress is
    reported.
    Raises InputError where a dataset's settings or folder are wrong, OutputError where nothing can be written.
    """
    with claim_study(out, study), kept_running(engine) as workers:
        # Workers of a cluster may run in another folder.
        sweep = Sweep(study, out.resolve(), workers, feedback)
        sweep.make_datasets()
        sweep.measure_cells()
        result = sweep.result()
        # The page is made anew each time, as this version makes it; what it shows in motion, only for a new result.
        kept = read_replay(out / REPORT) if is_written(result, out) else None
        write_sweep(result, out, kept or sweep.replay())
    return result


class Sweep:
    """A sweep in progress, and what is finished of it.

    datasets: by network and way of sensing.
    sides: scenario seeds to train, validate and test on, by network.
    rows: of the table.
    failed: trainings left out, with the reason.
    untrained: cells and training seeds of which there is no predictor.
    unmeasured: cells and networks whose evaluation failed.
    """

    def __init__(self, study: Study, out: Path, engine: Engine, feedback: Feedback) -> None:
        self.study, self.out, self.engine, self.feedback = study, out, engine, feedback
        self.axes = study.axes
        self.datasets: dict[tuple[str, WayOfSensing], Dataset] = {}
        self.sides: dict[str, dict[str, list[str]]] = {}
        self.rows: list[SweepRow] = []
        self.failed: list[FailedTraining] = []
        self.untrained: set[tuple[Cell, int]] = set()
        self.unmeasured: set[tuple[Cell, str]] = set()
        self.estimate = estimate_study(study)
        self.steps = Steps(feedback, self.estimate.seconds(engine.workers), slowdown_now(engine.workers))

    def make_datasets(self) -> None:
        """Generate the dataset of every network and sense it in every way; leave out networks without samples."""
        for network, study in self.study.networks.items():
            try:
                generated = self._generate(network, study)
                self.sides[network] = shared_split(generated, self.study.training.split)
            except OutputError:
                raise
            except RunError as error:
                cells = [cell for cell in self.study.cells if cell.network == network]
                self._leave_out(cells, self.axes.training_seeds, describe(error))
                continue
            for line in lacking(generated, self.study.training, self.study.evaluation, self.sides[network]):
                self.feedback.message(f"warning: {network}: {line}")
            self._sense(network, study, generated)

    def measure_cells(self) -> None:
        """Train and evaluate every cell whose dataset exists, as far as that is not finished, and fill the table.

        All trainings come first, because an evaluation compares with the cell's floor.
        """
        cells = [cell for cell in self.study.cells if (cell.network, cell.sensing) in self.datasets]
        unfinished = [cell for cell in cells if self._unfinished_networks(cell)]
        self.steps.skip(self._expected_s([cell for cell in cells if cell not in unfinished]))
        title = f"training and evaluation of {len(unfinished)} of {len(cells)} cells"
        with self.steps.step(title, self._expected_s(unfinished), not unfinished):
            self._train(unfinished)
            self._evaluate(unfinished)
        for cell in cells:
            for network in self._tested_networks(cell):
                if (result := self._finished_result(cell, network)) is not None:
                    report = self._report(cell, network).relative_to(self.out)
                    self.rows.append(row_of(cell, network, result, str(report)))

    def result(self) -> SweepResult:
        """Return the table."""
        return SweepResult(
            study=self.study.name,
            trainings=len(self.study.cells) * len(self.axes.training_seeds),
            cells=self.rows,
            failed=self.failed,
            made_by=SweepMadeBy(
                study=self.study,
                datasets={
                    f"{network}/{sensing.name}": dataset.digest for (network, sensing), dataset in self.datasets.items()
                },
                seeds=self.sides,
                versions=versions(OF_RUNS),
            ),
        )

    def replay(self) -> Replay | None:
        """Return the replay of a test episode of the best cell, with its predictor's answers; None without one."""
        best = best_of(self.rows)
        if best is None:
            return None
        cell = Cell(best.network, best.sensing, best.model)
        run = self._run(cell, self._trained_seeds(cell)[0])
        return replay_of_test(self._folder(cell.network, cell.sensing), run, self.engine, self.feedback)

    def _generate(self, network: str, study: DatasetStudy) -> Dataset:
        """Generate a network's dataset."""
        expected = estimate(study)
        folder = self._folder(network, self.study.first)
        title = f"dataset of {network}, {self.study.first}"
        with self.steps.step(title, expected.cpu_s / min(self.engine.workers, expected.episodes), finished(folder)):
            return generate(study, folder, self.engine, self.feedback)

    def _sense(self, network: str, study: DatasetStudy, generated: Dataset) -> None:
        """Sense a network's dataset in every way."""
        for sensing in sensings(self.axes):
            if sensing == self.study.first:
                self.datasets[network, sensing] = generated
                continue
            expected_s = sensed_anew(study, estimate(study), sensing.sensor).cpu_s / self.engine.workers
            settings = ResenseSettings(sensor=sensing.sensor, sensing=self.study.sensing_at(sensing.snr))
            folder = self._folder(network, sensing)
            with self.steps.step(f"dataset of {network}, {sensing}", expected_s, finished(folder)):
                self.datasets[network, sensing] = resense(generated, settings, folder, self.engine, self.feedback)

    def _train(self, cells: Sequence[Cell]) -> None:
        """Run the trainings of cells that are not finished; report and leave out those that fail."""
        trainings = [self._training(cell, seed) for cell in cells for seed in self.axes.training_seeds]
        digests = {key: dataset.digest for key, dataset in self.datasets.items()}
        missing = [
            training
            for training in trainings
            if not training.is_finished(digests[training.cell.network, training.cell.sensing])
        ]
        threads = self.study.training.optimiser.threads

        def failed(training: CellTraining, reason: str) -> None:
            self.untrained.add((training.cell, training.training.seed))
            self._leave_out([training.cell], [training.training.seed], reason)

        run_tasks(missing, self.engine, self.feedback, "training", "trainings", failed, threads)

    def _evaluate(self, cells: Sequence[Cell]) -> None:
        """Run the evaluations of cells that are not finished; report and leave out those that fail."""
        evaluations = [
            self._evaluation(cell, network, seeds)
            for cell in cells
            if (seeds := self._trained_seeds(cell))
            for network in self._unfinished_networks(cell)
        ]

        def failed(evaluation: CellEvaluation, reason: str) -> None:
            self.unmeasured.add((evaluation.cell, evaluation.network))
            self._leave_out([evaluation.cell], self._trained_seeds(evaluation.cell), reason)

        run_tasks(evaluations, self.engine, self.feedback, "evaluating", "evaluations", failed)

    def _training(self, cell: Cell, seed: int) -> CellTraining:
        """Return the training of a cell with a training seed."""
        dataset, run = self.datasets[cell.network, cell.sensing], self._run(cell, seed)
        return CellTraining(cell, dataset.path, self.sides[cell.network], self.study.training_of(cell.model, seed), run)

    def _evaluation(self, cell: Cell, network: str, seeds: Sequence[int]) -> CellEvaluation:
        """Return the evaluation of a cell's runs with some training seeds on a network, beside the floor's."""
        return CellEvaluation(
            cell=cell,
            network=network,
            dataset=self.datasets[network, cell.sensing].path,
            seeds=tuple(self.sides[network]["test"]),
            runs=tuple(self._run(cell, seed) for seed in seeds),
            floors=tuple(self._floor_runs(cell)),
            evaluation=self.study.evaluation,
            report=self._report(cell, network),
            table=self.out / REPORT,
        )

    def _trained_seeds(self, cell: Cell) -> list[int]:
        """Return the training seeds of which a cell has a predictor."""
        return [seed for seed in self.axes.training_seeds if (cell, seed) not in self.untrained]

    def _floor_runs(self, cell: Cell) -> list[Path]:
        """Return the folders of the cell's floor, which it is compared with; none for the floor itself."""
        floor = Cell(cell.network, cell.sensing, FLOOR)
        return [] if cell == floor else [self._run(floor, seed) for seed in self._trained_seeds(floor)]

    def _tested_networks(self, cell: Cell) -> list[str]:
        """Return the networks on whose test seeds a cell is measured, its own first."""
        others = (network for network in self.axes.test_on if network != cell.network)
        return [cell.network, *(network for network in others if (network, cell.sensing) in self.datasets)]

    def _unfinished_networks(self, cell: Cell) -> list[str]:
        """Return those of them on which it is not measured yet."""
        return [network for network in self._tested_networks(cell) if self._finished_result(cell, network) is None]

    def _finished_result(self, cell: Cell, network: str) -> EvaluationResult | None:
        """Return the result of an evaluation that is finished, on the current dataset and of all runs, else None."""
        report = self._report(cell, network)
        if not self._trained_seeds(cell) or (cell, network) in self.unmeasured:
            return None
        # The page is written last.
        if not (report / PAGE).is_file() or (result := read_metrics(report)) is None:
            return None
        expected_runs = len(self._trained_seeds(cell)) + len(self._floor_runs(cell))
        same_dataset = result.made_by.dataset.digest == self.datasets[network, cell.sensing].digest
        return result if same_dataset and len(result.made_by.runs) == expected_runs else None

    def _expected_s(self, cells: Sequence[Cell]) -> float:
        """Return how long the trainings and evaluations of cells are expected to take, s."""
        samples = {network: estimate(study).samples for network, study in self.study.networks.items()}
        cpu_s = sum(cell_s(self.study, cell.model, samples[cell.network]) for cell in cells)
        return cpu_s * len(self.axes.training_seeds) / self.estimate.trainings_at_once(self.engine.workers)

    def _folder(self, network: str, sensing: WayOfSensing) -> Path:
        return self.out / "datasets" / network / sensing.name

    def _run(self, cell: Cell, seed: int) -> Path:
        return self.out / "cells" / cell.path / f"seed-{seed}"

    def _report(self, cell: Cell, network: str) -> Path:
        return self.out / "cells" / cell.path / ("report" if network == cell.network else f"report_{network}")

    def _leave_out(self, cells: Sequence[Cell], seeds: Sequence[int], reason: str) -> None:
        """Record trainings as failed, and report them."""
        self.failed += [
            FailedTraining(cell=str(cell), training_seed=seed, reason=reason) for cell in cells for seed in seeds
        ]
        place = cells[0].network if len(cells) > 1 else f"{cells[0]}, training seed {', '.join(map(str, seeds))}"
        self.feedback.message(f"left out: {place}: {reason}")


def shared_split(dataset: Dataset, settings: SplitSettings) -> dict[str, list[str]]:
    """Return the scenario seeds to train, validate and test on, shared by all ways of sensing a dataset.

    Raises RunError where the dataset has too few seeds.
    """
    try:
        return split(records_without_states(dataset), settings)
    except InputError as error:
        raise RunError(str(error)) from None


def finished(folder: Path) -> bool:
    """Return whether a folder holds a complete dataset."""
    meta = read_description(folder)
    return meta is not None and meta.complete
