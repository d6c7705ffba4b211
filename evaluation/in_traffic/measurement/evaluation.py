"""Evaluates a run in running traffic: runs the episodes, chooses alarms, measures them, and writes `metrics.json`.

DIR/study.json        the settings of the evaluation, so that the same command continues it
DIR/episodes/         a file for each seed: all answers, and the events
DIR/metrics.json      the result; the same for any number of worker processes
DIR/speed.json        processor time of the episodes
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.files import claim, write_json
from isac_cosim.base.seeding import stream
from isac_cosim.base.settings import Settings, checked, merged, read_json
from isac_cosim.base.versions import OF_EPISODES, versions
from isac_cosim.base.workers.engine import Engine, LocalEngine
from isac_cosim.base.workers.episodes import Episodes, begin_episodes, run_episodes
from isac_cosim.evaluation.in_traffic.measurement.summary import (
    RANDOM,
    SITUATION,
    Evaluated,
    TrafficEvaluation,
    read_speed,
    summarise,
)
from isac_cosim.evaluation.in_traffic.scores.results import METRICS_FILE, TrafficResult
from isac_cosim.evaluation.in_traffic.settings import DEVELOPMENT, DEVELOPMENT_H, SEEDS, LiveSettings, LiveStudy
from isac_cosim.evaluation.in_traffic.streams.episode import EpisodeTask, Predictors, ProcessorTime, timing_of
from isac_cosim.evaluation.in_traffic.streams.store import (
    EPISODES,
    FILES,
    RULE,
    RUN,
    SPEED_FILE,
    TRUTH,
    file_name,
    predicted_hours,
)
from isac_cosim.evaluation.questions import with_answers
from isac_cosim.isacsim.scenarios.scenario import Scenario, resolved
from isac_cosim.isacsim.sensing.sensors.scene import as_sensed
from isac_cosim.isacsim.traffic.sources import DEFAULT
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource
from isac_cosim.isacsim.traffic.sources.registry import motion_source, natural_world, source_class
from isac_cosim.labeling.generation.folder import changed_input, fingerprint
from isac_cosim.labeling.generation.generate import describe
from isac_cosim.labeling.generation.log import withheld
from isac_cosim.labeling.generation.settings import DatasetStudy, SeedRange, as_stored, driven_by_profiles
from isac_cosim.models.data.situation import FEATURES
from isac_cosim.models.inference import Infer
from isac_cosim.models.runs.run import Run, RunCard
from isac_cosim.models.scores import open_set

STUDY_FILE = "study.json"
SCORED_AFTERWARDS: dict[str, Any] = {
    "dataset": {"seeds", "selection", "world"},
    "development": True,
    "development_h": True,
    "live": {"choice", "background", "scoring"},
}
"""The settings that episodes do not depend on: if they change, an evaluation continues in the same folder."""
PROBES = 64
"""Number of windows that test whether a predictor looks at the UV."""
FIRST_DEVELOPMENT = 4
"""Development seeds that are run to see how many it takes; if they hold no prediction, they stay the only ones."""


class BegunEvaluation(Settings):
    """The content of STUDY_FILE.

    versions: with which its episodes are run. inputs: digests of what recordings depend on, by name. Both are empty in
    folders of earlier versions.
    """

    fingerprint: str
    study: LiveStudy
    versions: dict[str, str] = Field(default_factory=dict)
    inputs: dict[str, str] = Field(default_factory=dict)


def study_of(
    card: RunCard,
    scenario: str,
    seeds: tuple[int, int] | None = None,
    development: tuple[int, int] | None = None,
    duration_s: float | None = None,
    live: LiveSettings | None = None,
    natural: bool = False,
    source: str = DEFAULT,
    sections: Mapping[str, Mapping[str, Any]] | None = None,
    scene: bool | None = None,
) -> LiveStudy:
    """Return the study of an evaluation, with the settings of the dataset that the run was trained on.

    Traffic, labels, pairs and reports are those of the dataset, or the defaults if its study is not known or its
    motion had another source. Sensing uses the link budget, at the rates of the run; predictions and delays wait for
    whole samples of these.
    seeds, development: first and last seed; by default, alarms are chosen on DEVELOPMENT_H vehicle-hours. duration_s:
    of an episode, s. natural: if true, drivers are left alone: no causes, commands or disturbances. source: name of the
    motion source. sections: settings of the source that are given, by section. scene: whether the sites sense all
    vehicles at once, by default as in the dataset.
    Raises InputError if an argument is wrong, or the dataset's study cannot be read.
    """
    kind, stored = source_class(source), as_stored(card.dataset.get("study", {}))
    given: dict[str, Any] = {"source": source, **(sections or {})}
    if stored.get("source", DEFAULT) != source:
        stored = {key: value for key, value in stored.items() if key in DatasetStudy.model_fields.keys() - {"world"}}
    if natural:
        given["world"] = world = natural_world(source)
        stored = {key: value for key, value in stored.items() if key not in kind.worlds[world]}
    elif driven_by_profiles(stored):
        raise InputError(
            "the run's dataset is of version 0.2.0, whose commanded maneuvers can no longer be driven: give --natural, "
            "or train on a dataset of this version"
        )
    if duration_s is not None:
        if kind.duration is None:
            raise InputError(f"--duration: recordings of source {source} have their own length; leave it out")
        section, setting = kind.duration
        given[section] = {setting: duration_s}
    dataset = checked(DatasetStudy, merged(stored, given), "the run's dataset")
    sensing = dataset.sensing if scene is None else as_sensed(dataset.sensing, scene)
    content = dataset.model_copy(update={"sensing": sensing}).model_dump()
    first, last = seeds or SEEDS
    content |= {"scenarios": (scenario,), "seeds": {"first": first, "last": last}}
    content["record"] |= {"tv_rate_hz": card.tv_rate_hz, "uv_rate_hz": card.uv_rate_hz}
    content["sensing"]["channel"] |= {"kind": "link"}
    live = live or LiveSettings()
    streams = live.streams.fitting(card.tv_rate_hz, card.uv_rate_hz)
    chosen_on = development or DEVELOPMENT
    whole = {
        "dataset": content,
        "development": SeedRange(first=chosen_on[0], last=chosen_on[1]).model_dump(),
        "development_h": DEVELOPMENT_H if development is None else None,
        "live": live.model_copy(update={"streams": streams}).model_dump(),
    }
    return checked(LiveStudy, whole, "arguments")


def evaluate_traffic(
    run: Run,
    study: LiveStudy,
    out: Path,
    engine: Engine | None = None,
    feedback: Feedback = SILENT,
    against: Sequence[Run] = (),
    source: MotionSource | None = None,
    alone: Run | None = None,
) -> TrafficEvaluation:
    """Evaluate a run in running traffic, or continue an evaluation, and write `metrics.json`.

    Episodes that are there are kept, also with more seeds or another choice of alarms.
    engine: runs the episodes; the result does not depend on it. against: runs to compare with on the same streams.
    source: of motion; by default, the one that the study names. alone: a run that looks at the TV alone, for TVs
    without a UV.
    Raises InputError if a run has seen a seed, runs have different windows, `alone` looks at the UV, or `out` holds
    something else, RunError if an episode fails.
    """
    source = source or motion_source(study.dataset)
    where = resolved(study.dataset.scenarios[0])
    scenario = source.load(where)
    _check_seeds(source, scenario, study)
    others = [*against, *([] if alone is None else [alone])]
    _check_runs(run, others)
    _check_unseen([run, *others], scenario, study)
    if alone is not None:
        _check_alone(alone)
    timing_of(study, run.card.shape)
    meta = describe(study.dataset, {where: scenario}, source)
    named = _named(run, against)
    cards = {
        "run": run.card.model_dump(mode="json"),
        "against": {name: compared.card.model_dump(mode="json") for name, compared in named.items()},
        "alone": None if alone is None else alone.card.model_dump(mode="json"),
    }
    answers_rest_on = study.model_dump(mode="json", exclude=SCORED_AFTERWARDS)
    with_lanes = study.live.background.lanes
    of_records = [name for name, compared in named.items() if not compared.is_of_streams]
    if alone is not None and not alone.is_of_streams:
        of_records.append("alone")
    installed = versions(OF_EPISODES)
    described = [described.identity for described in meta.scenarios]
    features = [with_lanes and not run.is_of_streams, *FEATURES, *of_records]
    digest = fingerprint(answers_rest_on, described, cards, features, installed)
    predictors = Predictors(
        run.path.resolve(),
        {name: compared.path.resolve() for name, compared in named.items()},
        None if alone is None else alone.path.resolve(),
        with_lanes,
    )
    for remark in source.remarks(scenario):
        feedback.message(remark)
    with claim(out, STUDY_FILE, "evaluation in traffic"):
        _begin(
            out, BegunEvaluation(fingerprint=digest, study=study, versions=installed, inputs=meta.scenarios[0].inputs)
        )
        for line in withheld(scenario.name, scenario):
            feedback.message(line)
        task = EpisodeTask(study, source, where, predictors, digest, (out / EPISODES).resolve())
        study = _run_episodes(task, scenario.name, study, out, engine or LocalEngine(1), feedback)
        evaluated = Evaluated(run, study, out, scenario.name, scenario.lefthand, named, alone)
        evaluation = with_answers(summarise(evaluated, described[0], feedback))
        write_json(out / METRICS_FILE, evaluation.result.model_dump(mode="json"))
    for line in warnings(evaluation.result):
        feedback.message(line)
    return evaluation


def warnings(result: TrafficResult) -> list[str]:
    """Return the warnings that belong to a result, one line each."""
    lines = []
    if not result.vehicle_hours:
        lines.append(
            "warning: no vehicle was predicted: none had a connected leader within range in view of two sites; "
            "all scores are undefined"
        )
    elif not result.over_all.events:
        lines.append("warning: no event counts, so recall is undefined; simulate longer, or more seeds")
    elif result.alarms is None:
        lines.append(
            "warning: no alarm could be chosen, because no vehicle was predicted on the development seeds; give more "
            "of them, or longer ones (--development, --duration)"
        )
    elif result.alarms_keep_to_rate and (result.development_hours or 0.0) < DEVELOPMENT_H - 0.05:
        lines.append(
            f"warning: the alarms were chosen on {result.development_hours:.1f} vehicle-hours; on less than "
            f"{DEVELOPMENT_H:g}, how many false alarms they raise is left to chance: give more --development seeds"
        )
    elif not result.alarms_keep_to_rate:
        rate = result.made_by.study.live.choice.false_alarms_per_vehicle_hour
        lines.append(
            f"warning: no threshold keeps to {rate:g} false alarms per vehicle-hour on the development seeds; the one "
            "with the highest F1 was chosen; simulate more of these seeds"
        )
    return lines


def _check_runs(run: Run, against: Sequence[Run]) -> None:
    """Raise InputError if a compared run needs other windows than the evaluated one."""
    for other in against:
        if (other.card.shape, other.card.settings.windows.window_s) != (
            run.card.shape,
            run.card.settings.windows.window_s,
        ):
            raise InputError(
                f"{other.path}: takes windows of other rates or another length than {run.path}; compare runs of the "
                "same windows"
            )


def _check_alone(alone: Run) -> None:
    """Raise InputError if the answers of a run depend on the UV's reports."""
    if alone.card.settings.streams is not None:
        if alone.card.settings.streams.uv:
            raise InputError(f"{alone.path}: looks at the UV's reports; give a run that was trained with --no-uv")
        return
    card, drawn = alone.card, stream("uv of any kind")
    window_s = card.settings.windows.window_s
    tv, uv = np.zeros((PROBES, 6, card.tv_length)), np.zeros((PROBES, 6, card.uv_length))
    tv[:, 0], tv[:, 2] = np.linspace(0.0, 20.0 * window_s, card.tv_length), 20.0
    # All drive along x, so that the axes of the window do not depend on the UV.
    gap, speed, acceleration = drawn.uniform((5.0, 1.0, -8.0), (100.0, 40.0, 4.0), (PROBES, 3)).T[..., None]
    time_s = np.linspace(-window_s, 0.0, card.uv_length)
    uv[:, 0] = 20.0 * window_s + gap + speed * time_s
    uv[:, 2], uv[:, 4] = speed + acceleration * time_s, acceleration
    infer = Infer(alone, open_set.chosen(alone))
    if np.ptp(infer(tv, uv).probabilities, axis=0).max() > 1e-6:
        raise InputError(
            f"{alone.path}: {card.settings.model} looks at the UV's reports; give a run that was trained with "
            "--model tv-alone"
        )


