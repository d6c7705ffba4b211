"""A sweep: the datasets, trainings and evaluations of many cells, and one table of them.

    OUT/datasets/<network>/<sensing>/               the first generated, the others its records sensed anew
    OUT/cells/<network>/<sensing>/<model>/
        seed-<n>/                                   the predictor trained with that seed
        report/                                     all of them on their network's test seeds, beside the floor
        report_<network>/                           the same on another network's
    OUT/table.csv, OUT/table.json                   a row a cell
    OUT/report/                                     the table and its figure as a page

All cells of a network train, validate and test on the same scenario seeds, on the same records but for those that a
sensor cannot use. Every part resumes where it stopped. A cell that fails is told and left out.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

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
from models.evaluation.evaluation import METRICS_FILE, evaluate_records
from models.report.report import PAGE, write_page
from models.roles import FLOOR
from models.run import Run, load_run, read_card
from models.studies.cost_estimate import cell_s, estimate_study
from models.studies.single import claim_study
from models.studies.study import Study
from models.studies.sweep_axes import Cell, Sensing, sensings
from models.studies.sweep_table import row_of, write_sweep
from models.training.progress import Steps
from models.training.training import train_records


def run_sweep(study: Study, out: Path, engine: Engine, feedback: Feedback = SILENT) -> dict[str, Any]:
    """Run all cells of a study in a folder that is its own; returns what `table.json` holds.

    engine: what makes and senses the datasets. feedback: where progress is reported. Raises InputError where a
    dataset's settings or folder are at fault, OutputError where nothing can be written.
    """
    with claim_study(out, study):
        sweep = Sweep(study, out, engine, feedback)
        sweep.make_datasets()
        sweep.measure_cells()
        result = sweep.result()
        write_sweep(result, out)
    return result


class Sweep:
    """What stands of a sweep so far.

    datasets: by network and way of sensing. sides: of each network the scenario seeds to train, validate and test on.
    rows: of the table. failed: the trainings left out, with the reason.
    """

    def __init__(self, study: Study, out: Path, engine: Engine, feedback: Feedback) -> None:
        self.study, self.out, self.engine, self.feedback = study, out, engine, feedback
        self.axes = study.axes
        self.datasets: dict[tuple[str, Sensing], Dataset] = {}
        self.sides: dict[str, dict[str, list[str]]] = {}
        self.rows: list[dict[str, Any]] = []
        self.failed: list[dict[str, Any]] = []
        self.steps = Steps(feedback, estimate_study(study).seconds(engine.workers))
        # Those that a cell is trained on, and those that it is tested on besides.
        self.records = lru_cache(maxsize=1 + len(self.axes.test_on))(self._load)

    def make_datasets(self) -> None:
        """Of every network, generated once and sensed in every way; a network without samples is left out."""
        for network, study in self.study.networks.items():
            try:
                made = self._make(network, study)
                self.sides[network] = shared_split(made, self.study.training.split)
            except OutputError:
                raise
            except RunError as error:
                cells = [cell for cell in self.study.cells if cell.network == network]
                self._leave_out(cells, self.axes.training_seeds, error)
                continue
            self._sense(network, study, made)

    def measure_cells(self) -> None:
        """Train and evaluate every cell whose dataset stands; a cell's floor comes before it."""
        cells = self.study.cells
        for number, cell in enumerate(cells):
            if (cell.network, cell.sensing) in self.datasets:
                self._measure(cell, f"cell {number + 1} of {len(cells)} ({cell})")

    def result(self) -> dict[str, Any]:
        """What `table.json` holds."""
        return {
            "study": self.study.name,
            "trainings": len(self.study.cells) * len(self.axes.training_seeds),
            "cells": self.rows,
            "failed": self.failed,
            "made_by": {
                "study": self.study.model_dump(mode="json"),
                "datasets": {
                    f"{network}/{sensing.name}": dataset.digest for (network, sensing), dataset in self.datasets.items()
                },
                "seeds": self.sides,
                "versions": versions(OF_RUNS),
            },
        }

    def _make(self, network: str, study: DatasetStudy) -> Dataset:
        """Generate a network's dataset."""
        expected = estimate(study)
        folder = self._folder(network, self.study.first)
        title = f"dataset of {network}, {self.study.first}"
        with self.steps.step(title, expected.cpu_s / min(self.engine.workers, expected.episodes), finished(folder)):
            return generate(study, folder, self.engine, self.feedback)

    def _sense(self, network: str, study: DatasetStudy, made: Dataset) -> None:
        """Sense a network's dataset in every way."""
        for way in sensings(self.axes):
            if way == self.study.first:
                self.datasets[network, way] = made
                continue
            expected_s = sensed_anew(study, estimate(study), way.sensor).cpu_s / self.engine.workers
            settings = ResenseSettings(sensor=way.sensor, sensing=self.study.sensing_at(way.snr))
            folder = self._folder(network, way)
            with self.steps.step(f"dataset of {network}, {way}", expected_s, finished(folder)):
                self.datasets[network, way] = resense(made, settings, folder, self.engine, self.feedback)

    def _measure(self, cell: Cell, title: str) -> None:
        """Train a cell and evaluate it, as far as that does not stand yet, and add its rows to the table."""
        folder = self.out / "cells" / cell.path
        others = [each for each in self.axes.test_on if each != cell.network and (each, cell.sensing) in self.datasets]
        reports = {
            each: folder / ("report" if each == cell.network else f"report_{each}") for each in (cell.network, *others)
        }
        found = {each: self._standing(report, cell, each) for each, report in reports.items()}
        expected_s = cell_s(self.study, cell.model, estimate(self.study.networks[cell.network]).samples)
        if all(found.values()):
            self.steps.skip(expected_s * len(self.axes.training_seeds))
        elif runs := self._train(cell, folder, title, expected_s):
            with self._left_out(cell, [run.card.settings.seed for run in runs]):
                found = {each: kept or self._evaluate(runs, cell, each, reports[each]) for each, kept in found.items()}
        for network, metrics in found.items():
            if metrics:
                self.rows.append(row_of(cell, network, metrics, str(reports[network].relative_to(self.out))))

    def _train(self, cell: Cell, folder: Path, title: str, expected_s: float) -> list[Run]:
        """A cell's runs, a training seed each, those left out that fail."""
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

    def _evaluate(self, runs: list[Run], cell: Cell, network: str, out: Path) -> dict[str, Any]:
        """Measure a cell's runs on the test seeds of a network, beside the floor's."""
        records = self.records(network, cell.sensing)
        tested = records.take(np.isin(records.groups, self.sides[network]["test"]))
        made = made_of(self.datasets[network, cell.sensing])
        against = [*runs[1:], *self._floors(cell)]
        metrics = evaluate_records(runs[0], tested, made, out, self.study.evaluation, against)
        write_page(metrics, out)
        return metrics

    def _floors(self, cell: Cell) -> list[Run]:
        """The floor's runs; none for the floor itself. Those that failed are told already."""
        if cell.model == FLOOR:
            return []
        folder = self.out / "cells" / Cell(cell.network, cell.sensing, FLOOR).path
        found = []
        for seed in self.axes.training_seeds:
            with suppress(InputError):
                found.append(load_run(folder / f"seed-{seed}"))
        return found

    def _standing(self, report: Path, cell: Cell, network: str) -> dict[str, Any] | None:
        """The metrics of an evaluation that is finished, on that dataset and of all runs; the page is written last."""
        if not (report / PAGE).is_file():
            return None
        metrics: dict[str, Any] = json.loads((report / METRICS_FILE).read_text())
        made, runs = metrics["made_by"], len(self.axes.training_seeds) * (1 if cell.model == FLOOR else 2)
        whole = made["dataset"]["digest"] == self.datasets[network, cell.sensing].digest and len(made["runs"]) == runs
        return metrics if whole else None

    @contextmanager
    def _left_out(self, cell: Cell, seeds: Sequence[int]) -> Iterator[None]:
        """Around work on a cell: where it fails, those training seeds are left out, unless no other would go well."""
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
        """Take trainings for failed, and tell."""
        reason = describe(error)
        self.failed += [
            {"cell": str(cell), "training_seed": each, "reason": reason} for cell in cells for each in seeds
        ]
        what = cells[0].network if len(cells) > 1 else f"{cells[0]}, training seed {', '.join(map(str, seeds))}"
        self.feedback.message(f"left out: {what}: {reason}")


def shared_split(dataset: Dataset, settings: SplitSettings) -> dict[str, list[str]]:
    """The sides that all ways of sensing a dataset share. Raises RunError where its seeds are too few."""
    table = dataset.frame(COLUMNS)
    nothing = np.empty((len(table), 6, 0), np.float32)
    try:
        return split(Records(nothing, nothing, dataset.meta.tv_rate_hz, dataset.meta.uv_rate_hz, table), settings)
    except InputError as error:
        raise RunError(str(error)) from None


def finished(folder: Path) -> bool:
    """Whether a folder holds a whole dataset."""
    meta = read_meta(folder)
    return meta is not None and meta.complete


def made_of(dataset: Dataset) -> dict[str, Any]:
    """What results say of the dataset that they come from."""
    return {"digest": dataset.digest, "study": dataset.meta.study}
