"""What a predictor loses where the network senses all vehicles at once, split into its causes.

The same records are known in eight ways: by the truth, sensed alone (`single`), as points and as bodies, each with
true association and with the network's own tracks, and as bodies' tracks with fewer instants a second. Records that
one of these lost are left out of all. With each, two predictors are trained and tested in folds over the scenario
seeds, and answer at fixed window ends. Accuracy is given by window end and by origin, with 95 % jackknife intervals
over the seeds, and paired differences to the truth.

Each way and seed is a stage of minutes, which is kept in FOLDER; so are the answers, as counts, in FOLDER/split.json.
The same command goes on where it was interrupted.

Run: python -m isac_cosim.benchmarks.findings.sensing.loss_split FOLDER [FIRST:LAST] [SECONDS] [WAY ...] [--jobs N]

With some of the ways (the scene's: `points, truth` and so on), only those are sensed and compared. `WAY: PART` is the
truth with a part of the state (position, velocity, acceleration) as that way knows it: which part costs.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from rich.console import Console

from isac_cosim.base.arrays import BoolArray
from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.files import write_json
from isac_cosim.base.parsing import number_range
from isac_cosim.base.progress import ConsoleFeedback
from isac_cosim.base.settings import checked
from isac_cosim.base.versions import OF_RUNS, versions
from isac_cosim.base.workers.attempts import Outcome
from isac_cosim.base.workers.engine import Engine, InlineEngine, LocalEngine
from isac_cosim.base.workers.missing import Tally, run_missing
from isac_cosim.benchmarks.findings.sensing.scene_scores import ROAD
from isac_cosim.evaluation.on_windows.predictions import predict
from isac_cosim.evaluation.statistics import jackknife_half_width
from isac_cosim.isacsim.scene.episode import detections_kept
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.resense import ResenseSettings, resense
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.models.data.windows import Ends, Records, WindowSettings, end_bounds
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.training import train_records
from isac_cosim.studies.cell_tasks import run_tasks

LINK = {"channel": {"kind": "link"}}
STUDY: Mapping[str, Any] = {
    "scenarios": (ROAD,),
    "sensing": LINK,
    # Windows of 2.2 s that end a second before onset fit in.
    "record": {"duration_s": 5.8, "before_onset_s": 3.4},
    "selection": {"per_class": 12, "following": 0},
}
SCENES: Mapping[str, Mapping[str, str]] = {
    f"{bodies}, {association}": {"bodies": bodies, "association": association}
    for bodies in ("points", "bodies")
    for association in ("truth", "tracks")
} | {f"bodies, {hz} Hz": {"bodies": "bodies", "fixes_hz": hz} for hz in ("12.5", "5")}
TRUTH, SINGLE = "truth", "single"
PARTS = {"position": [0, 1], "velocity": [2, 3], "acceleration": [4, 5]}
"""Components of the state."""
TRAINING: Mapping[str, Mapping[str, Any]] = {"trees": {}, "rule": {"rule": {"fit": True}}}
"""The predictors, and their own settings. The rule of the road learns no more than the scale of its thresholds."""
TITLES = {"trees": "Boosted trees", "rule": "Rule of the road"}
END_AFTER_S = (-1.0, 2.2)
"""Window ends that are trained on, s after onset."""
ENDS: Mapping[str, Sequence[float]] = {
    "second before onset": (-1.0, -0.75, -0.5, -0.25),
    "0 to 0.5 s": (0.0, 0.25),
    "0.5 to 2.2 s": (0.5, 1.0, 1.5, 2.0),
}
"""Window ends that are tested, s after onset."""
FOLDS = 4
COUNTED = ["seed", "end_s", "origin"]

Counts = list[list[Any]]
"""Rows of seed, window end (s), origin, number of windows, and how many of them were answered rightly."""


@dataclass(frozen=True)
class SensedSeed:
    """A seed, whose records are sensed in every way. study: a dataset's, but for its seeds. scenes: by way."""

    folder: Path
    seed: int
    study: Mapping[str, Any]
    scenes: Mapping[str, Mapping[str, Any]]

    def sense(self) -> dict[str, Dataset]:
        """Return the dataset of each way, made now unless an earlier command made it."""
        engine = InlineEngine()
        study = checked(DatasetStudy, {**self.study, "seeds": {"first": self.seed, "last": self.seed}}, "loss_split")
        alone = generate(study, self.folder / SINGLE / str(self.seed), engine)
        result = {SINGLE: alone}
        with detections_kept():
            for way, scene in self.scenes.items():
                content = {"sensor": "scene", "sensing": {**LINK, "scene": scene}}
                settings = checked(ResenseSettings, content, "loss_split")
                result[way] = resense(alone, settings, self.folder / _slug(way) / str(self.seed), engine)
        return result

    def work(self) -> None:
        """Sense what is missing, in a worker."""
        self.sense()