def _check_seeds(source: MotionSource, scenario: Scenario, study: LiveStudy) -> None:
    """Raise InputError if the source has no recording of a seed."""
    for seeds in (study.development, study.dataset.seeds):
        if missing := sorted(set(seeds) - set(seeds.among(source, scenario))):
            raise InputError(f"{scenario.name}: has no seed {missing[0]}; give other --seeds or --development")


def _check_unseen(runs: Sequence[Run], scenario: Scenario, study: LiveStudy) -> None:
    """Raise InputError if a run was trained or chosen on a seed of the evaluation."""
    for compared in runs:
        seen = {group for side, groups in compared.card.split.items() if side != "test" for group in groups}
        for seed in study.seeds:
            if f"{scenario.name}-{seed}" in seen:
                raise InputError(f"{compared.path}: was trained on seed {seed} of {scenario.name}; give other seeds")


def _named(run: Run, against: Sequence[Run]) -> dict[str, Run]:
    """Return the compared runs under distinct names: with their folders, where several runs have one name."""
    count = Counter(compared.name for compared in (run, *against))
    reserved = (RUN, RULE, RANDOM, SITUATION, TRUTH)
    names = [
        compared.name
        if count[compared.name] == 1 and compared.name not in reserved
        else f"{compared.name}, {compared.path.resolve().name}"
        for compared in against
    ]
    return {
        name if names.count(name) == 1 else f"{name} {k + 1}": compared
        for k, (name, compared) in enumerate(zip(names, against, strict=True))
    }


