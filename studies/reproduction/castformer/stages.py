"""The experiments of the CaSTFormer paper as stages: Tables 3 to 5, Figs. 5 and 6, on windows or on clips.

Every network is trained once on each fold, on windows that end at any of the paper's horizons, and measured at all of
them. So a table with five horizons takes five trainings a row, not twenty-five.
"""

from __future__ import annotations

import importlib.resources
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.seeding import stream
from isac_cosim.base.settings import checked, merged, read_toml
from isac_cosim.base.workers.engine import Engine
from isac_cosim.evaluation.report.replay.content import Replay
from isac_cosim.evaluation.report.replay.making import replay_of_test
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.generation.cost_estimate import estimate
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.models.data.clips import NO_BACKGROUND, extraction_in
from isac_cosim.models.predictors.castformer import PAPER_OPTIMISER
from isac_cosim.models.predictors.protocol import Workload
from isac_cosim.models.predictors.registry import PREDICTORS
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.studies.clip_validation import background_of
from isac_cosim.studies.cost_estimate import INSTANTS
from isac_cosim.studies.reproduction.asi_bip.stages import PATCH_FACTOR, STUDY
from isac_cosim.studies.reproduction.castformer import variants
from isac_cosim.studies.reproduction.castformer.clips import ClipTraining, clips_in, measure_clips
from isac_cosim.studies.reproduction.castformer.motion_clips import (
    BACKGROUND,
    CLASSES,
    driving_count,
    write_clips,
)
from isac_cosim.studies.reproduction.castformer.results import SamplesResult, VariantScores, VariantsResult
from isac_cosim.studies.reproduction.castformer.variants import Variant
from isac_cosim.studies.reproduction.experiments.paper_figures import HORIZONS_S
from isac_cosim.studies.reproduction.experiments.sensing_cases import description
from isac_cosim.studies.reproduction.experiments.sizes import CastformerSize
from isac_cosim.studies.reproduction.experiments.stages import Stage
from isac_cosim.studies.reproduction.experiments.trainings import Measure, WindowTraining, run_tasks, train_and_measure
from isac_cosim.studies.sweep import finished

PAPER = "castformer"
KINEMATIC, DRIVING, MOTORWAY, CLIPS = "kinematic", "driving", "motorway", "clips"
"""Sources: maneuvers and plain driving of the kinematic source, the bundled motorway, and a folder of clips."""
SMALL_BATCH = 1.8
"""Processor time of a training step in batches of 16, relative to that of `Predictor.cost_s`, for batches of 32."""
OVERHEAD_S = 4.0
"""Processor time of a training beyond its steps, for every thousand samples: reading records, and predictions that are
measured, s."""
VALIDATION_SHARE = 1 / 8
"""Share of the scenario seeds outside the tested fold on which the best epoch is chosen."""


