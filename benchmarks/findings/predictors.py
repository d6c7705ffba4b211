"""The predictors side by side: early and late windows, sensed and true states, number of samples, another road.

A stage each, run in this order:

- windows: every predictor on windows that end 0-1.0 s and 1.0-2.2 s after onset, with paired differences; before the
  commit, by lead time; overtake against left lane change; whether the TV passes the UV; the unknown class, by score.
- window_ends: one run of ASI-BIP and of the trees with all windows ending at the same time, from 0.5 s before onset on.
- truth: ASI-BIP and the trees trained and tested on the true states of the TV instead of the sensed ones.
- other: both on all records of another dataset, beside their own test seeds.
- samples: both on early windows, trained on shares of the training seeds.
- longer: ASI-BIP trained three times as long, beside the trees.

OUT keeps the runs and their evaluations: the same command resumes where it stopped.

Run: python -m isac_cosim.benchmarks.findings.predictors DATASET OUT [--generate] [--other DATASET] [--seeds 3]
     [--also minirocket] [--jobs 2] [--stages windows,truth]
"""

from __future__ import annotations

import argparse
import importlib.resources
import json
import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from rich.console import Console

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.files import json_text, write_json
from isac_cosim.base.progress import ConsoleFeedback
from isac_cosim.base.versions import OF_RUNS, versions
from isac_cosim.base.workers.engine import Engine, LocalEngine
from isac_cosim.base.workers.kept_workers import kept_running
from isac_cosim.evaluation.on_windows.evaluation import evaluate_records
from isac_cosim.evaluation.on_windows.metrics import spread
from isac_cosim.evaluation.on_windows.passing import PullOuts
from isac_cosim.evaluation.on_windows.repeats import spreads
from isac_cosim.evaluation.on_windows.results import EvaluationResult, read_metrics
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings, WindowEndCurveSettings
from isac_cosim.evaluation.report.figures import draw_figures
from isac_cosim.evaluation.report.page import PAGE
from isac_cosim.evaluation.report.report import write_page
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.models import DEFAULT, FLOOR
from isac_cosim.models.data.windows import Records
from isac_cosim.models.networks.checkpoints import HISTORY_FILE
from isac_cosim.models.networks.fitting import CHECKPOINTS
from isac_cosim.models.predictors.registry import OWN, catalogue
from isac_cosim.models.runs.run import Run, load_run, read_card, write_card
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.training import train_records
from isac_cosim.studies.cell_tasks import made_of, run_tasks
from isac_cosim.studies.study import read_study

RESULT_FILE = "predictors.json"
ENDS = {"early": (0.0, 1.0), "late": (1.0, 2.2)}
"""Ranges of window ends after onset, s."""
PREDICTORS: tuple[str, ...] = (
    "asi-bip", "ensemble", "embedding-trees", "castformer", "inception-time", "trees", "aligned", "asi-bip-slow",
    "asi-bip-fast", "tv-alone", "uv-alone", "rule",
)  # fmt: skip
COMPARED: tuple[str, ...] = (DEFAULT, FLOOR)
NETWORK_OF = {"ensemble": DEFAULT, "embedding-trees": DEFAULT}
"""Predictors that train the very network of another one."""
SHARES = (0.125, 0.25, 0.5, 1.0)
FULL_STUDY = Path(str(importlib.resources.files("isac_cosim.studies") / "full.toml"))
TUNED = read_study(FULL_STUDY).training
"""How every predictor is trained, CaSTFormer with the same optimiser as the others; chosen on validation seeds."""
STAGES = ("windows", "window_ends", "truth", "other", "samples", "longer")
"""The parts of the bench, in the order in which they run."""
LONGER = 3
"""Factor of the epochs in the longer training of ASI-BIP."""


