"""One episode of an evaluation in traffic, in a worker process: recorded, labelled, watched and predicted."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from isacsim.errors import InputError, OutputError
from isacsim.scenarios.scenario import Scenario
from isacsim.traffic.motion_sources import MotionSource
from isacsim.traffic.recording import Recording
from labeling.events import label
from labeling.road.surroundings import Surroundings
from models.inference import Infer
from models.live.events import events_of, under_command
from models.live.predictions import Answering, Answers, Reports, WindowCutter, lanes_of, rule_answering, run_answering
from models.live.sensed import Sensing
from models.live.settings import LiveStudy
from models.live.store import RULE, RUN, EpisodeFacts, LiveEpisode, file_name, no_answers, write_episode
from models.live.stretches import Timing, watched
from models.predictors.protocol import WindowShape

ANY_WINDOW = 1


@dataclass(frozen=True)
class Predictors:
    """The predictors of an evaluation.

    run: folder of the evaluated run. against: folders of the runs it is compared with, by their names in the result.
    """

    run: Path
    against: Mapping[str, Path]

    def answering(self) -> tuple[Infer, dict[str, Answering]]:
        """Return the run, and how each predictor answers, by name."""
        infer = _load(self.run)
        shape = infer.run.card.shape
        answering = {RUN: run_answering(infer), RULE: rule_answering(infer.run.card.settings.windows, shape)}
        return infer, answering | {name: run_answering(_load(path)) for name, path in self.against.items()}


@lru_cache(maxsize=8)
def _load(path: Path) -> Infer:
    return Infer.load(path)


@dataclass(frozen=True)
class Spent:
    """Processor time of an episode, s, by what it was spent on; predicted_s: time for which vehicles were predicted."""

    seed: int
    traffic_s: float
    labels_s: float
    sensing_s: float
    predicting_s: float
    simulated_s: float
    predicted_s: float


@dataclass(frozen=True)
class EpisodeTask:
    """Runs the episodes of an evaluation; it is sent to worker processes.

    source: where motion comes from. where: path or bundled name of the scenario. folder: where episodes are written.
    """

    study: LiveStudy
    source: MotionSource
    where: str
    predictors: Predictors
    fingerprint: str
    folder: Path

    def __call__(self, seed: int) -> Spent | InputError | OutputError:
        """Run one episode and write it. An error that a retry would not fix is returned, not raised."""
        try:
            begin = time.process_time()
            scenario = self.source.load(self.where)
            recording = self.source.record(scenario, seed)
            episode, spent = predicted(self.study, scenario, recording, self.predictors, self.fingerprint, begin)
            write_episode(self.folder / file_name(scenario.name, seed), episode)
            return spent
        except (InputError, OutputError) as error:
            return error


def timing_of(study: LiveStudy, shape: WindowShape) -> Timing:
    """Return the times that a prediction needs.

    Raises InputError if the instants of prediction are not sampling instants of both streams.
    """
    streams, record = study.live.streams, study.dataset.record
    for name, rate_hz, seconds in (
        ("decision_s", shape.tv_rate_hz, streams.decision_s),
        ("decision_s", shape.uv_rate_hz, streams.decision_s),
        ("report_delay_s", shape.uv_rate_hz, streams.report_delay_s),
    ):
        if abs(seconds * rate_hz - round(seconds * rate_hz)) > 1e-6:
            raise InputError(
                f"{name} {seconds:g} s is no whole number of samples at the run's {rate_hz:g} Hz; choose another one"
            )
    return Timing(
        decision_s=streams.decision_s,
        window_s=max(shape.tv_length / shape.tv_rate_hz, shape.uv_length / shape.uv_rate_hz),
        report_delay_s=streams.report_delay_s,
        run_in_s=study.dataset.sensing.tracking.run_in_s,
        margin_s=record.margin_s,
        longest_stretch_s=streams.longest_stretch_s,
    )


def predicted(
    study: LiveStudy,
    scenario: Scenario,
    recording: Recording,
    predictors: Predictors,
    fingerprint: str = "",
    begin: float | None = None,
) -> tuple[LiveEpisode, Spent]:
    """Label a recording, watch its vehicles, and predict them.

    begin: processor time at which the episode began, s. Returns the episode and what it took.
    """
    clock = [time.process_time() if begin is None else begin, time.process_time()]
    infer, answering = predictors.answering()
    shape = infer.run.card.shape
    timing, surroundings = timing_of(study, shape), Surroundings(recording)
    labels = label(recording, study.dataset.labels, surroundings)
    driving = watched(recording, surroundings, study.dataset.pairs, timing)
    clock.append(time.process_time())
    sensing = Sensing(study.dataset, scenario, recording, timing.before_decision_s)
    cutter = WindowCutter(Reports(sensing), study.dataset, shape, timing.report_delay_s)
    lanes = lanes_of(recording)
    parts: dict[str, list[Answers]] = defaultdict(list)
    tv: list[str] = []
    times: list[float] = []
    covered_m, predicting_s, answering_s = 0.0, 0.0, 0.0
    for track in sensing.tracks(driving.stretches):
        stretch = track.stretch
        tv += [stretch.tv] * len(stretch.decision_s)
        times += stretch.decision_s.tolist()
        ends = np.rint((stretch.decision_s - stretch.start_s) * shape.tv_rate_hz).astype(np.int64)
        covered_m += float(np.hypot(*track.truth[2:4, ends]).sum()) * timing.decision_s
        for windows in cutter.batches(track):
            began = time.process_time()
            for name, answer in answering.items():
                parts[name].append(answer(*windows, lanes))
                if name == RUN:  # the first
                    predicting_s += time.process_time() - began
            answering_s += time.process_time() - began
    clock.append(time.process_time())
    names = tuple(sorted(set(tv)))
    number = {name: k for k, name in enumerate(names)}
    vehicle, time_s = np.array([number[name] for name in tv], np.int64), np.array(times, np.float64)
    order = np.lexsort((time_s, vehicle))
    answers = {name: Answers.joined(batches) for name, batches in parts.items()} or no_answers(
        list(answering), ANY_WINDOW
    )
    vehicle, time_s = vehicle[order], time_s[order]
    by_name = {name: time_s[vehicle == k] for name, k in number.items()}
    commanded = np.zeros(len(time_s), dtype=bool)
    for name, k in number.items():
        commanded[vehicle == k] = under_command(recording, name, by_name[name])
    facts = EpisodeFacts(
        fingerprint=fingerprint,
        scenario=scenario.name,
        seed=recording.seed,
        decision_s=timing.decision_s,
        simulated_s=study.dataset.traffic.duration_s,
        vehicles=len(recording.tracks),
        instants=driving.instants,
        uncovered=dict(sorted({**driving.uncovered, **{k: n for k, n in sensing.uncovered.items() if n}}.items())),
        covered_km=round(covered_m / 1000, 6),
        events=tuple(events_of(surroundings, labels, study.dataset, by_name, timing.decision_s)),
    )
    ordered = {
        name: Answers(part.probabilities[order], part.score[order], part.features[order])
        for name, part in answers.items()
    }
    spent = Spent(
        seed=recording.seed,
        traffic_s=clock[1] - clock[0],
        labels_s=clock[2] - clock[1],
        sensing_s=clock[3] - clock[2] - answering_s,
        predicting_s=predicting_s,
        simulated_s=study.dataset.traffic.duration_s,
        predicted_s=len(time_s) * timing.decision_s,
    )
    return LiveEpisode(facts, names, vehicle, time_s, commanded, ordered), spent