@dataclass(frozen=True)
class CastformerReproduction:
    """The stages of the reproduction, in a folder.

    engine: runs episodes and trainings. feedback: where progress is reported. clips: folder of feature files that take
    the place of the windows, as those of Brain4Cars; None for windows. straight: the class that drives straight on, as
    the user gives it; None to read it from the clips.
    """

    size: CastformerSize
    out: Path
    engine: Engine
    feedback: Feedback
    clips: Path | None = None
    straight: str | None = None

    def stages(self) -> list[Stage]:
        """Return all stages, in order. A network that several of them compare is trained by the first."""
        tables = [
            ("horizon", "Table 3: observation that ends 0 to 4 s before the action", variants.horizon()),
            ("ablation", "Table 4: every combination of RSF, CPE and FSN", variants.ablation()),
            ("attention", "Fig. 5: what RSF attends to", variants.attention()),
            ("orders", "Table 5: the order of the modules", variants.orders()),
            ("counterfactual", "Eq. (6): the mean over a window or over a batch", variants.counterfactuals()),
            ("alpha", "Fig. 6: the weight of the intention's loss", variants.alphas(self.size.alphas)),
        ]
        if self.clips is None:
            tables.append(("compared", "parameters and time beside F1", variants.compared(self.size.compared)))
        trained: set[str] = set()
        stages = [self._data_stage()]
        for name, question, rows in tables:
            new = [row for row in rows if row.name not in trained]
            trained |= {row.name for row in new}
            stages.append(self._stage(name, question, new, rows))
        stages += [self._repeat_stage(seed) for seed in self.size.training_seeds[1:]]
        if self.clips is None and self.size.background_share:
            stages.append(self._background_stage())
        if self.clips is None and self.size.motorway is not None:
            rows, motorway = variants.compared(("trees",)), partial(self._windows_data, MOTORWAY)
            made = self._made(MOTORWAY)
            stages += [
                Stage(
                    "motorway-data", MOTORWAY, "windows of the motorway", 0.0, 8, motorway, SamplesResult, makes=made
                ),
                self._stage(MOTORWAY, "Table 3 on the motorway", rows, rows, MOTORWAY),
            ]
        return stages

    def replay(self) -> Replay | None:
        """Return the replay of an episode of the first fold, with the answers of the network with all modules."""
        if self.clips is not None:
            return None
        run = self._run_folder(KINEMATIC, variants.COMPLETE, self._part(0, self.size.training_seeds[0]))
        return replay_of_test(self._dataset_folder(KINEMATIC), run, self.engine, self.feedback)

    def _stage(
        self, name: str, question: str, new: Sequence[Variant], rows: Sequence[Variant], source: str = KINEMATIC
    ) -> Stage:
        parallel = max(1, len(new) * self.size.folds)
        work, check = partial(self._measure, name, rows, source), partial(_check_installed, rows)
        return Stage(name, name, question, 0.0, parallel, work, VariantsResult, check, self._made(source, rows))

    def _repeat_stage(self, seed: int) -> Stage:
        """Return the stage that trains the networks of the main comparison once more."""
        rows = variants.main_comparison()
        made = self._made(KINEMATIC, rows, seed)
        name, question = variants.repeat_stage(seed), f"Table 4: its main comparison with training seed {seed}"
        work = partial(self._measure, name, rows, KINEMATIC, seed)
        parallel = len(rows) * self.size.folds
        return Stage(name, "ablation", question, 0.0, parallel, work, VariantsResult, makes=made)

    def _made(self, source: str, rows: Sequence[Variant] = (), seed: int | None = None) -> dict[Path, float]:
        """Return what networks of a source make in `work`, with the processor time of each, s.

        seed: of the trainings, the first of the size if None.
        """
        made = {}
        if self.clips is None:
            made[self._dataset_folder(source)] = estimate(self.dataset_study(source)).cpu_s
        source = source if self.clips is None else CLIPS
        seed = self.size.training_seeds[0] if seed is None else seed
        parts = [self._part(fold, seed) for fold in range(self.size.folds)]
        for row in rows:
            made |= dict.fromkeys(
                (self._scores_file(source, row, part) for part in parts), self.training_s(row, source)
            )
        return made

    def _data_stage(self) -> Stage:
        if self.clips is not None:
            return Stage("data", "data", "the clips", 1.0, 1, self._clips_data, SamplesResult)
        question, work = "windows that reach 6 s before the commit", partial(self._windows_data, KINEMATIC)
        return Stage("data", "data", question, 0.0, 8, work, SamplesResult, makes=self._made(KINEMATIC))

    def _windows_data(self, source: str) -> SamplesResult:
        return SamplesResult(source=source, dataset=description(self.dataset(source)), folds=self.folds(source))

    def _clips_data(self) -> SamplesResult:
        labels = np.bincount([clip.label for clip in self._clips])
        background = NO_BACKGROUND if self.background is None else self.background
        assert self.clips is not None
        made = extraction_in(self.clips)
        return SamplesResult(
            source=CLIPS,
            clips=len(self._clips),
            by_class=labels.tolist(),
            background=background,
            random=[] if made is None else made.random,
        )

    def _background_stage(self) -> Stage:
        samples = sum(estimate(self.dataset_study(source)).samples for source in (KINEMATIC, DRIVING))
        cost_s = self._clip_training_s(samples) * self.size.folds
        question, made = "Eq. (13) with plain driving as a class", self._made(KINEMATIC) | self._made(DRIVING)
        work, folds = self._measure_background, self.size.folds
        return Stage("background", "background", question, cost_s, folds, work, VariantsResult, makes=made)

    def _measure_background(self) -> VariantsResult:
        """Train and measure CaSTFormer on clips of our own motion, of which some are of plain driving."""
        folder = self.out / "work" / "clips"
        names = write_clips([self.dataset(KINEMATIC), self.dataset(DRIVING)], folder)
        folds = self.folds(KINEMATIC)
        tasks = [
            ClipTraining(
                name=f"background, fold {k}",
                scores_file=self.out / "work" / "scores" / "background" / f"fold-{k}.json",
                folder=folder,
                castformer=variants.COMPLETE.settings | self.size.training.get("castformer", {}),
                folds=self.size.folds,
                fold=k,
                epochs=self.epochs,
                background=BACKGROUND,
                classes=CLASSES,
                held_out=tuple(name for group in fold for name in names.get(group, ())),
            )
            for k, fold in enumerate(folds)
        ]
        scores = run_tasks(measure_clips, tasks, self.engine, self.feedback, "background")
        complete = VariantScores(name=variants.COMPLETE.name, title=variants.COMPLETE.title, folds=scores)
        return VariantsResult(source=KINEMATIC, variants=[complete], background=BACKGROUND)

    def _measure(self, stage: str, rows: Sequence[Variant], source: str, seed: int | None = None) -> VariantsResult:
        """Train and measure networks; seed: of the trainings, the first of the size if None."""
        if seed is None:
            seed = self.size.training_seeds[0]
        tasks: list[WindowTraining] | list[ClipTraining]
        if self.clips is not None:
            tasks = [self._clip_task(row, fold, seed) for row in rows for fold in range(self.size.folds)]
            scores = run_tasks(measure_clips, tasks, self.engine, self.feedback, stage)
        else:
            self.dataset(source)
            sides = self.sides(source)
            tasks = [self._window_task(row, source, k, fold, seed) for row in rows for k, fold in enumerate(sides)]
            scores = run_tasks(train_and_measure, tasks, self.engine, self.feedback, stage)
        folds = self.size.folds
        return VariantsResult(
            source=source if self.clips is None else CLIPS,
            background=None if self.clips is None else self.background,
            variants=[
                VariantScores(name=row.name, title=row.title, folds=scores[k * folds : (k + 1) * folds])
                for k, row in enumerate(rows)
            ],
        )

    def _window_task(
        self, row: Variant, source: str, fold: int, sides: dict[str, list[str]], seed: int
    ) -> WindowTraining:
        folder, part = self._dataset_folder(source), self._part(fold, seed)
        return WindowTraining(
            name=f"{source}, {row.name}, {part.replace('-', ' ')}",
            scores_file=self._scores_file(source, row, part),
            dataset=folder,
            sides=sides,
            training=self.training(row, seed),
            run=self._run_folder(source, row, part),
            measures=tuple(
                Measure(name=str(h), dataset=folder, relative_to="commit", end_after_s=(-h, -h)) for h in HORIZONS_S
            ),
        )

    def _clip_task(self, row: Variant, fold: int, seed: int) -> ClipTraining:
        assert self.clips is not None
        part = self._part(fold, seed)
        return ClipTraining(
            name=f"clips, {row.name}, {part.replace('-', ' ')}",
            scores_file=self._scores_file(CLIPS, row, part),
            training_seed=seed,
            folder=self.clips,
            castformer=row.settings,
            folds=self.size.folds,
            fold=fold,
            epochs=self.epochs,
            background=self.background,
        )

    def _part(self, fold: int, seed: int) -> str:
        """Return the name of the trainings of a fold, without the seed for the first one."""
        return f"fold-{fold}" if seed == self.size.training_seeds[0] else f"fold-{fold}-seed-{seed}"

    def _scores_file(self, source: str, row: Variant, part: str) -> Path:
        return self.out / "work" / "scores" / source / row.name / f"{part}.json"

    @property
    def epochs(self) -> int:
        """Epochs of CaSTFormer: the size's, or the paper's."""
        epochs: int = self.size.training.get("optimiser", {}).get("epochs", PAPER_OPTIMISER["epochs"])
        return epochs

    def training(self, row: Variant, seed: int = 0) -> TrainSettings:
        """Return the settings that a network is trained with: plain cross-entropy, no clipping, constant rate."""
        content = merged(
            {
                "seed": seed,
                "windows": {"relative_to": "commit", "end_after_s": self.size.trained_end_s},
                "optimiser": {"clip_norm": 0.0, "threads": 1},
                "loss": {"class_weights": False},
                "pre_onset": {"use": False},
                "castformer": row.settings,
                "asi_bip": {"lstm_bfloat16": False},
            },
            self.size.training,
        )
        if row.model != PAPER:
            epochs = {"epochs": self.size.compared_epochs, "patience": self.size.compared_epochs}
            content = merged(content, {"model": row.model, "optimiser": epochs, "loss": {"class_weights": True}})
        else:
            content["model"] = PAPER
        return checked(TrainSettings, content, f"variant {row.name}")

    def dataset_study(self, source: str) -> DatasetStudy:
        """Return the settings of a source's dataset."""
        if source == MOTORWAY:
            return checked(DatasetStudy, {"scenarios": [MOTORWAY], **(self.size.motorway or {})}, MOTORWAY)
        content = read_toml(Path(str(importlib.resources.files("isac_cosim.studies") / STUDY)))["dataset"]
        content = merged(content, self.size.dataset)
        if source == DRIVING:
            count = driving_count(content["selection"]["per_class"], self.size.background_share)
            alone = {"selection": {"following": count}, "kinematics": {"per_class": 0, "following_scenes": count}}
            content = merged(content, alone)
        return checked(DatasetStudy, content, STUDY)

    def dataset(self, source: str) -> Dataset:
        """Return a source's dataset, generated unless it is there."""
        folder = self._dataset_folder(source)
        if finished(folder):
            return Dataset.open(folder)
        return generate(self.dataset_study(source), folder, self.engine, self.feedback)

    def folds(self, source: str) -> list[list[str]]:
        """Return the scenario seeds that each fold tests; every seed is in one fold."""
        table = self.dataset(source).frame(("scenario", "seed"))
        groups = sorted(set(table["scenario"].astype(str) + "-" + table["seed"].astype(str)))
        return folds_of(groups, self.size.folds)

    def sides(self, source: str) -> list[dict[str, list[str]]]:
        """Return the scenario seeds to train, validate and test on in each fold."""
        return sides_of(self.folds(source))

    @cached_property
    def _clips(self) -> list[Any]:
        assert self.clips is not None
        return list(clips_in(self.clips))

    @cached_property
    def background(self) -> int | None:
        """The class of the clips that drives straight on, None where every class is a maneuver."""
        return background_of(self._clips, self.straight)

    def _dataset_folder(self, source: str) -> Path:
        return self.out / "work" / "datasets" / source

    def _run_folder(self, source: str, row: Variant, part: str) -> Path:
        return self.out / "work" / "runs" / source / row.name / part

    def _clip_training_s(self, samples: float) -> float:
        """Return the expected processor time of training on clips of our own motion outside a fold, s."""
        outside = (1 - 1 / self.size.folds) * samples
        work = Workload(outside, 0.0, samples / self.size.folds * len(HORIZONS_S), 1.0)
        training = self.training(variants.COMPLETE)
        return SMALL_BATCH * PREDICTORS[PAPER].cost_s(work, training) + OVERHEAD_S * samples / 1e3

    def training_s(self, row: Variant, source: str) -> float:
        """Return the expected processor time of one training on one fold, s."""
        training = self.training(row)
        if self.clips is not None:
            share, n, scale = 1 - 1 / self.size.folds, len(self._clips), 1.0
        else:
            share, n = (1 - 1 / self.size.folds) * (1 - VALIDATION_SHARE), estimate(self.dataset_study(source)).samples
            record = self.dataset_study(source).record
            scale = training.windows.window_s * (record.tv_rate_hz + record.uv_rate_hz) / INSTANTS
        work = Workload(share * n, (1 - share) / 2 * n, n / self.size.folds * len(HORIZONS_S), scale)
        factor = SMALL_BATCH if row.model == PAPER else 1.0
        if row.model == "asi-bip" and "asi_bip" in self.size.training:
            factor = PATCH_FACTOR
        return factor * PREDICTORS[row.model].cost_s(work, training) + OVERHEAD_S * n / 1e3


