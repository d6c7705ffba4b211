"""The frozen test set: every predictor is trained on the same samples, and scored on the same windows and traffic.

    python -m isac_cosim.studies.benchmark OUT [--model NAME] [--study FILE] [--no-live] [--jobs N]
    python -m isac_cosim.studies.benchmark --table FOLDER
    python -m isac_cosim.studies.benchmark --freeze [OUT]

The first generates the test set in OUT, trains the predictor, scores it, and writes OUT/NAME/row.json. Parts go on
where it stopped. FILE is a study whose `[training]` counts; its name is then part of NAME and stands in the row. The
second prints the table of the rows in a folder. The third freezes the test set as it is now: the settings' digests, and
that of the samples that OUT holds.

    OUT/training/, OUT/test/   the samples, the same for every predictor
    OUT/NAME/run/              the trained predictor, with NAME/hours.json
    OUT/NAME/test/, live/      its evaluations
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import Field
from rich.console import Console

from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.files import DIGEST, write_json
from isac_cosim.base.progress import ConsoleFeedback
from isac_cosim.base.settings import Settings, checked, read_json, read_toml
from isac_cosim.base.versions import OF_EPISODES, versions
from isac_cosim.base.workers.engine import Engine, LocalEngine
from isac_cosim.base.workers.kept_workers import kept_running
from isac_cosim.evaluation.in_traffic.measurement.evaluation import evaluate_traffic, study_of
from isac_cosim.evaluation.on_windows.evaluation import evaluate
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.evaluation.report.parts import markdown
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.settings import DatasetStudy, SeedRange
from isac_cosim.models import FLOOR
from isac_cosim.models.data.split import SplitSettings
from isac_cosim.models.predictors.registry import PREDICTORS
from isac_cosim.models.runs.run import Run
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.training import train
from isac_cosim.studies.study import Study, read_study
from isac_cosim.studies.world import digests, world_of

STUDY = Path(__file__).with_name("benchmark.toml")
FROZEN = Path(__file__).with_name("benchmark.json")
PARTS = ("traffic", "maneuvers", "labels", "sensing", "evaluation")
"""The parts of the settings that make the test set; the predictor is free."""
RATES = (1.0, 3.0, 10.0)
"""False alarms per vehicle-hour at which live recall is told."""
ROW, HOURS = "row.json", "hours.json"


class LiveSeeds(Settings):
    """The traffic of the live score: seeds to measure, seeds on which alarms are chosen, and their length, s."""

    seeds: SeedRange
    development: SeedRange
    duration_s: float = Field(gt=0.0)


class BenchmarkStudy(Settings):
    """The content of the study file. dataset: what predictors are trained on. split: of it; its own test side is
    not used. test: seeds of the same traffic, on which they are tested."""

    name: str = Field(pattern=r"^[a-z0-9-]+$")
    dataset: DatasetStudy
    split: SplitSettings
    test: SeedRange
    evaluation: EvaluateSettings
    live: LiveSeeds

    @property
    def tested(self) -> DatasetStudy:
        """The study of the dataset that predictors are tested on."""
        return self.dataset.model_copy(update={"seeds": self.test})

    def digests(self) -> dict[str, str]:
        """Return the digest of each part of the settings that the test set rests on."""
        return digests(world_of(Study(dataset=self.tested, evaluation=self.evaluation), PARTS))


class Frozen(Settings):
    """The test set as it was frozen. samples: digest of the tested dataset; None where it was not generated."""

    name: str
    versions: dict[str, str]
    digests: dict[str, str]
    samples: str | None = Field(None, pattern=DIGEST)


class Hours(Settings):
    """How long a training took, h; None if it was interrupted."""

    hours: float | None


class LiveScore(Settings):
    """Recall by the commit of alarms that were chosen for a rate of false alarms, and the rate that they raised."""

    recall: float | None
    false_alarms_per_vehicle_hour: float | None


class BenchmarkRow(Settings):
    """The score of a predictor. f1_by_lead: macro-F1 by lead time, s. live: by the rate that alarms were chosen for.

    training: its settings; None in rows that were written without. as_frozen: whether the samples are those that were
    frozen to the last bit; None where that is not known.
    """

    predictor: str
    test_set: str
    digests: dict[str, str]
    versions: dict[str, str]
    as_frozen: bool | None
    training_hours: float | None
    windows: int
    f1_by_lead: dict[str, float | None]
    live: dict[str, LiveScore] | None
    training: dict[str, Any] | None = None


def read_test_set(path: Path = STUDY) -> BenchmarkStudy:
    """Return the test set of a study file. Raises InputError where it is at fault."""
    return checked(BenchmarkStudy, read_toml(path), path)


def read_frozen(path: Path = FROZEN) -> Frozen:
    """Return what was frozen. Raises InputError where it is missing or damaged."""
    frozen = read_json(Frozen, path)
    if frozen is None:
        raise InputError(f"{path}: is missing; restore it, or freeze the test set (--freeze)")
    return frozen


def check(test_set: BenchmarkStudy, frozen: Frozen) -> None:
    """Raise InputError, with the parts that differ, where the settings are not those of the frozen test set."""
    now = test_set.digests()
    changed = [part for part in PARTS if now[part] != frozen.digests.get(part)]
    if test_set.name != frozen.name or changed:
        raise InputError(
            f"test set {frozen.name}: {', '.join(changed) or 'its name'} changed since it was frozen, so that scores "
            "cannot be compared; use a version from before that, or freeze another one (--freeze)"
        )


def freeze(test_set: BenchmarkStudy, out: Path | None, path: Path = FROZEN) -> Frozen:
    """Write what the test set is now, and return it. out: where its samples are, if they were generated."""
    samples = None if out is None else Dataset.open(out / "test").digest
    frozen = Frozen(name=test_set.name, versions=versions(OF_EPISODES), digests=test_set.digests(), samples=samples)
    write_json(path, frozen.model_dump(mode="json"))
    return frozen


def score(
    test_set: BenchmarkStudy,
    frozen: Frozen,
    training: TrainSettings,
    out: Path,
    engine: Engine,
    live: bool = True,
    feedback: Feedback = SILENT,
    study: str = "",
) -> BenchmarkRow:
    """Train a predictor on the test set's samples, score it, and write and return its row.

    live: whether it is measured in running traffic as well, which takes hours. study: name of the study that `training`
    is of, for the folder and the row; empty for the default. Raises InputError where the settings are not those that
    were frozen, or `out` holds something else.
    """
    check(test_set, frozen)
    training = training.model_copy(update={"split": test_set.split})
    folder = out / "-".join(filter(None, (training.model, study, str(training.seed))))
    with kept_running(engine) as workers:
        taught = generate(test_set.dataset, out / "training", workers, feedback)
        tested = generate(test_set.tested, out / "test", workers, feedback)
        run, hours = _trained(taught, training, folder, feedback)
        before_commit = evaluate(run, tested, folder / "test", test_set.evaluation).result.before_commit
        row = BenchmarkRow(
            predictor=", ".join(filter(None, (PREDICTORS[training.model].display_name, study))),
            test_set=test_set.name,
            digests=frozen.digests,
            versions=versions(OF_EPISODES),
            as_frozen=None if frozen.samples is None else frozen.samples == tested.digest,
            training_hours=hours,
            windows=0 if before_commit is None else before_commit.n,
            f1_by_lead={}
            if before_commit is None
            else {f"{scores.lead_s:g}": scores.macro_f1 for scores in before_commit.by_lead},
            live=_live(run, test_set, folder / "live", workers, feedback) if live else None,
            training=training.model_dump(mode="json"),
        )
    write_json(folder / ROW, row.model_dump(mode="json"))
    return row


def _trained(taught: Dataset, training: TrainSettings, folder: Path, feedback: Feedback) -> tuple[Run, float | None]:
    """Return the trained predictor, and how many hours that took, None if it was interrupted."""
    file = folder / HOURS
    begun, known = (folder / "run").exists(), read_json(Hours, file)
    start = time.perf_counter()
    run = train(taught, folder / "run", training, feedback)
    if known is None:
        known = Hours(hours=None if begun else (time.perf_counter() - start) / 3600.0)
        write_json(file, known.model_dump(mode="json"))
    return run, known.hours


def _live(run: Run, test_set: BenchmarkStudy, out: Path, engine: Engine, feedback: Feedback) -> dict[str, LiveScore]:
    live = test_set.live
    (scenario,) = test_set.dataset.scenarios
    seeds, development = ((of.first, of.last) for of in (live.seeds, live.development))
    study = study_of(run.card, scenario, seeds, development, live.duration_s, natural=True)
    prediction = evaluate_traffic(run, study, out, engine, feedback).result.prediction
    at = {} if prediction is None else {point.chosen_for: point for point in prediction.at}
    return {
        f"{rate:g}": LiveScore(
            recall=at[rate].recall if rate in at else None,
            false_alarms_per_vehicle_hour=at[rate].false_alarms_per_vehicle_hour if rate in at else None,
        )
        for rate in RATES
    }


def table(rows: Sequence[BenchmarkRow], frozen: Frozen) -> str:
    """Return the table of rows in Markdown, the best at the first lead time on top.

    Raises InputError where a row is of another test set.
    """
    for row in rows:
        if (row.test_set, row.digests) != (frozen.name, frozen.digests):
            raise InputError(f"{row.predictor}: was scored on another test set than {frozen.name}; score it again")
    leads = list(dict.fromkeys(lead for row in rows for lead in row.f1_by_lead))
    scored = [*(f"F1, {lead} s" for lead in leads), *(f"live, {rate:g}" for rate in RATES)]
    head = ["predictor", "training, h", *scored, "version"]
    lines = [
        [
            row.predictor,
            _number(row.training_hours, 2),
            *(_number(row.f1_by_lead.get(lead), 3) for lead in leads),
            *(_recall(row.live, f"{rate:g}") for rate in RATES),
            row.versions.get("isac-cosim", "") + ("" if row.as_frozen in (True, None) else ", other bytes"),
        ]
        for row in sorted(rows, key=lambda row: -(row.f1_by_lead.get(leads[0]) or 0.0))
    ]
    return markdown(head, lines)


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _recall(live: Mapping[str, LiveScore] | None, rate: str) -> str:
    if live is None or live[rate].recall is None:
        return ""
    return f"{_number(live[rate].recall, 3)} ({_number(live[rate].false_alarms_per_vehicle_hour, 1)})"


def main(arguments: Sequence[str] | None = None) -> int:
    """Do what the command line says; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, nargs="?", help="folder of the test set and the runs")
    parser.add_argument("--model", help=f"name of the predictor; default: {FLOOR}")
    parser.add_argument("--study", type=Path, help="study whose [training] counts")
    parser.add_argument("--seed", type=int, default=0, help="training seed")
    parser.add_argument("--no-live", action="store_true", help="windows only: minutes instead of hours")
    parser.add_argument("--jobs", type=int, default=1, help="number of worker processes")
    parser.add_argument("--table", type=Path, metavar="FOLDER", help="print the table of the rows in a folder")
    parser.add_argument("--freeze", action="store_true", help="freeze the test set as it is now")
    given = parser.parse_args(arguments)
    try:
        if given.freeze:
            print(f"frozen: {freeze(read_test_set(), given.out).name}, in {FROZEN}")
        elif given.table is not None:
            print(table(_rows(given.table), read_frozen()))
        elif given.out is None:
            parser.error("give OUT, the folder of the test set and the runs")
        else:
            base = TrainSettings() if given.study is None else read_study(given.study).training
            training = base.for_predictor(given.model or (base.model if given.study else FLOOR), given.seed)
            feedback = ConsoleFeedback(Console(stderr=True))
            engine = LocalEngine(given.jobs)
            frozen = read_frozen()
            study = "" if given.study is None else given.study.stem
            row = score(read_test_set(), frozen, training, given.out, engine, not given.no_live, feedback, study)
            print(table([row], frozen))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _rows(folder: Path) -> list[BenchmarkRow]:
    rows = [row for file in sorted(folder.glob("*.json")) if (row := read_json(BenchmarkRow, file)) is not None]
    if not rows:
        raise InputError(f"{folder}: holds no row; score a predictor, and put its row.json there")
    return rows


if __name__ == "__main__":
    sys.exit(main())
