"""Runs a sweep: the datasets, trainings and evaluations of many cells, and one table of them.

    OUT/datasets/<network>/<sensing>/               the first is generated, the others are its records sensed anew
    OUT/cells/<network>/<sensing>/<model>/
        seed-<n>/                                   the predictor trained with that seed
        report/                                     all of them on their network's test seeds, beside the floor
        report_<network>/                           the same on another network's test seeds
    OUT/table.csv, OUT/table.json                   a row for each cell
    OUT/report/                                     the table and its figure as a page

All cells of a network train, validate and test on the same scenario seeds, and on the same records except those that a
sensor cannot use. Each part resumes where it stopped. A cell that fails is reported and left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path

import numpy as np

from isacsim.errors import NO_ROOM, InputError, OutputError, RunError
from isacsim.feedback import SILENT, Feedback
from isacsim.versions import OF_RUNS, versions
from labeling.dataset.dataset import Dataset, read_meta
from labeling.generation.cost_estimate import estimate, sensed_anew
from labeling.generation.engine import Engine, describe
from labeling.generation.generate import generate
from labeling.generation.resense import ResenseSettings, resense
from labeling.generation.settings import DatasetStudy
from models.data.windows import COLUMNS, Records, SplitSettings, split
from models.evaluation.evaluation import evaluate_records
from models.evaluation.results import EvaluationResult, read_metrics
from models.report.evaluation_figures import draw_figures
from models.report.report import PAGE, write_page
from models.roles import FLOOR
from models.run import Run, load_run, read_card
from models.studies.cost_estimate import cell_s, estimate_study
from models.studies.single import claim_study
from models.studies.study import Study
from models.studies.sweep_axes import Cell, Sensing, sensings
from models.studies.sweep_results import FailedTraining, SweepMadeBy, SweepResult, SweepRow
from models.studies.sweep_table import row_of, write_sweep
from models.training.progress import Steps
from models.training.training import train_records


def run_sweep(study: Study, out: Path, engine: Engine, feedback: Feedback = SILENT) -> SweepResult:
    """Run all cells of a study in a folder of its own; return the table.

    engine: what generates and senses the datasets. feedback: where progress is reported.
    Raises InputError where a dataset's settings or folder are wrong, OutputError where nothing can be written.
    """
    with claim_study(out, study):
        sweep = Sweep(study, out, engine, feedback)
        sweep.make_datasets()
        sweep.measure_cells()
        result = sweep.result()
        write_sweep(result, out)
    return result


class Sweep:
    """A sweep in progress, and what is finished of it.

    datasets: by network and way of sensing.
    sides: scenario seeds to train, validate and test on, by network.
    rows: of the table.
    failed: trainings left out, with the reason.
    """

    def __init__(self, study: Study, out: Path, engine: Engine, feedback: Feedback) -> None:
        self.study, self.out, self.engine, self.feedback = study, out, engine, feedback
        self.axes = study.axes
        self.datasets: dict[tuple[str, Sensing], Dataset] = {}
        self.sides: dict[str, dict[str, list[str]]] = {}
        self.rows: list[SweepRow] = []
        self.failed: list[FailedTraining] = []
        self.steps = Steps(feedback, estimate_study(study).seconds(engine.workers))
        # Room for the records that a cell is trained on, and for those of other networks that it is tested on.
        self.records = lru_cache(maxsize=1 + len(self.axes.test_on))(self._load)

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
                self._leave_out(cells, self.axes.training_seeds, error)
                continue
            self._sense(network, study, generated)

    def measure_cells(self) -> None:
        """Train and evaluate every cell whose dataset exists; a cell's floor comes before it."""
        cells = self.study.cells
        for number, cell in enumerate(cells):
            if (cell.network, cell.sensing) in self.datasets:
                self._measure(cell, f"cell {number + 1} of {len(cells)} ({cell})")

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

    def _measure(self, cell: Cell, title: str) -> None:
        """Train a cell and evaluate it, as far as that is not finished, and add its rows to the table."""
        folder = self.out / "cells" / cell.path
        others = [
            network
            for network in self.axes.test_on
            if network != cell.network and (network, cell.sensing) in self.datasets
        ]
        reports = {cell.network: folder / "report", **{network: folder / f"report_{network}" for network in others}}
        results = {network: self._finished_result(report, cell, network) for network, report in reports.items()}
        expected_s = cell_s(self.study, cell.model, estimate(self.study.networks[cell.network]).samples)
        if all(results.values()):
            self.steps.skip(expected_s * len(self.axes.training_seeds))
        elif runs := self._train(cell, folder, title, expected_s):
            with self._left_out(cell, [run.card.settings.seed for run in runs]):
                results = {
                    network: finished_result or self._evaluate(runs, cell, network, reports[network])
                    for network, finished_result in results.items()
                }
        for network, result in results.items():
            if result is not None:
                self.rows.append(row_of(cell, network, result, str(reports[network].relative_to(self.out))))

    def _train(self, cell: Cell, folder: Path, title: str, expected_s: float) -> list[Run]:
        """Return a cell's runs, one for each training seed but those that fail."""
        dataset, runs = self.datasets[cell.network, cell.sensing], []
        for seed in self.axes.training_seeds:
            out, settings = folder / f"seed-{seed}", self.study.training_of(cell.model, seed)
            card = read_card(out)
            with (
                self.steps.step(f"{title}, training seed {seed}", expected_s, card is not None and card.complete),
                self._left_out(cell, [seed]),
            ):
                records = self.records(cell.network, cell.sensing)
                sides = self.sides[cell.network]
                runs.append(train_records(records, made_of(dataset), out, settings, self.feedback, sides))
        return runs

    def _evaluate(self, runs: list[Run], cell: Cell, network: str, out: Path) -> EvaluationResult:
        """Measure a cell's runs on the test seeds of a network, and compare them with those of the floor."""
        records = self.records(network, cell.sensing)
        tested = records.take(np.isin(records.groups, self.sides[network]["test"]))
        origin = made_of(self.datasets[network, cell.sensing])
        against = [*runs[1:], *self._floors(cell)]
        evaluation = evaluate_records(runs[0], tested, origin, out, self.study.evaluation, against)
        draw_figures(evaluation, out)
        write_page(evaluation.result, out)
        return evaluation.result

    def _floors(self, cell: Cell) -> list[Run]:
        """Return the runs of the cell's floor; none for the floor itself. Those that failed are reported already."""
        if cell.model == FLOOR:
            return []
        folder = self.out / "cells" / Cell(cell.network, cell.sensing, FLOOR).path
        runs = []
        for seed in self.axes.training_seeds:
            with suppress(InputError):
                runs.append(load_run(folder / f"seed-{seed}"))
        return runs

    def _finished_result(self, report: Path, cell: Cell, network: str) -> EvaluationResult | None:
        """Return the result of an evaluation that is finished, on the current dataset and of all runs, else None."""
        # The page is written last.
        if not (report / PAGE).is_file() or (result := read_metrics(report)) is None:
            return None
        expected_runs = len(self.axes.training_seeds) * (1 if cell.model == FLOOR else 2)
        same_dataset = result.made_by.dataset.digest == self.datasets[network, cell.sensing].digest
        return result if same_dataset and len(result.made_by.runs) == expected_runs else None

    @contextmanager
    def _left_out(self, cell: Cell, seeds: Sequence[int]) -> Iterator[None]:
        """Leave out those training seeds where the work within fails, unless every other cell would fail, too."""
        try:
            yield
        except Exception as error:
            if isinstance(error, OutputError) or getattr(error, "errno", None) in NO_ROOM:
                raise
            self._leave_out([cell], seeds, error)

    def _load(self, network: str, sensing: Sensing) -> Records:
        return Records.of(self.datasets[network, sensing])

    def _folder(self, network: str, sensing: Sensing) -> Path:
        return self.out / "datasets" / network / sensing.name

    def _leave_out(self, cells: Sequence[Cell], seeds: Sequence[int], error: Exception) -> None:
        """Record trainings as failed, and report them."""
        reason = describe(error)
        self.failed += [
            FailedTraining(cell=str(cell), training_seed=seed, reason=reason) for cell in cells for seed in seeds
        ]
        place = cells[0].network if len(cells) > 1 else f"{cells[0]}, training seed {', '.join(map(str, seeds))}"
        self.feedback.message(f"left out: {place}: {reason}")


def shared_split(dataset: Dataset, settings: SplitSettings) -> dict[str, list[str]]:
    """Return the scenario seeds to train, validate and test on, shared by all ways of sensing a dataset.

    Raises RunError where the dataset has too few seeds.
    """
    table = dataset.frame(COLUMNS)
    no_states = np.empty((len(table), 6, 0), np.float32)
    try:
        return split(Records(no_states, no_states, dataset.meta.tv_rate_hz, dataset.meta.uv_rate_hz, table), settings)
    except InputError as error:
        raise RunError(str(error)) from None


def finished(folder: Path) -> bool:
    """Return whether a folder holds a complete dataset."""
    meta = read_meta(folder)
    return meta is not None and meta.complete


def made_of(dataset: Dataset) -> dict[str, object]:
    """Return what results record of the dataset that they come from."""
    return {"digest": dataset.digest, "study": dataset.meta.study}
