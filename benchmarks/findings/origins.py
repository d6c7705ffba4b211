"""How well a predictor of natural maneuvers knows the others, and the reverse.

A predictor is trained on natural maneuvers, on all others (reactions and commands), or on as many of both, and measured
on natural and on other maneuvers of scenario seeds that it was not trained on. Each seed is a test seed once. Only
intentions that SUMO's drivers act on by themselves often enough take part; every training has as many records of each.

Run: python -m isac_cosim.benchmarks.findings.origins DATASET OUT [--model trees] [--folds N] [--epochs N]
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from isac_cosim.base.arrays import BoolArray, IntArray
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.files import write_json
from isac_cosim.base.progress import ConsoleFeedback
from isac_cosim.base.seeding import stream
from isac_cosim.base.settings import checked
from isac_cosim.base.versions import OF_RUNS, versions
from isac_cosim.evaluation.on_windows import metrics
from isac_cosim.evaluation.on_windows.predictions import Predictions, predict
from isac_cosim.evaluation.on_windows.score_results import ClassifiedWindows
from isac_cosim.evaluation.report.parts import markdown
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.models import FLOOR
from isac_cosim.models.data.windows import Records, draw_ends
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.training import train_records

NATURAL, OTHER, BOTH = "natural", "other", "both"
LEAST = 30
"""Records of an intention of each origin without which it does not take part."""
VALIDATION_SHARE = 0.15
ENDS_PER_RECORD = 4


def run(
    records: Records, made_of: dict[str, Any], out: Path, settings: TrainSettings, folds: int, feedback: Feedback
) -> dict[str, Any]:
    """Return the scores before the commit, by the origin trained on and the origin measured.

    Raises ValueError if fewer than two intentions have enough records of each origin.
    """
    natural = (records.table["origin"] == NATURAL).to_numpy()
    intentions = [
        intention
        for intention in KNOWN
        if min((natural & (records.label == intention)).sum(), (~natural & (records.label == intention)).sum()) >= LEAST
    ]
    if len(intentions) < 2:
        raise ValueError(f"fewer than two intentions have {LEAST} records of each origin")
    asked = np.isin(records.label, intentions)
    groups = np.unique(records.groups[asked].astype(str))
    fold_of = dict(zip(stream("origins", "folds").permutation(groups), np.arange(len(groups)) % folds, strict=True))
    fold = np.array([fold_of.get(str(group), -1) for group in records.groups])
    answers: dict[str, list[Predictions]] = {}
    for number in range(folds):
        test = records.take(asked & (fold == number))
        ends = draw_ends(test, settings.windows, "origins", number, per_record=ENDS_PER_RECORD)
        for origin, chosen in training_rows(records, natural, asked & (fold != number), intentions, number).items():
            training = records.take(chosen)
            trained = train_records(
                training, made_of, out / f"{origin}-{number}", settings, feedback, sides_of(training, number)
            )
            predictions = predict(trained, test, ends)
            answers.setdefault(origin, []).append(predictions)
    scores = {
        origin: {measured: score(parts, measured) for measured in (NATURAL, OTHER)} for origin, parts in answers.items()
    }
    return {
        "model": settings.model,
        "intentions": [intention.text for intention in intentions],
        "folds": folds,
        "trained_on": {
            origin: {measured: scores_of.model_dump() for measured, scores_of in row.items()}
            for origin, row in scores.items()
        },
        "dataset": made_of["digest"],
        "settings": settings.model_dump(mode="json"),
        "versions": versions(OF_RUNS),
    }


def training_rows(
    records: Records, natural: BoolArray, offered: BoolArray, intentions: Sequence[Intention], fold: int
) -> Mapping[str, IntArray]:
    """Return the records to train on by origin: as many of each intention for every origin, half of each in `both`."""
    rows: dict[str, list[IntArray]] = {NATURAL: [], OTHER: [], BOTH: []}
    for intention in intentions:
        pools = [np.flatnonzero(offered & (records.label == intention) & side) for side in (natural, ~natural)]
        number = min(map(len, pools))
        own, others = (
            stream("origins", "rows", fold, int(intention), side).permutation(pool)[:number]
            for side, pool in zip((NATURAL, OTHER), pools, strict=True)
        )
        rows[NATURAL].append(own)
        rows[OTHER].append(others)
        rows[BOTH] += [own[: number // 2], others[: number - number // 2]]
    return {origin: np.sort(np.concatenate(parts)) for origin, parts in rows.items()}


def sides_of(training: Records, fold: int) -> dict[str, list[str]]:
    """Return the scenario seeds of a training, some of them for validation."""
    groups = stream("origins", "validation", fold).permutation(np.unique(training.groups.astype(str))).tolist()
    n_validation = max(1, round(VALIDATION_SHARE * len(groups)))
    return {"train": sorted(groups[n_validation:]), "validation": sorted(groups[:n_validation]), "test": []}


def score(parts: list[Predictions], measured: str) -> ClassifiedWindows:
    """Return the scores of all folds together, on the windows before the commit of one origin."""
    rows = [part.before_commit & ((part.origin == NATURAL) == (measured == NATURAL)) for part in parts]
    label, predicted, group = (
        np.concatenate([getattr(part, name)[row] for part, row in zip(parts, rows, strict=True)])
        for name in ("label", "predicted", "group")
    )
    return metrics.classified(label, predicted, group, tuple(intention.text for intention in KNOWN))


def table(result: dict[str, Any]) -> str:
    """Return macro-F1 before the commit, with its interval, as a table in Markdown."""
    rows = [[origin, *(_cell(row[name]) for name in (NATURAL, OTHER))] for origin, row in result["trained_on"].items()]
    return markdown(["trained on", "measured on natural ones", "measured on the others"], rows)


def _cell(scores: dict[str, Any]) -> str:
    """Return a macro-F1 with its interval and number of windows; a single seed has no interval."""
    low, middle, high = (scores[name] for name in ("macro_f1_low", "macro_f1", "macro_f1_high"))
    if middle is None:
        return f"-, n = {scores['n']}"
    between = "" if low is None or high is None else f" ({low:.3f} to {high:.3f})"
    return f"{middle:.3f}{between}, n = {scores['n']}"


def main() -> None:
    """Read the arguments, train and measure, write `origins.json`, and print the table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--model", default=FLOOR)
    parser.add_argument("--folds", type=int, default=5)
    parser.add_argument("--epochs", type=int)
    arguments = parser.parse_args()
    optimiser = {} if arguments.epochs is None else {"epochs": arguments.epochs}
    settings = checked(TrainSettings, {"model": arguments.model, "optimiser": optimiser}, "arguments")
    opened = Dataset.open(arguments.dataset)
    made_of = {"digest": opened.digest, "study": opened.meta.study}
    feedback = ConsoleFeedback(Console(stderr=True))
    result = run(Records.of(opened), made_of, arguments.out, settings, arguments.folds, feedback)
    write_json(arguments.out / "origins.json", result)
    print(table(result))


if __name__ == "__main__":
    main()