@dataclass(frozen=True)
class BenchTraining:
    """A training that a worker process runs.

    dataset: folder of its dataset. states: the column of the TV's states. run: folder of the predictor. network:
    folder of a training of the same network; if that has finished, its epochs are not repeated.
    """

    dataset: Path
    states: Literal["tv", "tv_truth"]
    training: TrainSettings
    run: Path
    network: Path | None = None

    def is_finished(self, digest: str) -> bool:
        """Return whether the folder holds this very training. digest: of the dataset."""
        card = read_card(self.run)
        return (
            card is not None
            and card.complete
            and (card.settings, card.dataset.get("digest")) == (self.training, digest)
        )

    def work(self) -> None:
        """Train, or go on from the last epoch."""
        dataset = Dataset.open(self.dataset)
        self.run.parent.mkdir(parents=True, exist_ok=True)
        if self.network is not None and read_card(self.run) is None:
            self._take_epochs(dataset, self.network)
        train_records(Records.of(dataset, self.states), made_of(dataset), self.run, self.training)

    def _take_epochs(self, dataset: Dataset, network: Path) -> None:
        """Begin this training with the last epoch of a finished one of the same network."""
        card = read_card(network)
        if card is None:
            return
        training = self.training.model_copy(update={"model": card.settings.model})
        if replace(self, training=training, run=network).is_finished(dataset.digest):
            shutil.copytree(network / CHECKPOINTS, self.run / CHECKPOINTS, dirs_exist_ok=True)
            shutil.copy2(network / HISTORY_FILE, self.run)
            write_card(self.run, card.model_copy(update={"complete": False, "settings": self.training}))


@dataclass(frozen=True)
class Bench:
    """A dataset, and the folder for the runs on it.

    states: the column of the TV's states. engine: runs the trainings.
    """

    dataset: Dataset
    out: Path
    seeds: range
    engine: Engine
    feedback: Feedback
    states: Literal["tv", "tv_truth"] = "tv"

    @cached_property
    def records(self) -> Records:
        """The records of the dataset."""
        return Records.of(self.dataset, self.states)

    def train(
        self, models: Iterable[str], name: str = "sensed", share: float = 1.0, times: int = 1
    ) -> dict[str, list[Run]]:
        """Return the runs of each predictor with each training seed; finished ones are not repeated.

        share: of the training seeds. times: factor of the epochs. The rule of the road is not random: it has one run.
        Raises RunError where a training fails.
        """
        split = TUNED.split.model_copy(update={"training_share": share})
        epochs, patience = times * TUNED.optimiser.epochs, times * TUNED.optimiser.patience
        optimiser = TUNED.optimiser.model_copy(update={"epochs": epochs, "patience": patience})
        tasks: dict[str, list[BenchTraining]] = {model: [] for model in models}
        for seed in self.seeds:
            for model in tasks:
                if seed == self.seeds[0] or model != "rule":
                    changes = {"split": split, "optimiser": optimiser, "model": model, "seed": seed}
                    folder = self.out / name / f"{model}-{share:g}-{seed}"
                    settings = TUNED.model_copy(update=changes)
                    base = NETWORK_OF.get(model)
                    network = None if base is None else self.out / name / f"{base}-{share:g}-{seed}"
                    tasks[model].append(BenchTraining(self.dataset.path, self.states, settings, folder, network))
        # By seed, so that an interrupted command leaves one run of every predictor before the second of any; those that
        # take another one's network come last.
        order = sorted(
            (task for repeats in tasks.values() for task in repeats),
            key=lambda task: (task.training.seed, task.network is not None),
        )
        missing = [task for task in order if not task.is_finished(self.dataset.digest)]
        title = f"{name}, share {share:g}"

        def failed(task: BenchTraining, reason: str) -> None:
            raise RunError(f"{task.run}: {reason}")

        run_tasks(missing, self.engine, self.feedback, title, "trainings", failed, TUNED.optimiser.threads)
        return {model: [load_run(task.run) for task in repeats] for model, repeats in tasks.items()}

    def evaluate(
        self, runs: Sequence[Run], name: str, ends: str, at_leads: bool = False, pull_outs: PullOuts | None = None
    ) -> EvaluationResult:
        """What metrics.json holds of those runs on the same windows, the first one's in full. ends: a key of ENDS.

        at_leads: whether windows at fixed times before the commit are measured, too, which do not depend on `ends`.
        pull_outs: of the dataset, to ask whether the TV passes the UV.
        """
        settings = EvaluateSettings(end_after_s=ENDS[ends])
        if not at_leads:
            settings = settings.model_copy(update={"leads_s": ()})
        return self._measured(runs, f"{name}/{ends}", settings, pull_outs)

    def scores(self, runs: Sequence[Run], ends: str) -> dict[str, Any]:
        """Return mean and spread over runs, each measured by itself, and how many windows they were measured on."""
        results = [self.evaluate([run], f"evaluated/{run.path.name}", ends) for run in runs]
        return {"windows": results[0].n, **spreads(results).model_dump(mode="json")}

    def window_end_curves(self, runs: Sequence[Run], name: str) -> list[dict[str, Any]]:
        """`by_window_end` of each run, drawn in OUT/name/window_end.png."""
        measured = self._measured(
            runs, name, EvaluateSettings(ends_per_record=1, window_end_curve=WindowEndCurveSettings())
        )
        return [result.model_dump(mode="json", include={"name", "by_window_end"}) for result in measured.runs]

    def _measured(
        self, runs: Sequence[Run], name: str, settings: EvaluateSettings, pull_outs: PullOuts | None = None
    ) -> EvaluationResult:
        """Return what a folder holds of these runs, evaluated now unless an earlier command finished it."""
        folder = self.out / name
        before = read_metrics(folder) if (folder / PAGE).is_file() else None
        windows = {"window_end_curve": None} | runs[0].card.settings.windows.model_dump()
        asked = (windows | settings.model_dump(exclude_none=True), [run.card for run in runs], self.dataset.digest)
        if before is not None and before.made_by.versions == versions(OF_RUNS):
            made_by = before.made_by
            if (before.windows.model_dump(), made_by.runs, made_by.dataset.digest) == asked:
                return before
        (folder / PAGE).unlink(missing_ok=True)
        origin = made_of(self.dataset)
        evaluation = evaluate_records(runs[0], self.records, origin, folder, settings, runs[1:], pull_outs)
        draw_figures(evaluation, folder)
        write_page(evaluation.result, folder)  # last: it marks a finished evaluation
        return evaluation.result


