"""Runs a study of streams, from its scenario to a live evaluation.

    OUT/study.json    the study, with all defaults filled in
    OUT/streams/      the streams
    OUT/run/          the trained predictor
    OUT/floor/        the situation trees that it is compared with, unless it is these
    OUT/live/         the live evaluation

Each part resumes where it stopped.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.workers.engine import Engine
from isac_cosim.evaluation.in_traffic.measurement.evaluation import evaluate_traffic, study_of
from isac_cosim.evaluation.in_traffic.measurement.stress import with_stress
from isac_cosim.evaluation.in_traffic.measurement.summary import TrafficEvaluation
from isac_cosim.evaluation.in_traffic.settings import DEVELOPMENT_H, LiveSettings
from isac_cosim.evaluation.report.live.live_figures import draw_live_figures
from isac_cosim.isacsim.traffic.sources.registry import source_class
from isac_cosim.labeling.generation.settings import SeedRange
from isac_cosim.labeling.streams.cost_estimate import PREDICTED_S, estimate
from isac_cosim.labeling.streams.generate import generate_streams
from isac_cosim.models.training.on_streams import train_on_streams
from isac_cosim.studies.single import claim_study
from isac_cosim.studies.study import Study

STREAMS, LIVE = "streams", "live"
"""Folders of the results."""


def run_live_study(study: Study, out: Path, engine: Engine, feedback: Feedback = SILENT) -> TrafficEvaluation:
    """Generate streams, train on them, evaluate live and draw the figures; return the evaluation.

    Raises InputError where the folder holds something else or another study, or a part of it is at fault.
    """
    with claim_study(out, study):
        streams = generate_streams(study.dataset, out / STREAMS, engine, feedback)
        run = train_on_streams(streams, out / "run", study.training, feedback)
        floor = study.stream_floor
        against = [] if floor is None else [train_on_streams(streams, out / "floor", floor, feedback)]
        live, scenario, source = study.live, study.dataset.scenarios[0], study.dataset.source
        chosen = (run.card, scenario, _ends(live.seeds), None if live.development is None else _ends(live.development))
        worlds = source_class(source).natural is not None
        settings = LiveSettings.model_validate({"streams": {"truth": live.truth}})
        natural = study_of(*chosen, live=settings, natural=worlds, source=source)
        evaluation = evaluate_traffic(run, natural, out / LIVE, engine, feedback, against)
        if live.stress:
            stressed = study_of(*chosen, live=settings, source=source)
            evaluation = with_stress(evaluation, run, stressed, out / LIVE, engine, feedback, against)
        draw_live_figures(evaluation, out / LIVE)
    return evaluation


@dataclass(frozen=True)
class LiveEstimate:
    """What a study of streams costs, at default sizes. cpu_s: processor time, s. bytes: size of the streams on disk."""

    episodes: int
    vehicle_hours: float
    evaluated_hours: float
    cpu_s: float
    bytes: int


def estimate_live(study: Study) -> LiveEstimate | None:
    """Return roughly what a study of streams costs; None where recordings have a length of their own."""
    streams = estimate(study.dataset)
    if streams is None:
        return None
    per_episode_h, live = streams.vehicle_hours / streams.episodes, study.live
    measured = len(live.seeds)
    developed = DEVELOPMENT_H / per_episode_h
    if live.development is not None:
        developed = len(live.development)
    evaluated = (measured + developed) * (2 if live.stress else 1)
    hours, watching_s = evaluated * per_episode_h, streams.cpu_s / streams.episodes
    cpu_s = streams.cpu_s + evaluated * watching_s + hours * PREDICTED_S
    return LiveEstimate(streams.episodes, streams.vehicle_hours, round(hours, 1), round(cpu_s, 1), streams.bytes)


def _ends(seeds: SeedRange) -> tuple[int, int]:
    return seeds.first, seeds.last
