"""The predictors side by side: early and late windows, sensed and true, by number of samples, on another road.

- windows: every predictor on windows that end 0-1.0 s and 1.0-2.2 s after onset, with paired differences; overtake
  against left lane change; the unknown, by score.
- window ends: one run of every predictor with all windows ending at the same time, from 0.5 s before onset on.
- truth: ASI-BIP and the trees trained and tested on the true states of the TV in place of the sensed ones.
- samples: both on early windows, trained on shares of the training seeds.
- longer: ASI-BIP trained three times as long, beside the trees.
- other: both on all records of another dataset, next to their own test.

OUT keeps the runs: the same command goes on where it was stopped.

Run: python -m benchmarks.predictors DATASET OUT [--other DATASET] [--seeds 3] [--also minirocket]
"""

from __future__ import annotations

import argparse
import importlib.resources
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

from rich.console import Console
from rich.progress import track

from isacsim.files import write_json
from labeling.dataset.dataset import Dataset
from models.data.windows import Records
from models.evaluation.evaluation import evaluate_records
from models.evaluation.metrics import spread
from models.evaluation.repeats import summary
from models.evaluation.results import EvaluationResult
from models.evaluation.settings import EvaluateSettings, WindowEndCurveSettings
from models.report.evaluation_figures import draw_figures
from models.run import Model, Run
from models.studies.study import read_study
from models.training.training import train_records

ENDS = {"early": (0.0, 1.0), "late": (1.0, 2.2)}
"""Ranges of window ends after onset, s."""
PREDICTORS: tuple[Model, ...] = (
    "asi-bip", "ensemble", "castformer", "trees", "aligned", "tv-alone", "uv-alone", "rule",
)  # fmt: skip
COMPARED: tuple[Model, ...] = ("asi-bip", "trees")
SHARES = (0.125, 0.25, 0.5, 1.0)
TUNED = read_study(Path(str(importlib.resources.files("studies") / "full.toml"))).training
"""How every predictor is trained; chosen on validation seeds."""
LONGER = 3
"""Times the epochs, where ASI-BIP is trained longer."""


@dataclass(frozen=True)
class Bench:
    """A dataset's records, and the folder that the runs on them are kept in."""

    dataset: Dataset
    records: Records
    out: Path
    seeds: range
    console: Console
    alone: dict[tuple[str, str], EvaluationResult] = field(default_factory=dict)
    """Metrics of runs that were measured by themselves, by name and key of ENDS."""

    @property
    def made_of(self) -> dict[str, Any]:
        """What the runs' cards say of the dataset."""
        return {"digest": self.dataset.digest, "study": self.dataset.meta.study}

    def train(
        self, models: Iterable[Model], name: str = "sensed", share: float = 1.0, times: int = 1
    ) -> dict[Model, list[Run]]:
        """Runs of each predictor with each training seed; those that stand are taken as they are.

        share: of the training seeds. times: as many epochs. The rule of the road draws nothing: it has one run.
        """
        runs: dict[Model, list[Run]] = {model: [] for model in models}
        jobs = [(seed, model) for seed in self.seeds for model in runs if seed == self.seeds[0] or model != "rule"]
        split = TUNED.split.model_copy(update={"training_share": share})
        epochs, patience = (times * each for each in (TUNED.optimiser.epochs, TUNED.optimiser.patience))
        optimiser = TUNED.optimiser.model_copy(update={"epochs": epochs, "patience": patience})
        for seed, model in track(jobs, f"{name}, share {share:g}", console=self.console):
            own = {"split": split, "optimiser": optimiser, "model": model, "seed": seed}
            settings = TUNED.model_copy(update=own)
            folder = self.out / name / f"{model}-{share:g}-{seed}"
            runs[model].append(train_records(self.records, self.made_of, folder, settings))
        return runs

    def evaluate(self, runs: Sequence[Run], name: str, ends: str) -> EvaluationResult:
        """What metrics.json holds of those runs on the same windows, the first one's in full. ends: a key of ENDS."""
        return self._measured(runs, f"{name}/{ends}", EvaluateSettings(end_after_s=ENDS[ends]))

    def scores(self, runs: Sequence[Run], ends: str) -> dict[str, Any]:
        """Mean and spread over runs, each measured by itself, and the windows that they were measured on."""
        for one in runs:
            if (one.path.name, ends) not in self.alone:
                self.alone[one.path.name, ends] = self.evaluate([one], f"evaluated/{one.path.name}", ends)
        found = [self.alone[one.path.name, ends] for one in runs]
        return {"windows": found[0].n, **summary(found).model_dump(mode="json")}

    def window_end_curves(self, runs: Sequence[Run], name: str) -> list[dict[str, Any]]:
        """`by_window_end` of each run, drawn in OUT/name/window_end.png."""
        measured = self._measured(
            runs, name, EvaluateSettings(ends_per_record=1, window_end_curve=WindowEndCurveSettings())
        )
        return [each.model_dump(mode="json", include={"name", "by_window_end"}) for each in measured.runs]

    def _measured(self, runs: Sequence[Run], name: str, settings: EvaluateSettings) -> EvaluationResult:
        evaluation = evaluate_records(runs[0], self.records, self.made_of, self.out / name, settings, runs[1:])
        draw_figures(evaluation, self.out / name)
        return evaluation.result


