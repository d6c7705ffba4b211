"""The predictors side by side: early and late windows, sensed and true states, number of samples, another road.

- windows: every predictor on windows that end 0-1.0 s and 1.0-2.2 s after onset, with paired differences; overtake
  against left lane change; the unknown class, by score.
- window ends: one run of every predictor with all windows ending at the same time, from 0.5 s before onset on.
- truth: ASI-BIP and the trees trained and tested on the true states of the TV instead of the sensed ones.
- samples: both on early windows, trained on shares of the training seeds.
- longer: ASI-BIP trained three times as long, beside the trees.
- other: both on all records of another dataset, beside their own test seeds.

OUT keeps the runs: the same command resumes where it stopped.

Run: python -m benchmarks.predictors DATASET OUT [--other DATASET] [--seeds 3] [--also minirocket]
"""

from __future__ import annotations

import argparse
import importlib.resources
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track

from isacsim.files import write_json
from labeling.dataset.dataset import Dataset
from models.data.windows import Records
from models.evaluation.evaluation import evaluate_records
from models.evaluation.metrics import spread
from models.evaluation.pull_outs import PullOuts
from models.evaluation.repeats import summary
from models.evaluation.results import EvaluationResult
from models.evaluation.settings import EvaluateSettings, WindowEndCurveSettings
from models.predictors.registry import OWN, catalogue
from models.report.evaluation_figures import draw_figures
from models.roles import DEFAULT, FLOOR
from models.run import Run
from models.studies.study import read_study
from models.training.training import train_records

ENDS = {"early": (0.0, 1.0), "late": (1.0, 2.2)}
"""Ranges of window ends after onset, s."""
PREDICTORS: tuple[str, ...] = (
    "asi-bip", "ensemble", "embedding-trees", "castformer", "inception-time", "trees", "aligned", "tv-alone",
    "uv-alone", "rule",
)  # fmt: skip
COMPARED: tuple[str, ...] = (DEFAULT, FLOOR)
SHARES = (0.125, 0.25, 0.5, 1.0)
TUNED = read_study(Path(str(importlib.resources.files("studies") / "full.toml"))).training
"""How every predictor is trained, CaSTFormer with the same optimiser as the others; chosen on validation seeds."""
LONGER = 3
"""Factor of the epochs in the longer training of ASI-BIP."""


@dataclass(frozen=True)
class Bench:
    """A dataset's records, and the folder for the runs on them."""

    dataset: Dataset
    records: Records
    out: Path
    seeds: range
    console: Console
    alone: dict[tuple[str, str], EvaluationResult] = field(default_factory=dict)
    """Metrics of runs that were measured by themselves, by name and key of ENDS."""

    @property
    def made_of(self) -> dict[str, Any]:
        """What the cards of the runs say of the dataset."""
        return {"digest": self.dataset.digest, "study": self.dataset.meta.study}

    def train(
        self, models: Iterable[str], name: str = "sensed", share: float = 1.0, times: int = 1
    ) -> dict[str, list[Run]]:
        """Return the runs of each predictor with each training seed; finished ones are not repeated.

        share: of the training seeds. times: factor of the epochs. The rule of the road is not random: it has one run.
        """
        runs: dict[str, list[Run]] = {model: [] for model in models}
        jobs = [(seed, model) for seed in self.seeds for model in runs if seed == self.seeds[0] or model != "rule"]
        split = TUNED.split.model_copy(update={"training_share": share})
        epochs, patience = times * TUNED.optimiser.epochs, times * TUNED.optimiser.patience
        optimiser = TUNED.optimiser.model_copy(update={"epochs": epochs, "patience": patience})
        for seed, model in track(jobs, f"{name}, share {share:g}", console=self.console):
            changes = {"split": split, "optimiser": optimiser, "model": model, "seed": seed}
            settings = TUNED.model_copy(update=changes)
            folder = self.out / name / f"{model}-{share:g}-{seed}"
            runs[model].append(train_records(self.records, self.made_of, folder, settings))
        return runs

    def evaluate(
        self, runs: Sequence[Run], name: str, ends: str, pull_outs: PullOuts | None = None
    ) -> EvaluationResult:
        """What metrics.json holds of those runs on the same windows, the first one's in full. ends: a key of ENDS.

        pull_outs: of the dataset, to ask whether the TV passes the UV.
        """
        return self._measured(runs, f"{name}/{ends}", EvaluateSettings(end_after_s=ENDS[ends]), pull_outs)

    def scores(self, runs: Sequence[Run], ends: str) -> dict[str, Any]:
        """Return mean and spread over runs, each measured by itself, and how many windows they were measured on."""
        for run in runs:
            if (run.path.name, ends) not in self.alone:
                self.alone[run.path.name, ends] = self.evaluate([run], f"evaluated/{run.path.name}", ends)
        results = [self.alone[run.path.name, ends] for run in runs]
        return {"windows": results[0].n, **summary(results).model_dump(mode="json")}

    def window_end_curves(self, runs: Sequence[Run], name: str) -> list[dict[str, Any]]:
        """`by_window_end` of each run, drawn in OUT/name/window_end.png."""
        measured = self._measured(
            runs, name, EvaluateSettings(ends_per_record=1, window_end_curve=WindowEndCurveSettings())
        )
        return [result.model_dump(mode="json", include={"name", "by_window_end"}) for result in measured.runs]

    def _measured(
        self, runs: Sequence[Run], name: str, settings: EvaluateSettings, pull_outs: PullOuts | None = None
    ) -> EvaluationResult:
        evaluation = evaluate_records(
            runs[0], self.records, self.made_of, self.out / name, settings, runs[1:], pull_outs
        )
        draw_figures(evaluation, self.out / name)
        return evaluation.result


