"""Runs one episode of an evaluation in traffic: records, labels, senses and predicts it. Worker processes do this."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError
from isac_cosim.base.workers.threads import limited
from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.evaluation.in_traffic.streams.predictions import (
    AlongAnswering,
    Answering,
    Answers,
    WindowCutter,
    answering_of,
    lanes_of,
    rule_answer,
)
from isac_cosim.evaluation.in_traffic.streams.store import (
    RULE,
    RUN,
    TRUTH,
    EpisodeFacts,
    LiveEpisode,
    file_name,
    no_answers,
    write_episode,
)
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.sensing.sensors import Watch
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource, recorded
from isac_cosim.labeling.detectors.events import Labels, label
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.generation.watching import watch_episode
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.streams.events import events_of, groups_at
from isac_cosim.labeling.streams.reports import NoReports, Reports
from isac_cosim.labeling.streams.sensed import SensedStretch, StretchSensing
from isac_cosim.labeling.streams.stretches import Stretch, Timing, WatchedStretches, watched
from isac_cosim.models.data.lane_map import LaneMap
from isac_cosim.models.data.windows import OnMap
from isac_cosim.models.inference import Infer
from isac_cosim.models.predictors.protocol import WindowShape


@dataclass(frozen=True)
class Predictors:
    """The predictors of an evaluation.

    run: folder of the evaluated run. against: folders of the runs to compare with, by their names in the result.
    alone: folder of the run for TVs without a UV, if any. with_lanes: whether the features of runs that were trained on
    records include those of the lane; runs of streams see the lanes themselves.
    """

    run: Path
    against: Mapping[str, Path]
    alone: Path | None = None
    with_lanes: bool = False

    def answering(self, truth: bool, decision_s: float) -> tuple[Infer, dict[str, Answering]]:
        """Return the run, and the predictors' functions by name.

        truth: whether the run also answers true motion. decision_s: time between decisions, s.
        """
        infer = _load(self.run)
        by_run = answering_of(infer, decision_s, self.with_lanes)
        answering: dict[str, Answering] = {RUN: by_run, RULE: rule_answer}
        if truth:
            answering[TRUTH] = by_run
        for name, path in self.against.items():
            answering[name] = answering_of(_load(path), decision_s, self.with_lanes)
        return infer, answering


@lru_cache(maxsize=32)
def _load(path: Path) -> Infer:
    return Infer.load(path)


@dataclass(frozen=True)
class ProcessorTime:
    """Processor time of an episode, s, by purpose.

    predicting_s: of the evaluated run. comparing_s: of the other predictors. simulated_s: recorded time. predicted_s:
    time with predictions, all vehicles together.
    """

    seed: int
    traffic_s: float
    labels_s: float
    sensing_s: float
    predicting_s: float
    comparing_s: float
    simulated_s: float
    predicted_s: float


@dataclass(frozen=True)
class EpisodeTask:
    """Runs the episodes of an evaluation. Worker processes receive it.

    source: of motion. where: path or bundled name of the scenario. folder: of the episodes' files.
    """

    study: LiveStudy
    source: MotionSource
    where: str
    predictors: Predictors
    fingerprint: str
    folder: Path

    @limited()
    def __call__(self, seed: int) -> ProcessorTime:
        """Run one episode and write its file."""
        began = time.process_time()
        scenario = self.source.load(self.where)
        recording = recorded(self.source, scenario, seed)
        traffic_s = time.process_time() - began
        streams = predicted(self.study, scenario, recording, self.predictors, self.fingerprint)
        if streams.alone is not None:
            write_episode(self.folder / file_name(scenario.name, seed, alone=True), streams.alone)
        write_episode(self.folder / file_name(scenario.name, seed), streams.episode)
        return replace(streams.spent, traffic_s=traffic_s)


def timing_of(study: LiveStudy, shape: WindowShape) -> Timing:
    """Return the times around a prediction.

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
                f"{name} {seconds:g} s is not a whole number of samples at the run's {rate_hz:g} Hz; choose another"
            )
    return Timing(
        decision_s=streams.decision_s,
        window_s=max(shape.tv_length / shape.tv_rate_hz, shape.uv_length / shape.uv_rate_hz),
        report_delay_s=streams.report_delay_s,
        run_in_s=study.dataset.sensing.tracking.run_in_s,
        margin_s=record.margin_s,
        outcome_s=streams.outcome_s,
        longest_stretch_s=streams.longest_stretch_s,
    )