def _begin(out: Path, begun: BegunEvaluation) -> None:
    """Mark a folder as that of this evaluation. Raises InputError if it holds another evaluation."""
    before = read_json(BegunEvaluation, out / STUDY_FILE)
    if before is not None and before.fingerprint != begun.fingerprint:
        differing = sorted(
            name
            for name in before.versions.keys() | begun.versions.keys()
            if before.versions.get(name) != begun.versions.get(name)
        )
        if differing:
            raise InputError(f"{out}: was begun with other versions of {', '.join(differing)}; choose a new folder")
        if changed := changed_input(before.inputs, begun.inputs):
            raise InputError(f"{out}: {changed} has changed since the evaluation was begun; choose a new folder")
        raise InputError(f"{out}: holds an evaluation of another run or other settings; choose a new folder")
    begin_episodes(out / STUDY_FILE, begun, out / EPISODES)


def _run_episodes(
    task: EpisodeTask, scenario: str, study: LiveStudy, out: Path, engine: Engine, feedback: Feedback
) -> LiveStudy:
    """Run the episodes that a study needs; return it with the development seeds that it needed.

    These are the shortest run of seeds that holds the vehicle-hours, whatever the order in which episodes finish.
    """
    if study.development_h is None:
        _run_seeds(task, scenario, study.seeds, out, engine, feedback)
        return study
    wanted_h, seeds = study.development_h, list(study.development)
    count = min(FIRST_DEVELOPMENT, len(seeds))
    while True:
        _run_seeds(task, scenario, [*seeds[:count], *study.dataset.seeds], out, engine, feedback)
        hours = np.cumsum([predicted_hours(task.folder / file_name(scenario, seed)) for seed in seeds[:count]])
        if hours[-1] >= wanted_h or count == len(seeds) or not hours[-1]:
            break
        count = min(count + int(np.ceil((wanted_h / hours[-1] - 1) * count)), len(seeds))
    last = seeds[min(int(np.searchsorted(hours, wanted_h)), count - 1)]
    return study.model_copy(update={"development": SeedRange(first=seeds[0], last=last)})


def _run_seeds(
    task: EpisodeTask, scenario: str, seeds: Sequence[int], out: Path, engine: Engine, feedback: Feedback
) -> None:
    """Run the episodes of seeds that have no file yet, and write down their processor times."""

    def finished(seed: int) -> bool:
        kinds = (False, True) if task.predictors.alone is not None else (False,)
        facts = [FILES.read_facts(task.folder / file_name(scenario, seed, alone)) for alone in kinds]
        return all(fact is not None and fact.fingerprint == task.fingerprint for fact in facts)

    episodes = Episodes(seeds, finished, "watching traffic", "episodes", lambda seed: f"seed {seed}")
    begun = any(finished(seed) for seed in seeds)
    spent = read_speed(out) if begun else {}

    def keep(seed: int, result: ProcessorTime) -> None:
        spent[str(seed)] = asdict(result)
        write_json(out / SPEED_FILE, dict(sorted(spent.items())))

    run_episodes(task, episodes, engine, feedback, keep)