def _check_installed(rows: Sequence[Variant]) -> None:
    """Raise InputError where a predictor needs an optional package that is missing."""
    for row in rows:
        PREDICTORS[row.model].check_requirements()


def folds_of(groups: Sequence[str], count: int) -> list[list[str]]:
    """Return `count` parts of about equal size that hold each of the groups once.

    Raises InputError with fewer than two groups outside a part.
    """
    if len(groups) - math.ceil(len(groups) / count) < 2:
        raise InputError(
            f"{len(groups)} scenario seeds with samples are too few for {count} folds: generate more seeds"
        )
    order = stream("folds", count).permutation(len(groups))
    return [sorted(groups[int(k)] for k in order[part::count]) for part in range(count)]


def sides_of(folds: Sequence[Sequence[str]]) -> list[dict[str, list[str]]]:
    """Return the sides of each fold: it is tested, and some of the other groups choose the best epoch."""
    sides = []
    for k, test in enumerate(folds):
        others = [group for j, fold in enumerate(folds) if j != k for group in fold]
        order = stream("fold validation", k).permutation(len(others))
        n_validation = max(1, round(VALIDATION_SHARE * len(others)))
        shuffled = [others[int(i)] for i in order]
        sides.append(
            {
                "train": sorted(shuffled[n_validation:]),
                "validation": sorted(shuffled[:n_validation]),
                "test": sorted(test),
            }
        )
    return sides