@dataclass(frozen=True)
class Split:
    """The ways of knowing the records of some seeds. study: a dataset's, but for its seeds. scenes: by way."""

    folder: Path
    seeds: Sequence[int]
    study: Mapping[str, Any]
    scenes: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: SCENES)
    parts: Sequence[str] = ()
    """Ways that are the truth but for a part of the state, `WAY: PART`."""
    engine: Engine = field(default_factory=InlineEngine)
    feedback: Feedback = SILENT

    def sense(self) -> dict[str, list[Dataset]]:
        """Return the datasets of each way, one a seed, made now unless an earlier command made them.

        Raises RunError where a seed fails.
        """
        seeds = [SensedSeed(self.folder, seed, self.study, self.scenes) for seed in self.seeds]

        def failed(task: SensedSeed, reason: str) -> None:
            raise RunError(f"seed {task.seed}: {reason}")

        run_tasks(seeds, self.engine, self.feedback, "scenes", "seeds", failed)
        sensed = [of.sense() for of in seeds]
        return {way: [of[way] for of in sensed] for way in (SINGLE, *self.scenes)}

    @property
    def ways(self) -> tuple[str, ...]:
        """Every way that is compared, the truth first."""
        return (TRUTH, SINGLE, *self.scenes, *self.parts)

    def records(
        self, datasets: Mapping[str, Sequence[Dataset]], ways: Sequence[str] | None = None
    ) -> dict[str, Records]:
        """Return what is known of the records that no way has lost, by way. ways: those to read, by default all."""
        kept = [
            set.intersection(*(set(of[k].frame(["sample_id"])["sample_id"]) for of in datasets.values()))
            for k in range(len(self.seeds))
        ]

        @cache
        def known(way: str) -> Records:
            if way in self.parts:
                whole, part = way.split(": ")
                return _with_part(known(TRUTH), known(whole), part)
            source = SINGLE if way == TRUTH else way
            column: Literal["tv", "tv_truth"] = "tv_truth" if way == TRUTH else "tv"
            return _together(
                [_only(Records.of(of, column), ids) for of, ids in zip(datasets[source], kept, strict=True) if len(of)]
            )

        return {way: known(way) for way in ways or self.ways}

    def answers(self, records: Mapping[str, Records]) -> dict[str, dict[str, Counts]]:
        """Return the counts of each predictor and way, trained now unless the file has them of the same records.

        Raises RunError where a training fails.
        """
        file = self.folder / "split.json"
        known: dict[str, Any] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        made_of: dict[str, dict[str, Any]] = {}
        missing: list[tuple[str, str]] = []
        for way, of in records.items():
            ids = hashlib.sha256("\n".join(of.table["sample_id"]).encode()).hexdigest()[:16]
            made_of[way] = {"records": ids, "seeds": [int(seed) for seed in self.seeds], "versions": versions(OF_RUNS)}
            for model in TRAINING:
                stored = known.get(f"{model}; {way}", {})
                if {key: stored.get(key) for key in made_of[way]} != made_of[way]:
                    missing.append((model, way))
        tally = Tally(len(missing))

        def keep(outcome: Outcome[tuple[str, str], Counts]) -> None:
            model, way = outcome.item
            if outcome.result is None:
                raise RunError(f"{model}; {way}: {outcome.error}")
            known[f"{model}; {way}"] = {**made_of[way], "n": len(records[way]), "counts": outcome.result}
            write_json(file, known)
            tally.done += 1

        task = partial(_answer, replace(self, engine=InlineEngine(), feedback=SILENT))
        run_missing(
            task, missing, self.engine, self.feedback, title="answers", unit="trainings", keep=keep, progress=tally
        )
        return {model: {way: known[f"{model}; {way}"]["counts"] for way in records} for model in TRAINING}