def run(
    dataset: Dataset,
    out: Path,
    seeds: int = 3,
    other: Dataset | None = None,
    console: Console | None = None,
    also: Sequence[Model] = (),
) -> dict[str, Any]:
    """Measure `truth`, `other`, `samples`, `longer`, `early`, `late`, `by_window_end`, kept in OUT/predictors.json."""
    console = console or Console(stderr=True)
    bench = Bench(dataset, Records.of(dataset), out, range(seeds), console)
    truth = Bench(dataset, Records.of(dataset, "tv_truth"), out / "true", range(seeds), console)
    found: dict[str, Any] = {
        "training": TUNED.model_dump(mode="json"),
        "longer_times_epochs": LONGER,
        "dataset": dataset.digest,
        "scenario_seeds": len(set(bench.records.groups)),
    }

    def keep(**parts: Any) -> None:
        found.update(parts)
        out.mkdir(parents=True, exist_ok=True)
        write_json(out / "predictors.json", found)

    main = bench.train(COMPARED)
    keep(truth=_beside(bench, truth, main, truth.train(COMPARED)))
    if other is not None:
        elsewhere = Bench(other, Records.of(other), out / "other", range(seeds), console)
        keep(other=_beside(bench, elsewhere, main, main))
    samples = []
    for share in SHARES:
        runs = bench.train(COMPARED, "sensed", share)
        for model, each in runs.items():
            taught = spread([sum(one.card.counts.values()) for one in each]).mean
            samples.append({"model": model, "share": share, "samples": taught, **bench.scores(each, "early")})
    keep(samples=samples)
    longer = [*bench.train(("asi-bip",), "longer", times=LONGER)["asi-bip"], *main["trees"]]
    keep(longer={ends: _predictors(bench.evaluate(longer, "evaluated/longer", ends)) for ends in ENDS})
    trained = bench.train((*PREDICTORS, *also))
    everyone = [one for each in trained.values() for one in each]
    for ends in ENDS:
        keep(**{ends: _predictors(bench.evaluate(everyone, "evaluated/all", ends))})
    keep(by_window_end=bench.window_end_curves([each[0] for each in trained.values()], "evaluated/window_ends"))
    return found


def _beside(
    own: Bench, other: Bench, own_runs: dict[Model, list[Run]], other_runs: dict[Model, list[Run]]
) -> list[dict[str, Any]]:
    """Scores of each predictor on both benches' test windows."""
    rows = []
    for model in own_runs:
        for ends in ENDS:
            for bench, runs in ((own, own_runs[model]), (other, other_runs[model])):
                rows.append({"model": model, "ends": ends, "on": bench.out.name, **bench.scores(runs, ends)})
    return rows


def _predictors(measured: EvaluationResult) -> dict[str, Any]:
    """Scores over training seeds, each predictor's difference to the first, and every run's scores of the unknown."""
    keys = {"name", "n_unknown", "unknown_score", "auroc_unknown", "unknown_scores"}
    return {
        "predictors": measured.model_dump(mode="json")["over_training_seeds"],
        "unknown": [each.model_dump(mode="json", include=keys) for each in measured.runs],
    }


def main() -> None:
    """Read the arguments, train, evaluate, and print what predictors.json holds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--other", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--also", action="append", default=[], choices=set(get_args(Model)) - set(PREDICTORS))
    given = parser.parse_args()
    other = None if given.other is None else Dataset.open(given.other)
    print(json.dumps(run(Dataset.open(given.dataset), given.out, given.seeds, other, also=given.also), indent=1))


if __name__ == "__main__":
    main()
