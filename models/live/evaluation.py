"""Evaluates a run in running traffic: runs the episodes, chooses alarms, measures them, and writes `metrics.json`.

DIR/study.json        what is evaluated, so that the same command continues it
DIR/episodes/         one file for each seed: every answer, and the events
DIR/metrics.json      the result; the same for any number of worker processes
DIR/speed.json        how long it took
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from isacsim.errors import InputError, OutputError, RunError
from isacsim.feedback import SILENT, Feedback
from isacsim.files import claim, remove_partial, write_json
from isacsim.scenarios.scenario import Scenario
from isacsim.settings import Settings, checked, read_json
from isacsim.traffic.director import LEFT_ALONE
from isacsim.traffic.motion import REACH
from isacsim.traffic.motion_sources import MotionSource, motion_source
from isacsim.versions import OF_RUNS, versions
from labeling.generation.engine import Engine, LocalEngine
from labeling.generation.folder import fingerprint
from labeling.generation.generate import describe
from labeling.generation.settings import DatasetStudy, SeedRange
from models.live import measuring
from models.live.background import Background
from models.live.episode import EpisodeTask, Predictors, Spent, timing_of
from models.live.measuring import Chosen, Measured
from models.live.results import METRICS_FILE, Coverage, Latency, LiveMadeBy, TrafficResult
from models.live.scoring import Truth
from models.live.settings import LiveSettings, LiveStudy
from models.live.store import RULE, RUN, LiveEpisode, file_name, read_episode, read_facts
from models.run import Run, RunCard

STUDY_FILE, SPEED_FILE, EPISODES = "study.json", "speed.json", "episodes"
CLOSED_LOOP_REACH = 4.0
"""Half-width of the conditioning kernel for a closed loop, in standard deviations; the weight beyond is 6e-5."""
RANDOM = "random"
SEEDS, DEVELOPMENT = (1001, 1004), (2001, 2004)
"""The seeds that are measured, and those on which alarms are chosen, where none are given; training uses lower ones."""


class _Begun(Settings):
    """The content of STUDY_FILE."""

    fingerprint: str
    study: LiveStudy


@dataclass(frozen=True)
class TrafficEvaluation:
    """An evaluation in traffic: its result, and what the figures are drawn from.

    truths: of the measured episodes. methods: the run's kinds of alarm, the better one first. baselines: by name.
    real_time_factor: simulated time over processor time for ten vehicles; None if no vehicle was watched.
    """

    result: TrafficResult
    truths: tuple[Truth, ...]
    methods: dict[str, Measured]
    baselines: dict[str, Measured]
    real_time_factor: float | None


def study_of(
    card: RunCard,
    scenario: str,
    seeds: tuple[int, int] | None = None,
    development: tuple[int, int] | None = None,
    duration_s: float | None = None,
    live: LiveSettings | None = None,
    natural: bool = False,
) -> LiveStudy:
    """Return the evaluation of a run in a scenario, by the settings of the dataset that it was trained on.

    Traffic, labels, pairs and reports are as there; sensing uses the link budget, at the rates of the run. A dataset
    whose study is not known stands for the defaults. seeds, development: first and last. duration_s: of each episode.
    natural: drivers are left alone: no causes, commands or disturbances.
    Raises InputError where an argument is wrong.
    """
    try:
        base = DatasetStudy.model_validate(card.dataset.get("study", {}))
    except ValidationError:
        base = DatasetStudy()
    content = base.model_dump()
    first, last = seeds or SEEDS
    content |= {"scenarios": (scenario,), "seeds": {"first": first, "last": last}, "source": "sumo"}
    content["record"] |= {"tv_rate_hz": card.tv_rate_hz, "uv_rate_hz": card.uv_rate_hz}
    content["sensing"]["channel"] |= {"kind": "link"}
    if natural:
        content["maneuvers"] |= LEFT_ALONE
    if duration_s is not None:
        content["traffic"] |= {"duration_s": duration_s}
    chosen_on = development or DEVELOPMENT
    whole = {
        "dataset": content,
        "development": SeedRange(first=chosen_on[0], last=chosen_on[1]).model_dump(),
        "live": (live or LiveSettings()).model_dump(),
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
) -> TrafficEvaluation:
    """Evaluate a run in running traffic, or finish an evaluation that was begun, and write `metrics.json`.

    engine: runs the episodes; the result does not depend on it. against: runs to compare with on the same streams.
    source: where motion comes from; by default, SUMO.
    Raises InputError if the run has seen a seed, runs have different windows, or `out` holds something else, RunError
    if an episode fails.
    """
    source = source or motion_source(study.dataset)
    where = study.dataset.scenarios[0]
    where = str(Path(where).resolve()) if Path(where).exists() else where
    scenario = source.load(where)
    _check_runs(run, against)
    _check_unseen([run, *against], scenario, study)
    timing_of(study, run.card.shape)
    meta = describe(study.dataset, {where: scenario})
    cards = [compared.card.model_dump(mode="json") for compared in (run, *against)]
    digest = fingerprint(study.model_dump(mode="json"), [s.model_dump(mode="json") for s in meta.scenarios], cards)
    predictors = Predictors(
        run.path.resolve(), {name: compared.path.resolve() for name, compared in _named(against).items()}
    )
    with claim(out, STUDY_FILE, "evaluation in traffic"):
        _begin(out, _Begun(fingerprint=digest, study=study))
        task = EpisodeTask(study, source, where, predictors, digest, (out / EPISODES).resolve())
        _run_missing(task, scenario.name, study.seeds, out, engine or LocalEngine(1), feedback)
        evaluation = _measured(run, study, scenario, out, meta.scenarios[0].model_dump(mode="json"), predictors)
        write_json(out / METRICS_FILE, evaluation.result.model_dump(mode="json"))
    for line in warnings(evaluation.result):
        feedback.message(line)
    return evaluation


def warnings(result: TrafficResult) -> list[str]:
    """Return what a reader of the result should know, a line each."""
    lines = []
    if not result.vehicle_hours:
        lines.append(
            "warning: no vehicle was predicted: none had a connected leader within range in view of two sites; "
            "all scores are undefined"
        )
    elif not result.over_all.events:
        lines.append("warning: no event counts: recall is undefined; simulate longer, or more seeds")
    elif not result.alarms_keep_to_rate:
        rate = result.made_by.study.live.choice.false_alarms_per_vehicle_hour
        lines.append(
            f"warning: no alarms keep to {rate:g} false alarms per vehicle-hour on the development seeds; those chosen "
            "have the highest F1 there; simulate more of these seeds"
        )
    return lines


def _check_runs(run: Run, against: Sequence[Run]) -> None:
    """Raise InputError if a compared run takes other windows than the evaluated one."""
    for other in against:
        if (other.card.shape, other.card.settings.windows.window_s) != (
            run.card.shape,
            run.card.settings.windows.window_s,
        ):
            raise InputError(
                f"{other.path}: takes windows of other rates or another length than {run.path}; compare runs of the "
                "same windows"
            )


def _check_unseen(runs: Sequence[Run], scenario: Scenario, study: LiveStudy) -> None:
    """Raise InputError if a run was trained or chosen on a seed of the evaluation."""
    for compared in runs:
        seen = {group for side, groups in compared.card.split.items() if side != "test" for group in groups}
        for seed in study.seeds:
            if f"{scenario.name}-{seed}" in seen:
                raise InputError(f"{compared.path}: was trained on seed {seed} of {scenario.name}; give other seeds")


def _named(runs: Sequence[Run]) -> dict[str, Run]:
    """Return compared runs by distinct names."""
    count = Counter(compared.name for compared in runs)
    return {
        compared.name
        if count[compared.name] == 1 and compared.name not in (RUN, RULE, RANDOM)
        else f"{compared.name} {k + 1}": compared
        for k, compared in enumerate(runs)
    }


def _begin(out: Path, begun: _Begun) -> None:
    """Mark a folder as that of this evaluation. Raises InputError if it holds another one."""
    before = read_json(_Begun, out / STUDY_FILE)
    if before is not None and before.fingerprint != begun.fingerprint:
        raise InputError(f"{out}: holds an evaluation of another run or other settings; choose a new folder")
    write_json(out / STUDY_FILE, begun.model_dump(mode="json"))
    (out / EPISODES).mkdir(exist_ok=True)
    remove_partial(out / EPISODES, "*.parquet")


def _run_missing(
    task: EpisodeTask, scenario: str, seeds: Sequence[int], out: Path, engine: Engine, feedback: Feedback
) -> None:
    """Run the episodes that have no file yet."""

    def finished(seed: int) -> bool:
        facts = read_facts(task.folder / file_name(scenario, seed))
        return facts is not None and facts.fingerprint == task.fingerprint

    missing = [seed for seed in seeds if not finished(seed)]
    if not missing:
        return
    done, lost = len(seeds) - len(missing), []
    spent = {} if done == 0 else _read_speed(out)
    with feedback.bar("watching traffic", "seeds") as move:
        move(done, len(seeds))
        with closing(engine.run(task, missing)) as outcomes:
            for outcome in outcomes:
                if isinstance(outcome.result, InputError | OutputError):
                    raise outcome.result
                if isinstance(outcome.result, Spent):
                    spent[str(outcome.item)] = asdict(outcome.result)
                    write_json(out / SPEED_FILE, dict(sorted(spent.items())))
                else:
                    lost.append(f"seed {outcome.item}: {outcome.error}")
                done += 1
                move(done, len(seeds))
    if lost:
        raise RunError(f"{len(lost)} of {len(seeds)} episodes failed, {lost[0]}; the same command tries them again")


def _read_speed(out: Path) -> dict[str, Any]:
    """Return what earlier episodes of an interrupted evaluation took, by seed."""
    try:
        content: dict[str, Any] = json.loads((out / SPEED_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content


def real_time_factor(spent: dict[str, Any], vehicles: int = 10) -> float | None:
    """Return simulated over processor time of sensing and predicting so many vehicles at once on one core.

    spent: of each seed, as SPEED_FILE holds it. None if no vehicle was predicted.
    """
    cpu_s = sum(row["sensing_s"] + row["predicting_s"] for row in spent.values())
    predicted_s = sum(row["predicted_s"] for row in spent.values())
    return round(predicted_s / cpu_s / vehicles, 2) if predicted_s and cpu_s else None


def _measured(
    run: Run, study: LiveStudy, scenario: Scenario, out: Path, described: Any, predictors: Predictors
) -> TrafficEvaluation:
    """Choose alarms on the development seeds, measure them on the others, and put the result together."""
    before_onset_s = study.live.scoring.before_onset_s

    def truths(seeds: SeedRange) -> list[Truth]:
        paths = [out / EPISODES / file_name(scenario.name, seed) for seed in seeds]
        return measuring.truths_of([read_episode(path, features=True) for path in paths], before_onset_s)

    development, measured = truths(study.development), truths(study.dataset.seeds)
    background = Background.fit([truth.episode for truth in development], study.live.background, before_onset_s)
    choice = study.live.choice
    options = {"reject": measuring.choose_reject(development, RUN, choice)}
    if background is not None:
        options["background"] = measuring.choose_background(development, choice, study.live)
    chosen: dict[str, Chosen] = {name: option for name, option in options.items() if option is not None}
    methods: dict[str, Measured] = {}
    for name in sorted(chosen, key=lambda name: chosen[name].rank, reverse=True):
        levels = measuring.levels_of(measured, RUN, chosen[name].alarms, background)
        methods[name] = measuring.measure(measured, levels, chosen[name], study.live, run.name)
    first = next(iter(methods.values()), measuring.no_alarms(measured, study.live, run.name))
    baselines = {RANDOM: measuring.measure_random(measured, first, study.live)}
    for name in (RULE, *predictors.against):
        option = measuring.choose_reject(development, name, choice)
        if option is not None:
            levels = measuring.levels_of(measured, name, option.alarms, None)
            shown = "rule of the road" if name == RULE else name
            baselines[name] = measuring.measure(measured, levels, option, study.live, shown)
    episodes = [truth.episode for truth in measured]
    result = TrafficResult(
        **dict(first.result),
        model=run.card.settings.model,
        scenario=scenario.name,
        vehicle_hours=sum(episode.vehicle_hours for episode in episodes),
        coverage=_coverage(episodes),
        latency=_latency(study),
        events_left_out=_left_out(episodes),
        methods={name: measurement.result for name, measurement in methods.items()},
        baselines={name: measurement.result for name, measurement in baselines.items()},
        made_by=LiveMadeBy(
            study=study,
            scenario=described,
            development=[f"{scenario.name}-{seed}" for seed in study.development],
            seeds=[f"{scenario.name}-{seed}" for seed in study.dataset.seeds],
            run=run.card,
            versions=versions((*OF_RUNS, "libsumo", "scipy")),
        ),
    )
    return TrafficEvaluation(result, tuple(measured), methods, baselines, real_time_factor(_read_speed(out)))


def _coverage(episodes: Sequence[LiveEpisode]) -> Coverage:
    uncovered: Counter[str] = Counter()
    for episode in episodes:
        uncovered.update(episode.facts.uncovered)
    instants = sum(episode.facts.instants for episode in episodes)
    predicted = sum(len(episode.time_s) for episode in episodes)
    driving_h = sum(episode.facts.instants * episode.facts.decision_s for episode in episodes) / 3600
    return Coverage(
        share=predicted / instants if instants else None,
        uncovered={reason: count / instants for reason, count in sorted(uncovered.items())},
        vehicle_hours=sum(episode.vehicle_hours for episode in episodes),
        driving_hours=driving_h,
        km=sum(episode.facts.covered_km for episode in episodes),
    )


def _latency(study: LiveStudy) -> Latency:
    width_s = study.dataset.motion.width_s
    return Latency(
        conditioning_reach_s=REACH * width_s,
        closed_loop_s=CLOSED_LOOP_REACH * width_s,
        report_delay_s=study.live.streams.report_delay_s,
    )


def _left_out(episodes: Sequence[LiveEpisode]) -> dict[str, int]:
    """Return the number of neutral events, by reason."""
    reasons = Counter(event.left_out for episode in episodes for event in episode.facts.events)
    return {reason: reasons[reason] for reason in sorted(reason for reason in reasons if reason is not None)}
