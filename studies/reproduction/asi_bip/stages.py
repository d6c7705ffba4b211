"""The experiments of the ASI-BIP paper as stages: Table I, Figs. 3 to 5, and what its text claims."""

from __future__ import annotations

import importlib.resources
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import log10
from pathlib import Path
from typing import Any

from isac_cosim.base.feedback import Feedback
from isac_cosim.base.settings import checked, merged, read_toml
from isac_cosim.base.workers.engine import Engine
from isac_cosim.evaluation.report.replay.content import Replay
from isac_cosim.evaluation.report.replay.making import replay_of_test
from isac_cosim.isacsim.radio.estimators.maximum_likelihood import SEARCH_FLOOR
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.generation.cost_estimate import estimate, sensed_anew
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.predictors.protocol import Workload
from isac_cosim.models.predictors.registry import PREDICTORS
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.studies.cost_estimate import INSTANTS
from isac_cosim.studies.reproduction.asi_bip.results import DatasetResult, TrainingsResult
from isac_cosim.studies.reproduction.experiments.sensing_cases import (
    GENERATED,
    TRAINED,
    SensingCase,
    description,
    of_groups,
    sensed,
    weather_cases,
    weather_stage,
)
from isac_cosim.studies.reproduction.experiments.sizes import PATCHED, AsiBipSize
from isac_cosim.studies.reproduction.experiments.stages import Stage
from isac_cosim.studies.reproduction.experiments.trainings import (
    Measure,
    Scores,
    WindowTraining,
    run_tasks,
    train_and_measure,
)
from isac_cosim.studies.study import Study
from isac_cosim.studies.sweep import finished, shared_split

PAPER = "asi-bip"
STUDY = "kinematic.toml"
"""The bundled study of the paper's setting."""
TABLE_1 = "table1"
"""Group of the stages that fill Table I."""
LITERAL_FACTOR = 8.0
"""Processor time of a training step with 1,101 tokens, relative to one with pooled tokens (one thread, batch 32)."""
PATCH_FACTOR = 0.4
"""Processor time of a training step with patches of 10 and 5 samples, relative to one without."""
BESIDE_STEPS_CPU_S = 2.5
"""Processor time of a training beyond its steps: its records, what tells windows before onset, what is measured, s."""
FAST: Mapping[str, tuple[dict[str, Any], float]] = {
    "bfloat16": ({"lstm_bfloat16": True}, 0.7),
    "patches": (PATCHED, PATCH_FACTOR),
}
"""Ways to train faster: settings of the network, and the processor time of a training step relative to one without."""

CONTROLS = {"control-slow": "asi-bip-slow", "control-fast": "asi-bip-fast"}
"""ASI-BIP with both streams at one rate: the predictor, by the stage's name."""
ESTIMATOR_FACTORS = {"grid": 2.3, "padded_grid": 4.1, "padded_parabola": 4.2}
"""Processor time of sensing with grid estimators, which search the whole DFT, relative to ours (21 records)."""
SEARCH_FACTOR = 14.0
"""Processor time of sensing where noise can mislead our estimator's search, relative to higher SNR (208 records)."""


def study_of(size: AsiBipSize) -> Study:
    """Return the bundled kinematic study in a size, with the paper's optimiser and one thread a training."""
    content = read_toml(Path(str(importlib.resources.files("isac_cosim.studies") / STUDY)))
    content = merged(content, {"dataset": size.dataset, "training": size.training})
    content = merged(content, {"training": {"optimiser": {"clip_norm": 0.0, "threads": 1}}})
    return checked(Study, content, STUDY)


