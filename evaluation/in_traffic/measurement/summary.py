"""Puts the result of an evaluation together: alarms chosen on the development seeds, measured on the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from math import isfinite
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.versions import OF_EPISODES, versions
from isac_cosim.base.workers.threads import limited
from isac_cosim.evaluation.in_traffic.alarms.background import TREES_FOLDER, KeptTrees
from isac_cosim.evaluation.in_traffic.measurement import measuring
from isac_cosim.evaluation.in_traffic.measurement.headline import headlines
from isac_cosim.evaluation.in_traffic.measurement.measuring import MeasuredAlarms
from isac_cosim.evaluation.in_traffic.scores.curves import recall_lost
from isac_cosim.evaluation.in_traffic.scores.five_classes import as_five
from isac_cosim.evaluation.in_traffic.scores.results import (
    AloneResult,
    Coverage,
    FiveClassResult,
    Headlines,
    Latency,
    LiveMadeBy,
    TrafficResult,
    TruthResult,
)
from isac_cosim.evaluation.in_traffic.scores.scoring import Truth
from isac_cosim.evaluation.in_traffic.settings import LiveSettings, LiveStudy, Method
from isac_cosim.evaluation.in_traffic.streams.episode import ProcessorTime
from isac_cosim.evaluation.in_traffic.streams.store import (
    EPISODES,
    RULE,
    RUN,
    SPEED_FILE,
    TRUTH,
    LiveEpisode,
    file_name,
    read_episode,
)
from isac_cosim.isacsim.sensing.running.conditioning import TRAILING_REACH
from isac_cosim.isacsim.traffic.motion import REACH
from isac_cosim.labeling.generation.settings import SeedRange
from isac_cosim.models.runs.run import Run

RANDOM = "random"
SITUATION = "situation"
"""The names of the baselines that are always there, beside RULE: alarms at random, and trees on the situation."""
BASELINE_NAMES = {RULE: "rule of the road", SITUATION: "trees on the situation"}
"""How people call them."""
Beside = dict[str, tuple[str, Sequence[Method]]]
"""What a run is compared with: its name in the episodes, and the kinds of alarm that it can raise, by its name."""

_SPEED = TypeAdapter(dict[str, ProcessorTime])
"""The content of SPEED_FILE."""


@dataclass(frozen=True)
class TrafficEvaluation:
    """An evaluation in traffic: its result, and what its figures show.

    truths: of the measured episodes. methods: the run's kinds of alarm, the better one first. baselines: by name.
    true_motion: the better kind of alarm where the run answers true motion; None if it does not.
    real_time_factor: simulated time over processor time for ten vehicles; None if no vehicle was watched.
    """

    result: TrafficResult
    truths: tuple[Truth, ...]
    methods: dict[Method, MeasuredAlarms]
    baselines: dict[str, MeasuredAlarms]
    true_motion: MeasuredAlarms | None
    real_time_factor: float | None


@dataclass(frozen=True)
class Evaluated:
    """A run with the episodes in which it was evaluated.

    out: folder of the evaluation. scenario: its name. lefthand: whether traffic keeps left. against: the compared
    runs by their names in the episodes. alone: the run for TVs without a UV, if any.
    """

    run: Run
    study: LiveStudy
    out: Path
    scenario: str
    lefthand: bool
    against: Mapping[str, Run] = field(default_factory=dict)
    alone: Run | None = None

    @cached_property
    def kept(self) -> KeptTrees:
        """The trees of the evaluation."""
        return KeptTrees(self.out / TREES_FOLDER)

    def truths(self, seeds: SeedRange, alone: bool = False) -> list[Truth]:
        """Read the episodes of some seeds, ready for scoring. alone: whether to read those of driving without a UV."""
        paths = [self.out / EPISODES / file_name(self.scenario, seed, alone) for seed in seeds]
        episodes = [read_episode(path, features=True) for path in paths]
        return measuring.truths_of(episodes, self.study.live.scoring)


@limited()
def summarise(evaluated: Evaluated, described: Any, feedback: Feedback = SILENT) -> TrafficEvaluation:
    """Choose alarms on the development seeds, measure them on the others, and put the result together.

    described: description of the scenario for the result.
    """
    run, study, live = evaluated.run, evaluated.study, evaluated.study.live
    development, measured = evaluated.truths(study.development), evaluated.truths(study.dataset.seeds)
    true_motion = dict[Method, MeasuredAlarms]()
    with feedback.bar("choosing alarms", "predictors") as move:
        total = 4 + live.streams.truth + (evaluated.alone is not None)
        kinds = methods_of(run)
        methods = measuring.measure_methods(development, measured, RUN, live, run.name, kinds, evaluated.kept)
        first = next(iter(methods.values()), measuring.no_alarms(measured, live, run.name))
        move(1, total, "baselines")
        baselines = {RANDOM: measuring.measure_random(measured, first, live)}
        beside = _beside(evaluated)
        baselines |= (compared := _compared(development, measured, evaluated, beside))
        beside |= {
            name: (beside[name][0], [of.result.alarms.method])
            for name, of in compared.items()
            if of.result.alarms is not None
        }
        move(2, total, "overtakes as lane changes")
        method = next(iter(methods), None)
        chosen_on, asked_of = (
            [as_five(truth, evaluated.lefthand, live.scoring.before_onset_s) for truth in truths]
            for truths in (development, measured)
        )
        five_classes = _five_classes(chosen_on, asked_of, evaluated, method, beside)
        move(3, total, "what an operator asks")
        asked = _headlines(chosen_on, asked_of, evaluated, method, beside)
        if live.streams.truth:
            move(4, total, "true motion")
            name = f"{run.name} on true motion"
            true_motion = measuring.measure_methods(development, measured, TRUTH, live, name, kinds, evaluated.kept)
        if evaluated.alone is not None:
            move(total - 1, total, "without a UV")
        alone = None if evaluated.alone is None else _alone(evaluated, evaluated.alone)
        evaluated.kept.remove_others()
        move(total, total)
    episodes = [truth.episode for truth in measured]
    result = TrafficResult(
        **dict(first.result),
        model=run.card.settings.model,
        scenario=evaluated.scenario,
        vehicle_hours=sum(episode.vehicle_hours for episode in episodes),
        development_hours=sum(truth.episode.vehicle_hours for truth in development),
        coverage=_coverage(episodes),
        latency=_latency(study),
        events_left_out=_left_out(episodes),
        methods={name: measurement.result for name, measurement in methods.items()},
        baselines={name: measurement.result for name, measurement in baselines.items()},
        truth=_truth(true_motion, methods, live) if live.streams.truth else None,
        alone=alone,
        five_classes=five_classes,
        **dict(asked.pop(RUN)),
        compared=asked,
        made_by=LiveMadeBy(
            study=study,
            scenario=described,
            development=[f"{evaluated.scenario}-{seed}" for seed in study.development],
            seeds=[f"{evaluated.scenario}-{seed}" for seed in study.dataset.seeds],
            run=run.card,
            against={name: compared.card for name, compared in evaluated.against.items()},
            versions=versions(OF_EPISODES),
        ),
    )
    return TrafficEvaluation(
        result=result,
        truths=tuple(measured),
        methods=methods,
        baselines=baselines,
        true_motion=next((true_motion.get(method) for method in methods), None),
        real_time_factor=real_time_factor(read_speed(evaluated.out)),
    )


def methods_of(run: Run) -> tuple[Method, ...]:
    """Return the kinds of alarm that a run can raise."""
    return measuring.OF_STREAMS if run.is_of_streams else measuring.OF_RECORDS


def _beside(evaluated: Evaluated) -> Beside:
    """Return what a run is compared with.

    The trees on the situation learn from the development seeds, as the other kinds of alarm of a run do that was
    trained on records. Beside a run that was trained on streams they are left out: compare it with a run of `--model
    situation`.
    """
    beside: Beside = {RULE: (RULE, ["reject"])}
    beside |= {name: (name, methods_of(run)) for name, run in evaluated.against.items()}
    return beside if evaluated.run.is_of_streams else {**beside, SITUATION: (RULE, ["background"])}


def _compared(
    development: Sequence[Truth], measured: Sequence[Truth], evaluated: Evaluated, beside: Beside
) -> dict[str, MeasuredAlarms]:
    """Measure what a run is compared with, each by its kind of alarm that is better on the development seeds."""
    compared = dict[str, MeasuredAlarms]()
    for name, (predictor, kinds) in beside.items():
        shown, live, kept = BASELINE_NAMES.get(name, name), evaluated.study.live, evaluated.kept
        of_kinds = measuring.measure_methods(development, measured, predictor, live, shown, kinds, kept)
        if of_kinds:
            compared[name] = next(iter(of_kinds.values()))
    return compared


def _five_classes(
    development: Sequence[Truth],
    measured: Sequence[Truth],
    evaluated: Evaluated,
    method: Method | None,
    beside: Beside,
) -> FiveClassResult | None:
    """Return the result with overtakes as lane changes; None without a kind of alarm. Truths: with five intentions."""
    if method is None:
        return None
    run, live = evaluated.run, evaluated.study.live
    of_run = measuring.measure_methods(development, measured, RUN, live, run.name, [method], evaluated.kept)
    if method not in of_run:
        return None
    baselines = _compared(development, measured, evaluated, beside)
    return FiveClassResult(
        **dict(of_run[method].result),
        baselines={name: baseline.result for name, baseline in baselines.items()},
    )


def _headlines(
    development: Sequence[Truth],
    measured: Sequence[Truth],
    evaluated: Evaluated,
    method: Method | None,
    beside: Beside,
) -> dict[str, Headlines]:
    """Return what an operator asks, answered by the run (RUN), by what it is compared with, and on true motion.

    method: the run's kind of alarm; None if it raises none. Truths: with five intentions.
    """
    run, live, kept = evaluated.run, evaluated.study.live, evaluated.kept
    asked: dict[str, tuple[str, Method]] = {name: (predictor, of[0]) for name, (predictor, of) in beside.items()}
    if method is not None:
        asked[RUN] = (RUN, method)
        if live.streams.truth:
            asked[f"{run.name} on true motion"] = (TRUTH, method)
    answers = {
        name: headlines(development, measured, predictor, live, of_predictor, kept)
        for name, (predictor, of_predictor) in asked.items()
    }
    return {RUN: Headlines(prediction=None, recognition=None), **answers}


def _truth(
    true_motion: Mapping[Method, MeasuredAlarms], sensed: Mapping[Method, MeasuredAlarms], live: LiveSettings
) -> TruthResult:
    """Return the result on true motion, and what sensing costs with the kind of alarm that the run uses."""
    method = next(iter(sensed), None)
    pair = [] if method is None else [of[method].sweep for of in (true_motion, sensed) if method in of]
    sweeps = [sweep for sweep in pair if sweep is not None]
    return TruthResult(
        methods={name: measurement.result for name, measurement in true_motion.items()},
        method=method,
        lost=[] if len(sweeps) < 2 else recall_lost(sweeps[0], sweeps[1], live.scoring),
    )


def _alone(evaluated: Evaluated, run: Run) -> AloneResult:
    """Return the result of the run that needs no UV, for TVs without one."""
    study, live = evaluated.study, evaluated.study.live
    development = evaluated.truths(study.development, alone=True)
    measured = evaluated.truths(study.dataset.seeds, alone=True)
    kinds = methods_of(run)
    methods = measuring.measure_methods(development, measured, RUN, live, run.name, kinds, evaluated.kept)
    first = next(iter(methods.values()), measuring.no_alarms(measured, live, run.name))
    episodes = [truth.episode for truth in measured]
    instants = sum(episode.facts.instants for episode in episodes)
    return AloneResult(
        **dict(first.result),
        model=run.card.settings.model,
        share=sum(len(episode.time_s) for episode in episodes) / instants if instants else None,
        vehicle_hours=sum(episode.vehicle_hours for episode in episodes),
        events_left_out=_left_out(episodes),
        methods={name: measurement.result for name, measurement in methods.items()},
        baselines={RANDOM: measuring.measure_random(measured, first, live).result},
        run=run.card,
    )


def read_speed(out: Path) -> dict[str, Any]:
    """Return the processor times of the episodes by seed, empty if the file is missing or damaged."""
    try:
        rows = _SPEED.validate_json((out / SPEED_FILE).read_bytes())
    except (OSError, ValueError):
        return {}
    content = {seed: asdict(row) for seed, row in rows.items()}
    return content if all(isfinite(value) for row in content.values() for value in row.values()) else {}


def real_time_factor(spent: dict[str, Any], vehicles: int = 10) -> float | None:
    """Return simulated over processor time for sensing and predicting some vehicles at once on one core.

    spent: the content of SPEED_FILE. Returns None if no vehicle was predicted.
    """
    cpu_s = sum(row["sensing_s"] + row["predicting_s"] for row in spent.values())
    predicted_s = sum(row["predicted_s"] for row in spent.values())
    return round(predicted_s / cpu_s / vehicles, 2) if predicted_s and cpu_s else None


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
        closed_loop_s=TRAILING_REACH * width_s,
        report_delay_s=study.live.streams.report_delay_s,
    )


def _left_out(episodes: Sequence[LiveEpisode]) -> dict[str, int]:
    """Return the number of neutral events, by reason."""
    reasons = Counter(event.left_out for episode in episodes for event in episode.facts.events)
    return {reason: reasons[reason] for reason in sorted(reason for reason in reasons if reason is not None)}