@dataclass
class _Collected:
    """The predictions of an episode, in the order in which they are made.

    answers: batches of answers, by predictor. covered_m: distance driven while predicted, m. answering_s: processor
    time of all predictors, s. predicting_s: that of the evaluated run alone, s.
    """

    tv: list[str] = field(default_factory=list)
    time_s: list[float] = field(default_factory=list)
    answers: dict[str, list[Answers]] = field(default_factory=lambda: defaultdict(list))
    covered_m: float = 0.0
    answering_s: float = 0.0
    predicting_s: float = 0.0

    def add(
        self, track: SensedStretch, cutter: WindowCutter, answering: Mapping[str, Answering], lanes: LaneMap
    ) -> None:
        """Predict a track."""
        stretch = track.stretch
        self.tv += [stretch.tv] * len(stretch.decision_s)
        self.time_s += stretch.decision_s.tolist()
        ends = np.rint((stretch.decision_s - stretch.start_s) * cutter.shape.tv_rate_hz).astype(np.int64)
        self.covered_m += float(np.hypot(*track.truth[2:4, ends]).sum()) * cutter.decision_s
        sensed, true = ([name for name in answering if (name == TRUTH) is of_truth] for of_truth in (False, True))
        for known, all_names in ((track, sensed), (track.true, true)):
            names = []
            for name in all_names:
                along = answering[name]
                if isinstance(along, AlongAnswering):
                    self._add(name, partial(along.along, known, cutter, lanes))
                else:
                    names.append(name)
            for tv, uv in cutter.batches(known) if names else ():
                windows = OnMap.in_one(tv, uv, cutter.shape.tv_rate_hz, lanes)
                for name in names:
                    self._add(name, partial(answering[name], windows))

    def _add(self, name: str, answer: Callable[[], Answers]) -> None:
        began = time.process_time()
        self.answers[name].append(answer())
        spent_s = time.process_time() - began
        self.answering_s += spent_s
        self.predicting_s += spent_s if name == RUN else 0.0

    def episode(self, facts: EpisodeFacts, recording: Recording, predictors: Sequence[str]) -> LiveEpisode:
        """Return the episode, vehicle by vehicle and in order of time. predictors: names of all predictors."""
        names = tuple(sorted(set(self.tv)))
        number = {name: k for k, name in enumerate(names)}
        vehicle, time_s = np.array([number[name] for name in self.tv], np.int64), np.array(self.time_s, np.float64)
        order = np.lexsort((time_s, vehicle))
        vehicle, time_s = vehicle[order], time_s[order]
        group = np.zeros(len(time_s), np.int64)
        for name, k in number.items():
            group[vehicle == k] = groups_at(recording, name, time_s[vehicle == k])
        joined = {name: Answers.joined(batches) for name, batches in self.answers.items()}
        answers = joined or no_answers(predictors)
        return LiveEpisode(
            facts, names, vehicle, time_s, group, {name: part.take(order) for name, part in answers.items()}
        )

    def decisions(self) -> dict[str, Array]:
        """Return the instants at which each vehicle was predicted, s, in order."""
        by_vehicle: dict[str, list[float]] = defaultdict(list)
        for name, time_s in zip(self.tv, self.time_s, strict=True):
            by_vehicle[name].append(time_s)
        return {name: np.sort(np.array(times)) for name, times in by_vehicle.items()}


