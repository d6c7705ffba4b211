"""Generates a dataset of streams: watches every episode, senses its stretches once, and stores them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np

from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.files import claim, file_digest, remove_partial
from isac_cosim.base.settings import read_json, write_sealed
from isac_cosim.base.workers.engine import Engine, LocalEngine
from isac_cosim.base.workers.episodes import Episodes, run_episodes
from isac_cosim.base.workers.threads import limited
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource, recorded
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.dataset.dataset import ROADS, road_digests, write_roads
from isac_cosim.labeling.dataset.record_point import point_near, relative
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.generation.episode_plan import EpisodeJob, Jobs
from isac_cosim.labeling.generation.folder import fingerprint
from isac_cosim.labeling.generation.generate import describe, read_scenarios
from isac_cosim.labeling.generation.log import withheld
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.generation.watching import watch_episode
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.streams.dataset import META_FILE, Streams, StreamsMeta
from isac_cosim.labeling.streams.events import events_of
from isac_cosim.labeling.streams.reports import Reports
from isac_cosim.labeling.streams.sensed import SensedStretch, StretchSensing
from isac_cosim.labeling.streams.settings import StreamDatasetSettings
from isac_cosim.labeling.streams.store import (
    EVENTS,
    FILES,
    STRETCHES,
    StoredStretch,
    StreamFacts,
    file_name,
    write_stretches,
)
from isac_cosim.labeling.streams.stretches import Timing, watched


def generate_streams(
    study: DatasetStudy,
    out: Path,
    engine: Engine | None = None,
    feedback: Feedback = SILENT,
    source: MotionSource | None = None,
    settings: StreamDatasetSettings | None = None,
) -> Streams:
    """Generate the streams of a study in a folder, or finish them if they have been begun there, and open them.

    engine: runs the episodes; the bytes do not depend on it. source: where motion comes from; by default, the one that
    the study names.
    Raises InputError if the study, a scenario or the folder is at fault, RunError if episodes fail.
    """
    settings, source, record = settings or StreamDatasetSettings(), source or motion_source(study), study.record
    stretches = settings.stretches.fitting(record.tv_rate_hz, record.uv_rate_hz)
    settings = settings.model_copy(update={"stretches": stretches})
    scenarios = read_scenarios(study, source)
    described = describe(study, scenarios, source)
    started = StreamsMeta(
        complete=False,
        fingerprint=fingerprint(described.fingerprint, settings.model_dump(mode="json")),
        study=described.study,
        settings=settings,
        versions=described.versions,
        scenarios=described.scenarios,
    )
    jobs = list(Jobs(tuple((w, place.name, study.seeds.among(source, place)) for w, place in scenarios.items())))
    with claim(out, META_FILE, "dataset of streams"):
        before = read_json(StreamsMeta, out / META_FILE)
        if before is not None and before.fingerprint != started.fingerprint:
            raise InputError(f"{out}: holds streams of another study, other inputs or versions; choose another folder")
        for name in (STRETCHES, EVENTS, ROADS):
            (out / name).mkdir(exist_ok=True)
            remove_partial(out / name, "*.parquet")
        if before is None:
            write_sealed(out / META_FILE, started)
        for (where, scenario), scenario_meta in zip(scenarios.items(), started.scenarios, strict=True):
            for line in (*withheld(where, scenario), *scenario_meta.remarks):
                feedback.message(line)
            write_roads(out, scenario.name, scenario.lanes)
        _run(_Task(study, settings, source, started.fingerprint, out.resolve()), jobs, engine, feedback)
        names = [f"{folder}/{file_name(job.scenario, job.seed)}" for folder in (STRETCHES, EVENTS) for job in jobs]
        files = {name: file_digest(out / name) for name in names}
        roads = road_digests(out, [scenario.name for scenario in scenarios.values()])
        files |= {f"{ROADS}/{name}": digest for name, digest in roads.items()}
        write_sealed(out / META_FILE, started.model_copy(update={"complete": True, "files": files}))
    return Streams.open(out)


def _run(task: _Task, jobs: Sequence[EpisodeJob], engine: Engine | None, feedback: Feedback) -> None:
    """Run the episodes that have no file yet. Raises RunError after all, if some failed."""

    def finished(job: EpisodeJob) -> bool:
        facts = FILES.read_facts(task.folder / STRETCHES / file_name(job.scenario, job.seed))
        return facts is not None and facts.fingerprint == task.fingerprint

    advice = ", and other --seeds leave them out"
    episodes = Episodes(jobs, finished, "watching traffic", "episodes", _name_of, advice)
    run_episodes(task, episodes, engine or LocalEngine(1), feedback)


def _name_of(job: EpisodeJob) -> str:
    return f"{job.scenario}, seed {job.seed}"


@dataclass(frozen=True)
class _Task:
    """Watches one episode and writes its files. Worker processes receive it. folder: of the streams."""

    study: DatasetStudy
    settings: StreamDatasetSettings
    source: MotionSource
    fingerprint: str
    folder: Path

    @limited()
    def __call__(self, job: EpisodeJob) -> None:
        scenario = self.source.load(job.where)
        recording = recorded(self.source, scenario, job.seed)
        facts, stretches = streams_of(self.study, self.settings, scenario, recording, self.fingerprint)
        write_stretches(self.folder, facts, stretches)


def streams_of(
    study: DatasetStudy,
    settings: StreamDatasetSettings,
    scenario: Scenario,
    recording: Recording,
    mark: str = "",
) -> tuple[StreamFacts, list[StoredStretch]]:
    """Return the streams of a recording, sensed, with the facts of its episode. mark: fingerprint of the dataset."""
    timing, surroundings = timing_of(study, settings), Surroundings(recording)
    labels = label(recording, study.labels, surroundings, settings.near_misses)
    driving = watched(recording, surroundings, study.pairs, timing)
    sensor = watch_episode(study, scenario, recording.seed, recording)
    sensing = StretchSensing(study, recording, sensor, timing.before_decision_s)
    reports = Reports(sensing)
    stored: list[StoredStretch] = []
    decisions: dict[str, list[float]] = {}
    for track in sensing.tracks(driving.stretches):
        stored.append(_stored(track, study, timing, reports))
        decisions.setdefault(track.stretch.tv, []).extend(track.stretch.decision_s.tolist())
    when = {vehicle: np.sort(np.array(times)) for vehicle, times in decisions.items()}
    uncovered = {**driving.uncovered, **sensing.uncovered}
    facts = StreamFacts(
        fingerprint=mark,
        scenario=scenario.name,
        seed=recording.seed,
        decision_s=timing.decision_s,
        simulated_s=recording.lasts_s,
        instants=driving.instants,
        decisions=sum(map(len, decisions.values())),
        uncovered={reason: uncovered[reason] for reason in sorted(uncovered) if uncovered[reason]},
        scene=sensor.scene_scores,
        events=tuple(events_of(surroundings, labels, study, when, timing.decision_s)),
    )
    return facts, stored


def timing_of(study: DatasetStudy, settings: StreamDatasetSettings) -> Timing:
    """Return the times around a decision."""
    stretches = settings.stretches
    return Timing(
        decision_s=stretches.decision_s,
        window_s=settings.window_s,
        report_delay_s=stretches.report_delay_s,
        run_in_s=study.sensing.tracking.run_in_s,
        margin_s=study.record.margin_s,
        outcome_s=stretches.outcome_s,
        longest_stretch_s=stretches.longest_stretch_s,
    )


def _stored(track: SensedStretch, study: DatasetStudy, timing: Timing, reports: Reports) -> StoredStretch:
    """Return a sensed stretch as it is stored."""
    stretch, rate_hz = track.stretch, study.record.uv_rate_hz
    point = point_near(*track.truth[:2, 0].tolist())
    segments = list(_segments(stretch.uv, stretch.decision_s.tolist()))
    numbers = np.repeat(np.arange(len(segments)), [len(times) for _, times in segments])
    first, uv = [], []
    for name, times in segments:
        ends = [round((time - timing.report_delay_s) * rate_hz) for time in (times[0], times[-1])]
        length = ends[1] - ends[0] + round(timing.window_s * rate_hz)
        first.append(ends[1] + 1 - length)
        uv.append(relative(reports.window(name, times[-1] - timing.report_delay_s, length), point))
    return StoredStretch(
        tv_id=stretch.tv,
        start_s=stretch.start_s,
        point=point,
        n_sites=track.n_sites,
        tv=relative(track.state, point),
        tv_truth=relative(track.truth, point),
        decision_s=stretch.decision_s,
        segment=numbers,
        uv_id=tuple(name for name, _ in segments),
        uv_first=tuple(first),
        uv=tuple(uv),
        track=track.track,
    )


def _segments(uvs: Sequence[str], times: Sequence[float]) -> Iterator[tuple[str, list[float]]]:
    """Yield the runs of decisions with the same UV: its name, and their instants, s."""
    for name, run in groupby(zip(uvs, times, strict=True), lambda pair: pair[0]):
        yield name, [time for _, time in run]