def run(
    dataset: Dataset,
    out: Path,
    seeds: int = 3,
    other: Dataset | None = None,
    also: Sequence[str] = (),
    stages: Sequence[str] | None = None,
    engine: Engine | None = None,
    feedback: Feedback = SILENT,
) -> dict[str, Any]:
    """Return what predictors.json holds: a key for each stage, but `early` and `late` for the windows.

    seeds: number of training seeds. also: predictors besides PREDICTORS. stages: those to run now, by default all; of
    the others, the file keeps what it has. engine: runs the trainings, by default in one worker process.
    Raises InputError where the file is of other settings or another dataset, or the stage `other` is asked for without
    one, RunError where a training fails.
    """
    if other is None and "other" in (stages or ()):
        raise InputError("the stage other measures another dataset; name it with --other")
    identity = {
        "training": TUNED.model_dump(mode="json"),
        "training_seeds": seeds,
        "longer_times_epochs": LONGER,
        "dataset": dataset.digest,
        "scenario_seeds": len(dataset.frame(["scenario", "seed"]).drop_duplicates()),
        "versions": versions(OF_RUNS),
    }
    file = out / RESULT_FILE
    result: dict[str, Any] = json.loads(file.read_text()) if file.is_file() else dict(identity)
    if {key: result.get(key) for key in identity} != identity:
        raise InputError(f"{file}: was made with other settings, versions or another dataset; choose a new folder")
    with kept_running(engine or LocalEngine(1)) as kept:
        bench = Bench(dataset, out, range(seeds), kept, feedback)
        parts: dict[str, Callable[[], dict[str, Any]]] = {
            "windows": lambda: _windows(bench, also),
            "window_ends": lambda: _window_ends(bench),
            "truth": lambda: _truth(bench),
            "other": lambda: {} if other is None else _other(bench, other),
            "samples": lambda: _samples(bench),
            "longer": lambda: _longer(bench),
        }
        for stage in STAGES if stages is None else stages:
            result |= parts[stage]()
            out.mkdir(parents=True, exist_ok=True)
            write_json(file, result)
    return result


def _windows(bench: Bench, also: Sequence[str]) -> dict[str, Any]:
    """Return the scores of every predictor on early and on late windows."""
    runs = [run for repeats in bench.train((*PREDICTORS, *also)).values() for run in repeats]
    pull_outs = PullOuts.of(bench.dataset)
    return {ends: _predictors(bench.evaluate(runs, "evaluated/all", ends, ends == "early", pull_outs)) for ends in ENDS}