@dataclass(frozen=True)
class EpisodeAnswers:
    """The answers of predictors in one recording.

    episode: for TVs with a UV. alone: for TVs without a UV; None if there is no predictor for them. spent: processor
    time.
    """

    episode: LiveEpisode
    alone: LiveEpisode | None
    spent: ProcessorTime


def predicted(
    study: LiveStudy, scenario: Scenario, recording: Recording, predictors: Predictors, fingerprint: str = ""
) -> EpisodeAnswers:
    """Label a recording, and sense and predict its vehicles."""
    infer, answering = predictors.answering(study.live.streams.truth, study.live.streams.decision_s)
    began = time.process_time()
    timing, surroundings = timing_of(study, infer.run.card.shape), Surroundings(recording)
    labels = label(recording, study.dataset.labels, surroundings, study.live.near_misses)
    driving = watched(recording, surroundings, study.dataset.pairs, timing)
    labelled = time.process_time()
    name, settings = study.live.streams.sensor, study.sensor_settings
    sensor = watch_episode(study.dataset, scenario, recording.seed, recording, name, settings)
    watching = _Watching(study.dataset, scenario.name, recording, sensor, surroundings, labels, timing, fingerprint)
    episode, collected = watching.predict(driving.stretches, driving, infer.run.card.shape, answering)
    watched_s = time.process_time() - labelled
    spent = ProcessorTime(
        seed=recording.seed,
        traffic_s=0.0,
        labels_s=labelled - began,
        sensing_s=watched_s - collected.answering_s,
        predicting_s=collected.predicting_s,
        comparing_s=collected.answering_s - collected.predicting_s,
        simulated_s=recording.lasts_s,
        predicted_s=len(collected.time_s) * timing.decision_s,
    )
    alone = None
    if predictors.alone is not None:
        by_itself = _load(predictors.alone)
        answering = {RUN: answering_of(by_itself, timing.decision_s, predictors.with_lanes, with_uv=False)}
        alone, _ = watching.predict(driving.alone, driving, by_itself.run.card.shape, answering, alone=True)
    return EpisodeAnswers(episode, alone, spent)


@dataclass(frozen=True)
class _Watching:
    """A labelled recording whose vehicles are sensed and predicted."""

    study: DatasetStudy
    scenario: str
    recording: Recording
    sensor: Watch
    surroundings: Surroundings
    labels: Labels
    timing: Timing
    fingerprint: str

    def predict(
        self,
        stretches: Sequence[Stretch],
        driving: WatchedStretches,
        shape: WindowShape,
        answering: Mapping[str, Answering],
        alone: bool = False,
    ) -> tuple[LiveEpisode, _Collected]:
        """Sense and predict stretches. alone: whether they have no UV."""
        timing = self.timing
        sensing = StretchSensing(self.study, self.recording, self.sensor, timing.before_decision_s)
        reports = NoReports() if alone else Reports(sensing)
        cutter = WindowCutter(reports, self.study, shape, timing.report_delay_s, timing.decision_s)
        lanes, collected = lanes_of(self.recording), _Collected()
        for track in sensing.tracks(stretches):
            collected.add(track, cutter, answering, lanes)
        uncovered = {**({} if alone else driving.uncovered), **sensing.uncovered}
        events = events_of(self.surroundings, self.labels, self.study, collected.decisions(), timing.decision_s, alone)
        facts = EpisodeFacts(
            fingerprint=self.fingerprint,
            scenario=self.scenario,
            seed=self.recording.seed,
            decision_s=timing.decision_s,
            simulated_s=self.recording.lasts_s,
            vehicles=len(self.recording.tracks),
            instants=driving.instants,
            uncovered={reason: uncovered[reason] for reason in sorted(uncovered) if uncovered[reason]},
            covered_km=round(collected.covered_m / 1000, 6),
            events=tuple(events),
        )
        return collected.episode(facts, self.recording, list(answering)), collected