@dataclass(frozen=True)
class AsiBipReproduction:
    """The stages of the reproduction, in a folder.

    engine: runs episodes, sensing and trainings. feedback: where progress is reported.
    """

    size: AsiBipSize
    out: Path
    engine: Engine
    feedback: Feedback

    @cached_property
    def study(self) -> Study:
        """Settings of datasets and trainings."""
        return study_of(self.size)

    def stages(self) -> list[Stage]:
        """Return all stages, in order."""
        seeds, training_s = len(self.size.training_seeds), self._training_s("asi-bip")
        literal_s = (1 + LITERAL_FACTOR) * self.size.literal_epochs / self.study.training.optimiser.epochs * training_s
        training_stage = partial(Stage, kind=TrainingsResult)
        table = [
            training_stage(
                name=case.name,
                group=TABLE_1,
                question=f"Table I, {case.title}",
                cost_s=0.0,
                parallel=seeds,
                run=partial(self._case, case),
                makes=self._made(case),
            )
            for case in TRAINED
        ]
        test_share = self.study.training.split.test
        measured_s = 0.05 * training_s * seeds
        snr_s = test_share * self._snr_s() + measured_s
        pooled_s = seeds * self._training_s("aligned")
        fast_s = seeds * training_s * sum(factor for _, factor in FAST.values())
        weather = [
            training_stage(
                name=weather_stage(chain),
                group=TABLE_1,
                question=f"Table I, {chain} in adverse weather",
                cost_s=measured_s + test_share * sum(self._sensing_s(case) for case in weather_cases(chain)),
                parallel=seeds,
                run=partial(self._weather, chain),
                makes=self._made(next(case for case in TRAINED if case.name == chain)),
            )
            for chain in self.size.weather_chains
        ]
        data = {self._dataset_folder(GENERATED): self._generating_s()}
        isac = partial(training_stage, parallel=seeds, makes=self._made(self._isac()))
        training_stage = partial(training_stage, makes=data)
        question = "how many samples of each intention"
        return [
            Stage("data", "data", question, 0.0, 8, self._data, DatasetResult, makes=data),
            *table,
            *weather,
            isac("fig3", "fig3", "Fig. 3: loss, accuracy and confusion", measured_s, run=self._fig3),
            isac("fig4", "fig4", "Fig. 4: the unknown class", measured_s, run=self._fig4),
            isac("fig5", "fig5", "Fig. 5: F1 by SNR, without training anew", snr_s, run=self._fig5),
            training_stage("aligned", "aligned", "asynchronous or aligned fusion", pooled_s, seeds, self._aligned),
            *(
                training_stage(
                    name,
                    "aligned",
                    f"asynchronous or aligned fusion: {model}, with both streams at one rate",
                    seeds * self._training_s(model),
                    seeds,
                    partial(self._control, name, model),
                )
                for name, model in CONTROLS.items()
            ),
            training_stage(
                "literal", "literal", "every LSTM output as a token, or pooled", literal_s, 1, self._literal
            ),
            training_stage("fast", "fast", "what faster trainings cost", fast_s, seeds * len(FAST), self._fast),
        ]

    def replay(self) -> Replay | None:
        """Return the replay of the first test episode, sensed by the sites, with the answers of the first training."""
        folder, run = self._dataset_folder(GENERATED), self._run_folder(GENERATED, self.size.training_seeds[0])
        return replay_of_test(folder, run, self.engine, self.feedback)

    def _data(self) -> DatasetResult:
        generated, sides = self.generated(), self.sides
        table = generated.frame(("scenario", "seed", "intention"))
        group = table["scenario"].astype(str) + "-" + table["seed"].astype(str)
        known = table["intention"].isin([intention.text for intention in KNOWN])
        counts = {
            side: {
                "known": int((group.isin(names) & known).sum()),
                "following": int((group.isin(names) & ~known).sum()),
            }
            for side, names in sides.items()
        }
        return DatasetResult(datasets={GENERATED: description(generated)}, sides=sides, samples=counts)

    def _case(self, case: SensingCase) -> TrainingsResult:
        dataset = self.dataset(case)
        tasks = self._tasks(case.name, case, "asi-bip", self.size.training_seeds)
        return TrainingsResult(trainings=self._run(tasks, case.title), dataset=description(dataset))

    def _weather(self, chain: str) -> TrainingsResult:
        trained = next(case for case in TRAINED if case.name == chain)
        self.dataset(trained)
        datasets, measures = {}, []
        for case in weather_cases(chain):
            folder = self._dataset_folder(f"test-{case.name}")
            dataset = sensed(self._test_records(), case, folder, self.engine, self.feedback)
            datasets[case.name] = description(dataset)
            measures.append(Measure(name=case.name, dataset=folder))
        tasks = self._tasks(weather_stage(chain), trained, "asi-bip", self.size.training_seeds, tuple(measures))
        scores = self._run(tasks, f"{trained.title}, in adverse weather")
        return TrainingsResult(trainings=scores, datasets=datasets)

    def _fig3(self) -> TrainingsResult:
        case = self._isac()
        folder = self.dataset(case).path
        measures = (Measure(name="test", dataset=folder), Measure(name="validation", dataset=folder, side="validation"))
        tasks = self._tasks("fig3", case, "asi-bip", self.size.training_seeds, measures)
        return TrainingsResult(trainings=self._run([replace(task, history=True) for task in tasks], "Fig. 3"))

    def _fig4(self) -> TrainingsResult:
        case = self._isac()
        self.dataset(case)
        tasks = self._tasks("fig4", case, "asi-bip", self.size.training_seeds)
        return TrainingsResult(trainings=self._run([replace(task, unknown=True) for task in tasks], "Fig. 4"))

    def _fig5(self) -> TrainingsResult:
        case, measures, datasets = self._isac(), [], {}
        self.dataset(case)
        for snr_db in self.size.snr_db:
            folder = self._dataset_folder(f"test-snr_{snr_db:g}")
            dataset = sensed(self._test_records(), case, folder, self.engine, self.feedback, f"{snr_db:g}")
            datasets[f"{snr_db:g}"] = description(dataset)
            measures.append(Measure(name=f"{snr_db:g}", dataset=folder))
        tasks = self._tasks("fig5", case, "asi-bip", self.size.training_seeds, tuple(measures))
        return TrainingsResult(trainings=self._run(tasks, "Fig. 5"), datasets=datasets, snr_db=list(self.size.snr_db))

    def _aligned(self) -> TrainingsResult:
        case = self._isac()
        self.dataset(case)
        tasks = self._tasks("aligned", case, "aligned", self.size.training_seeds)
        return TrainingsResult(trainings=self._run(tasks, "aligned fusion"))

    def _control(self, name: str, model: str) -> TrainingsResult:
        case = self._isac()
        self.dataset(case)
        tasks = self._tasks(name, case, model, self.size.training_seeds)
        return TrainingsResult(trainings=self._run(tasks, "fusion at one rate"))

    def _literal(self) -> TrainingsResult:
        case = self._isac()
        self.dataset(case)
        seed, epochs = self.size.training_seeds[0], self.size.literal_epochs
        content = self.study.training_of("asi-bip", seed).model_dump()
        task = self._tasks("literal", case, "asi-bip", (seed,))[0]
        tasks = []
        for tokens in ("literal", "pooled"):
            changes = {"asi_bip": {"tokens": tokens}, "optimiser": {"epochs": epochs}}
            tasks.append(
                replace(
                    task,
                    name=tokens,
                    scores_file=task.scores_file.with_name(f"{tokens}.json"),
                    training=TrainSettings.model_validate(merged(content, changes)),
                    run=self._run_folder(tokens, seed),
                )
            )
        return TrainingsResult(trainings=self._run(tasks, "literal tokens"), epochs=epochs)

    def _fast(self) -> TrainingsResult:
        case = self._isac()
        self.dataset(case)
        tasks = []
        for name, (changes, _) in FAST.items():
            for task in self._tasks(f"fast-{name}", case, "asi-bip", self.size.training_seeds):
                content = merged(task.training.model_dump(), {"asi_bip": changes})
                folder = self._run_folder(f"{case.name}-{name}", task.training.seed)
                tasks.append(replace(task, training=TrainSettings.model_validate(content), run=folder))
        return TrainingsResult(trainings=self._run(tasks, "faster trainings"))

    def generated(self) -> Dataset:
        """Return the dataset that all cases are sensed from, generated unless it is there."""
        folder = self._dataset_folder(GENERATED)
        if finished(folder):
            return Dataset.open(folder)
        return generate(self.study.dataset, folder, self.engine, self.feedback)

    def dataset(self, case: SensingCase) -> Dataset:
        """Return a case's dataset, sensed anew unless it is there."""
        generated = self.generated()
        if case.name == GENERATED:
            return generated
        return sensed(generated, case, self._dataset_folder(case.name), self.engine, self.feedback)

    @cached_property
    def sides(self) -> dict[str, list[str]]:
        """The scenario seeds to train, validate and test on, the same in all cases."""
        return shared_split(self.generated(), self.study.training.split)

    def _isac(self) -> SensingCase:
        return next(case for case in TRAINED if case.name == GENERATED)

    def _test_records(self) -> Dataset:
        return of_groups(self.generated(), self.sides["test"])

    def _tasks(
        self,
        stage: str,
        case: SensingCase,
        model: str,
        seeds: Sequence[int],
        measures: tuple[Measure, ...] | None = None,
    ) -> list[WindowTraining]:
        """Return a training for each seed, on the dataset of a case; tasks of several stages share their predictors.

        measures: what is measured; the windows of the test seeds when None.
        """
        folder, run = self._dataset_folder(case.name), case.name if model == "asi-bip" else f"{case.name}-{model}"
        return [
            WindowTraining(
                name=f"{stage}, training seed {seed}",
                scores_file=self.out / "work" / "scores" / stage / f"seed-{seed}.json",
                dataset=folder,
                sides=self.sides,
                training=self.study.training_of(model, seed),
                run=self._run_folder(run, seed),
                measures=measures or (Measure(name="test", dataset=folder),),
            )
            for seed in seeds
        ]

    def _run(self, tasks: list[WindowTraining], title: str) -> list[Scores]:
        """Run tasks; return their scores."""
        work: Callable[[WindowTraining], Scores] = train_and_measure
        return run_tasks(work, tasks, self.engine, self.feedback, title)

    def _dataset_folder(self, name: str) -> Path:
        return self.out / "work" / "datasets" / name

    def _run_folder(self, name: str, seed: int) -> Path:
        return self.out / "work" / "runs" / name / f"seed-{seed}"

    def _made(self, case: SensingCase) -> dict[Path, float]:
        """Return what the trainings of a case make in `work`, with the processor time of each, s."""
        datasets = {
            self._dataset_folder(case.name): self._sensing_s(case),
            self._dataset_folder(GENERATED): self._generating_s(),
        }
        training_s = self._training_s("asi-bip")
        return datasets | {self._run_folder(case.name, seed): training_s for seed in self.size.training_seeds}

    def _generating_s(self) -> float:
        return estimate(self.study.dataset).cpu_s

    def _sensing_s(self, case: SensingCase) -> float:
        """Return the expected processor time of sensing all records as in a case, s."""
        if case.name == GENERATED:
            return 0.0
        generated = estimate(self.study.dataset)
        factor = ESTIMATOR_FACTORS.get(case.sensing.get("estimator", ""), 1.0)
        return factor * sensed_anew(self.study.dataset, generated, case.sensor).cpu_s

    def _snr_s(self) -> float:
        """Return the expected processor time of sensing all records at every SNR of Fig. 5, s."""
        searched = 10 * log10(SEARCH_FLOOR)
        factors = [SEARCH_FACTOR if snr_db < searched else 1.0 for snr_db in self.size.snr_db]
        generated = estimate(self.study.dataset)
        return sum(factors) * sensed_anew(self.study.dataset, generated, GENERATED).cpu_s

    def _training_s(self, model: str) -> float:
        """Return the expected processor time of one training, s."""
        study, training = self.study, self.study.training_of(model, 0)
        samples, split = estimate(study.dataset).samples, training.split
        record = study.dataset.record
        scale = training.windows.window_s * (record.tv_rate_hz + record.uv_rate_hz) / INSTANTS
        work = Workload(
            (1 - split.validation - split.test) * samples, split.validation * samples, split.test * samples, scale
        )
        patched = model.startswith("asi-bip") and "asi_bip" in self.size.training
        return PREDICTORS[model].cost_s(work, training) * (PATCH_FACTOR if patched else 1.0) + BESIDE_STEPS_CPU_S