def _answer(split: Split, asked: tuple[str, str]) -> Counts:
    """Return the counts of a predictor and a way, in a worker, which reads the records itself."""
    model, way = asked
    return cross_validated(split.records(split.sense(), [way])[way], model)


def cross_validated(records: Records, model: str) -> Counts:
    """Train a predictor without each fold of the seeds in turn, and count its right answers on that fold."""
    groups = sorted(set(records.groups), key=lambda name: int(name.rsplit("-", 1)[1]))
    folds = min(FOLDS, len(groups))
    if folds < 3:
        raise InputError(f"records of {len(groups)} seeds: a training, a validation and a test need 3")
    windows = {"end_after_s": END_AFTER_S}
    settings = checked(TrainSettings, {"model": model, "windows": windows, **TRAINING[model]}, "loss_split")
    counts: Counts = []
    for k in range(folds):
        test = groups[k::folds]
        rest = [name for name in groups if name not in test]
        chosen = rest[:: max(4, len(rest) // 2)]
        sides = {"train": [name for name in rest if name not in chosen], "validation": chosen, "test": test}
        with tempfile.TemporaryDirectory() as name:
            run = train_records(records, {"digest": f"fold {k}"}, Path(name) / "run", settings, sides=sides)
            held_out = records.take(np.asarray(np.isin(records.groups, test)))
            for end_s in (end for ends in ENDS.values() for end in ends):
                ends = fixed_ends(held_out, end_s)
                if not len(ends):
                    continue
                of = predict(run, held_out, ends)
                table = pd.DataFrame({"seed": of.group, "end_s": end_s, "origin": of.origin})
                table["right"] = of.predicted == of.label
                rows = table.groupby(COUNTED)["right"].agg(["size", "sum"]).reset_index()
                counts += [[*row[:3], int(row[3]), int(row[4])] for row in rows.to_numpy(dtype=object).tolist()]
    return counts


def fixed_ends(records: Records, end_s: float) -> Ends:
    """Return the windows that end at a time after onset, s, one for each record that holds such a window."""
    step, last = end_bounds(records, WindowSettings(end_after_s=(end_s, end_s)))
    rows = np.flatnonzero(last >= step)
    return Ends(rows, step[rows])


def accuracy(counts: Counts, chosen: BoolArray, less: Counts | None = None) -> tuple[float, float]:
    """Return the share of right answers and half its interval.

    chosen: which rows of the counts count. less: others' counts on the same windows, whose share is subtracted.
    """
    windows, right = (np.array([row[column] for row in counts], dtype=np.float64) for column in (3, 4))
    if less is not None:
        if [row[:4] for row in less] != [row[:4] for row in counts]:
            raise ValueError("counts of other windows")
        right = right - np.array([row[4] for row in less])
    seed = np.array([row[0] for row in counts], dtype=object)

    def share(of: BoolArray) -> float:
        return float(right[of].sum() / windows[of].sum()) if windows[of].sum() else float("nan")

    left_out = np.array([share(chosen & (seed != name)) for name in sorted(set(seed[chosen]))])
    return share(chosen), float(jackknife_half_width(left_out))


def table(answers: Mapping[str, Mapping[str, Counts]]) -> Iterable[str]:
    """Yield the lines of the result, in Markdown: for each predictor and way, accuracy and its difference to the truth.

    Both are in points, with half the interval of the difference.
    """
    for model, of_ways in answers.items():
        of_truth = of_ways[TRUTH]
        end, origin = (np.array([row[k] for row in of_truth], dtype=object) for k in (1, 2))
        parts: dict[str, BoolArray] = {name: np.isin(end.astype(float), ends) for name, ends in ENDS.items()}
        parts |= {str(name): np.asarray(origin == name) for name in sorted(set(origin))}
        windows = {
            name: sum(row[3] for row, used in zip(of_truth, of, strict=True) if used) for name, of in parts.items()
        }
        yield f"### {TITLES[model]}: right answers, % of windows, and points less than from the truth\n"
        yield "| known by | " + " | ".join(f"{name} ({windows[name]})" for name in parts) + " |"
        yield "| --- |" + " --- |" * len(parts)
        for way, counts in of_ways.items():
            cells = []
            for of in parts.values():
                value, half = accuracy(counts, of)
                if way == TRUTH:
                    cells.append(f"{100 * value:.1f} ± {100 * half:.1f}")
                else:
                    lost, wide = accuracy(counts, of, of_truth)
                    cells.append(f"{100 * value:.1f} ({100 * lost:+.1f} ± {100 * wide:.1f})")
            yield f"| {way} | " + " | ".join(cells) + " |"
        yield ""


def _slug(way: str) -> str:
    return way.replace(", ", "-").replace(" ", "-")


def _only(records: Records, ids: set[str]) -> Records:
    return records.take(np.asarray(records.table["sample_id"].isin(ids)))


def _together(parts: Sequence[Records]) -> Records:
    """Return the records of several datasets of one scenario as those of one."""
    first = parts[0]
    tv, uv = (
        np.stack([states[k] for states in of_parts for k in range(len(states))])
        for of_parts in ([part.tv for part in parts], [part.uv for part in parts])
    )
    whole = pd.concat([part.table for part in parts], ignore_index=True)
    return Records(tv, uv, first.tv_rate_hz, first.uv_rate_hz, whole, first.lane_maps)


def _with_part(truth: Records, known: Records, part: str) -> Records:
    """Return the records of the truth with a part of the state as it is known."""
    tv = np.array(truth.tv)
    tv[:, PARTS[part]] = np.array(known.tv)[:, PARTS[part]]
    return replace(truth, tv=tv)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("seeds", nargs="?", default="1:20", metavar="FIRST:LAST")
    parser.add_argument("seconds", nargs="?", type=float, default=120.0)
    parser.add_argument("ways", nargs="*", metavar="WAY", default=list(SCENES))
    parser.add_argument("--jobs", type=int, default=1, help="number of worker processes")
    arguments = parser.parse_args()
    first, last = number_range(arguments.seeds, "seeds", int, "1:20")
    ways = [way for way in arguments.ways if way in SCENES]
    parts = [way for way in arguments.ways if way not in ways]
    possible = {f"{way}: {part}" for way in (SINGLE, *ways) for part in PARTS}
    if wrong := sorted(set(parts) - possible):
        raise InputError(f"{wrong[0]}: not sensed; give {', '.join(SCENES)}, or WAY: PART of one that is given before")
    study = {**STUDY, "traffic": {"duration_s": arguments.seconds}}
    scenes = {way: SCENES[way] for way in ways}
    engine, feedback = LocalEngine(arguments.jobs), ConsoleFeedback(Console(stderr=True))
    split = Split(arguments.folder, range(first, last + 1), study, scenes, parts, engine, feedback)
    datasets = split.sense()
    records = split.records(datasets)
    kept, whole = len(records[TRUTH]), sum(map(len, datasets[SINGLE]))
    print(
        "### Records\n\n| seeds | length of each, s | records | known in every way | "
        + " | ".join(f"{way}: without a track" for way in ways)
        + " |"
    )
    print("| --- |" + " --- |" * (3 + len(ways)))
    lost = " | ".join(str(whole - sum(map(len, datasets[way]))) for way in ways)
    print(f"| {first} to {last} | {arguments.seconds:g} | {whole} | {kept} | {lost} |\n")
    for line in table(split.answers(records)):
        print(line)


if __name__ == "__main__":
    main()