def run(
    dataset: Dataset,
    out: Path,
    seeds: int = 3,
    other: Dataset | None = None,
    console: Console | None = None,
    also: Sequence[str] = (),
) -> dict[str, Any]:
    """Return `truth`, `other`, `samples`, `longer`, `early`, `late` and `by_window_end`, also in predictors.json."""
    console = console or Console(stderr=True)
    bench = Bench(dataset, Records.of(dataset), out, range(seeds), console)
    truth = Bench(dataset, Records.of(dataset, "tv_truth"), out / "true", range(seeds), console)
    result: dict[str, Any] = {
        "training": TUNED.model_dump(mode="json"),
        "longer_times_epochs": LONGER,
        "dataset": dataset.digest,
        "scenario_seeds": len(set(bench.records.groups)),
    }

    def keep(**parts: Any) -> None:
        result.update(parts)
        out.mkdir(parents=True, exist_ok=True)
        write_json(out / "predictors.json", result)

    main = bench.train(COMPARED)
    keep(truth=_beside(bench, truth, main, truth.train(COMPARED)))
    if other is not None:
        elsewhere = Bench(other, Records.of(other), out / "other", range(seeds), console)
        keep(other=_beside(bench, elsewhere, main, main))
    samples = []
    for share in SHARES:
        runs = bench.train(COMPARED, "sensed", share)
        for model, repeats in runs.items():
            taught = spread([sum(run.card.counts.values()) for run in repeats]).mean
            samples.append({"model": model, "share": share, "samples": taught, **bench.scores(repeats, "early")})
    keep(samples=samples)
    longer = [*bench.train((DEFAULT,), "longer", times=LONGER)[DEFAULT], *main[FLOOR]]
    keep(longer={ends: _predictors(bench.evaluate(longer, "evaluated/longer", ends)) for ends in ENDS})
    trained = bench.train((*PREDICTORS, *also))
    everything = [run for repeats in trained.values() for run in repeats]
    pull_outs = PullOuts.of(dataset)
    for ends in ENDS:
        keep(**{ends: _predictors(bench.evaluate(everything, "evaluated/all", ends, pull_outs))})
    keep(by_window_end=bench.window_end_curves([repeats[0] for repeats in trained.values()], "evaluated/window_ends"))
    return result


def _beside(
    first: Bench, second: Bench, first_runs: dict[str, list[Run]], second_runs: dict[str, list[Run]]
) -> list[dict[str, Any]]:
    """Return the scores of each predictor on the test windows of both benches."""
    rows = []
    for model in first_runs:
        for ends in ENDS:
            for bench, runs in ((first, first_runs[model]), (second, second_runs[model])):
                rows.append({"model": model, "ends": ends, "on": bench.out.name, **bench.scores(runs, ends)})
    return rows


def _predictors(measured: EvaluationResult) -> dict[str, Any]:
    """Scores over training seeds with differences to the first predictor; each run's before the commit, and unknown.

    Also `passing`, whether the TV passes the UV, where that was asked.
    """
    keys = {"name", "n_unknown", "unknown_score", "auroc_unknown", "unknown_scores"}
    return {
        "predictors": measured.model_dump(mode="json")["over_training_seeds"],
        "before_commit": [
            result.model_dump(mode="json", include={"name", "before_commit"}) for result in measured.runs
        ],
        "unknown": [result.model_dump(mode="json", include=keys) for result in measured.runs],
        **({} if measured.passing is None else measured.model_dump(mode="json", include={"passing"})),
    }


def main() -> None:
    """Read the arguments, train, evaluate, and print what predictors.json holds."""
    parser = argparse.ArgumentParser(
        description=__doc__, epilog=f"predictors:\n{catalogue()}", formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--other", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--also", action="append", default=[], choices=[name for name in OWN if name not in PREDICTORS])
    arguments = parser.parse_args()
    other = None if arguments.other is None else Dataset.open(arguments.other)
    result = run(Dataset.open(arguments.dataset), arguments.out, arguments.seeds, other, also=arguments.also)
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