def _window_ends(bench: Bench) -> dict[str, Any]:
    """Return the window-end curve of one run of the default predictor, and of the floor."""
    runs = [repeats[0] for repeats in bench.train((DEFAULT, FLOOR)).values()]
    return {"by_window_end": bench.window_end_curves(runs, "evaluated/window_ends")}


def _truth(bench: Bench) -> dict[str, Any]:
    """Return the scores of predictors trained on sensed and on true states."""
    truth = replace(bench, out=bench.out / "true", states="tv_truth")
    runs = {"sensed": bench.train(COMPARED), "true": truth.train(COMPARED)}
    return {"truth": _beside({"sensed": bench, "true": truth}, runs)}


def _other(bench: Bench, dataset: Dataset) -> dict[str, Any]:
    """Return the scores on the dataset's own road and on that of another dataset."""
    other = replace(bench, dataset=dataset, out=bench.out / "other")
    runs = bench.train(COMPARED)
    rows = _beside({"own": bench, "other": other}, {"own": runs, "other": runs})
    return {"other": rows, "other_dataset": dataset.digest}


def _samples(bench: Bench) -> dict[str, Any]:
    """Return the scores on early windows by the number of training samples."""
    rows = []
    for share in SHARES:
        for model, repeats in bench.train(COMPARED, share=share).items():
            taught = spread([sum(run.card.counts.values()) for run in repeats]).mean
            rows.append({"model": model, "share": share, "samples": taught, **bench.scores(repeats, "early")})
    return {"samples": rows}


def _longer(bench: Bench) -> dict[str, Any]:
    """Return the scores of the default predictor trained longer, beside the floor."""
    runs = [*bench.train((DEFAULT,), "longer", times=LONGER)[DEFAULT], *bench.train((FLOOR,))[FLOOR]]
    return {"longer": {ends: _predictors(bench.evaluate(runs, "evaluated/longer", ends)) for ends in ENDS}}


def _beside(benches: dict[str, Bench], runs: dict[str, dict[str, list[Run]]]) -> list[dict[str, Any]]:
    """Return the scores of each predictor on the test windows of some benches, by the benches' names."""
    return [
        {"model": model, "ends": ends, "on": name, **bench.scores(runs[name][model], ends)}
        for model in COMPARED
        for ends in ENDS
        for name, bench in benches.items()
    ]


def _predictors(measured: EvaluationResult) -> dict[str, Any]:
    """Scores over training seeds with differences to the first predictor; each run's before the commit, and unknown.

    Also `passing`, whether the TV passes the UV, where that was asked. With one training seed, `predictors` is empty.
    """
    keys = {
        "name", "model", "before_commit", "five_classes",
        "n_unknown", "unknown_score", "auroc_unknown", "unknown_scores",
    }  # fmt: skip
    return {
        "predictors": measured.model_dump(mode="json").get("over_training_seeds", []),
        "runs": [result.model_dump(mode="json", include=keys) for result in measured.runs],
        **({} if measured.passing is None else measured.model_dump(mode="json", include={"passing"})),
    }


def main() -> None:
    """Read the arguments, train, evaluate, and print what predictors.json holds."""
    parser = argparse.ArgumentParser(
        description=__doc__, epilog=f"predictors:\n{catalogue()}", formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--generate", action="store_true", help="first make DATASET, as studies/full.toml describes it")
    parser.add_argument("--other", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--also", action="append", default=[], choices=[name for name in OWN if name not in PREDICTORS])
    parser.add_argument("--jobs", type=int, default=1, help="number of worker processes")
    parser.add_argument("--stages", type=lambda text: text.split(","), help=f"some of {','.join(STAGES)}")
    arguments = parser.parse_args()
    unknown = [stage for stage in arguments.stages or () if stage not in STAGES]
    if unknown:
        parser.error(f"no such stage: {', '.join(unknown)}; choose from {', '.join(STAGES)}")
    engine, feedback = LocalEngine(arguments.jobs), ConsoleFeedback(Console(stderr=True))
    if arguments.generate:
        generate(read_study(FULL_STUDY).dataset, arguments.dataset, engine, feedback)
    result = run(
        Dataset.open(arguments.dataset),
        arguments.out,
        arguments.seeds,
        None if arguments.other is None else Dataset.open(arguments.other),
        arguments.also,
        arguments.stages,
        engine,
        feedback,
    )
    print(json_text(result, 1))


if __name__ == "__main__":
    main()
