"""One episode, the traffic of one scenario and seed: from its recording to the samples of its shard."""

from __future__ import annotations

import gc
import importlib
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from isac_cosim.base.arrays import Array, Float32Array
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.sensing.following import run_in, run_in_snapshots
from isac_cosim.isacsim.sensing.passages import Carrier, Passage, SensedRecord
from isac_cosim.isacsim.sensing.reports import report
from isac_cosim.isacsim.sensing.sensors import SENSORS, Watch
from isac_cosim.isacsim.traffic import motion
from isac_cosim.isacsim.traffic.recordings.recording import LabelledRecording, Recording
from isac_cosim.labeling.dataset.dataset import Episode, Sample, Shard, write_shard
from isac_cosim.labeling.dataset.pull_outs import write_dropped_pull_outs
from isac_cosim.labeling.dataset.record_point import in_plane, point_near, relative
from isac_cosim.labeling.dataset.shard import TRACK
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.generation.selection import Draw, draw_of_pull_outs, draws, select
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.generation.watching import watch_episode
from isac_cosim.labeling.intentions import Intention
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.samples.candidates import Candidate, candidates
from isac_cosim.labeling.samples.generated_labels import agreement_counts, generated_candidates

TOO_MANY = "beyond_cap"


@cache
def ready() -> None:
    """Prepare a process for episodes; only the first call does anything.

    Loads what labelling imports late. What modules hold is then left out by the cyclic garbage collector: each full
    round through it would take a third as long as labelling an episode.
    """
    importlib.import_module("scipy.signal")
    gc.collect()
    gc.freeze()


def shard_of(study: DatasetStudy, scenario: Scenario, recording: Recording, folder: Path, fingerprint: str) -> Shard:
    """Label and sense an episode's recording, write its shard into a folder, and return the shard's entry.

    folder: of the dataset's shards; dropped pull-outs go into a folder beside it. fingerprint: of the study; it is
    stored in the shard. Raises OutputError if the shard cannot be written.
    """
    around = Surroundings(recording)
    labels = label(recording, study.labels, around)
    counts = labels.counts
    if isinstance(recording, LabelledRecording):
        available = generated_candidates(recording, study.record, study.motion, around)
        counts = {**counts, **agreement_counts(recording, labels)}
    else:
        available = candidates(recording, labels, study.pairs, study.record, around, study.motion)
    key = scenario.name, recording.seed
    sensor = watch_episode(study, scenario, recording.seed, recording)
    made = make_samples(study, recording, draws(available.samples, study.selection, key), sensor)
    pull_outs = draw_of_pull_outs(available.dropped_pull_outs, study.selection, key)
    dropped_samples = make_samples(study, recording, [pull_outs], sensor, "p").samples
    dropped = {TOO_MANY: made.surplus, sensor.unusable: made.unseen}
    record = study.record
    episode = Episode(
        scenario=scenario.name,
        seed=recording.seed,
        fingerprint=fingerprint,
        events=_by_intention(event.intention for event in labels.events),
        counts=counts,
        left_out={**available.left_out, **{reason: number for reason, number in dropped.items() if number}},
        collided=len(recording.incidents.collided),
        teleported=len(recording.incidents.teleported),
        fix_error_m=made.fix_error_m if SENSORS[sensor.name].filtered else (),
        state_error_m=[median_error_m(sample.tv, sample.tv_truth) for sample in made.samples],
        traffic=recording.facts,
        scene=sensor.scene_scores,
    )
    run_in_s = study.sensing.tracking.run_in_s
    lengths = (
        round(record.duration_s * record.tv_rate_hz),
        round(record.duration_s * record.uv_rate_hz),
        round(run_in_s * record.tv_rate_hz),
    )
    # Before the shard, which holds its digest: a shard that exists is complete.
    dropped_shard = write_dropped_pull_outs(folder.parent, dropped_samples, episode, lengths)
    return write_shard(folder, made.samples, episode, *lengths, dropped_shard)


@dataclass(frozen=True)
class Made:
    """The samples that were made of candidates, by onset, with the errors of their fixes before the filter, m.

    unseen, surplus: as in `labeling.generation.selection.Selection`.
    """

    samples: list[Sample]
    fix_error_m: list[float]
    unseen: int
    surplus: int


def make_samples(
    study: DatasetStudy, recording: Recording, drawn: Sequence[Draw], sensor: Watch, mark: str = ""
) -> Made:
    """Sense candidates in their drawn order until there are enough of them, and make samples of those that are seen.

    sensor: watches the recording. mark: what the numbers in their ids begin with.
    """
    selected = select(drawn, partial(_sensed, study, recording, sensor))
    ids = (f"{recording.scenario}-{recording.seed}-{mark}{k}" for k in range(len(selected.made)))
    samples = [replace(sample, sample_id=name) for name, (_, (sample, _)) in zip(ids, selected.made, strict=True)]
    return Made(samples, [error for _, (_, error) in selected.made], selected.unseen, selected.surplus)


def _sensed(
    study: DatasetStudy, recording: Recording, sensor: Watch, chosen: Sequence[Candidate]
) -> list[tuple[Sample, float] | None]:
    """Sense some candidates; return for each its sample, without id, and the error of its fixes before the filter, m.

    None stands for those that the sensor cannot follow.
    The truth is rounded to float32 before it is sensed, because it is stored so, and every random draw is named by
    values that the row holds. Therefore sensing a stored record anew gives the same bytes.
    """
    rate_hz = study.record.tv_rate_hz
    driven = [_states(study, recording, candidate.tv, candidate, rate_hz) for candidate in chosen]
    points = [point_near(*states[:2, 0].tolist()) for states in driven]
    truth = [relative(states, point) for states, point in zip(driven, points, strict=True)]
    past = [relative(_past(study, recording, one), point) for one, point in zip(chosen, points, strict=True)]
    keys = [
        record_key(recording.scenario, recording.seed, candidate.tv, candidate.intention, candidate.t_start)
        for candidate in chosen
    ]
    passages = [
        Passage(
            tv=candidate.tv,
            start_s=candidate.t_start,
            truth=in_plane(states, *point),
            key=key,
            past=in_plane(earlier, *point),
            find_carrier=partial(_carrier, study, recording, candidate, key),
        )
        for candidate, states, earlier, key, point in zip(chosen, truth, past, keys, points, strict=True)
    ]
    sensed = sensor.record(passages)
    made: list[tuple[Sample, float] | None] = []
    for candidate, key, point, tv_truth, tv_run_in, record in zip(
        chosen, keys, points, truth, past, sensed, strict=True
    ):
        if not record.usable:
            made.append(None)
            continue
        uv_truth = _states(study, recording, candidate.uv, candidate, study.record.uv_rate_hz)
        sample = Sample(
            sample_id="",
            scenario=recording.scenario,
            seed=recording.seed,
            source=study.source,
            tv_id=candidate.tv,
            uv_id=candidate.uv,
            intention=candidate.intention,
            origin=candidate.provenance.origin,
            cause=candidate.provenance.cause,
            cause_ttc_s=candidate.provenance.cause_ttc_s,
            t_start=candidate.t_start,
            t_onset=candidate.t_onset,
            t_commit=candidate.t_commit,
            t_end=candidate.t_end,
            **_passing(candidate),
            sensor=sensor.name,
            snr_db=record.snr_db,
            n_sites=record.n_sites,
            x0=point[0],
            y0=point[1],
            tv_departed=recording.tracks[candidate.tv].departed,
            **track_columns(record),
            tv=relative(record.state, point),
            tv_truth=tv_truth,
            uv=relative(report(uv_truth, study.report, key), point),
            tv_run_in=tv_run_in,
        )
        made.append((sample, median_error_m(relative(record.fixes, point), tv_truth)))
    return made


def _passing(candidate: Candidate) -> dict[str, Any]:
    """Return the columns of a sample that say whether and when the TV passes the UV."""
    pull_out = candidate.pull_out
    if pull_out is None:
        return {}
    return {"pull_out": pull_out.outcome, "t_pass": pull_out.t_pass, "t_pair_end": pull_out.t_pair_end}


def track_columns(record: SensedRecord) -> dict[str, Any]:
    """Return the columns of a sample that say which track stands for the TV."""
    if record.track is None:
        return {"track_id": "", "right_share": nan, "breaks": 0, "position_sd_m": nan}
    return {name: getattr(record.track, name) for name in TRACK}


def record_key(scenario: str, seed: int, tv: str, intention: Intention, t_start: float) -> tuple[str | int, ...]:
    """Return the key that names the random draws of one record; it stays the same when the record is sensed anew.

    t_start: start of the record, s.
    """
    return scenario, seed, tv, intention.text, f"{t_start:.6f}"


def median_error_m(state: Float32Array, truth: Float32Array) -> float:
    """Return the median distance of a record's positions from the true ones, m, rounded to the micrometre.

    state: (4, S) or (6, S), positions in the first two rows. truth: (6, S). Both as they are stored, m.
    """
    return round(float(np.median(np.hypot(*(state[:2].astype(np.float64) - truth[:2])))), 6)


def _states(study: DatasetStudy, recording: Recording, vehicle: str, candidate: Candidate, rate_hz: float) -> Array:
    """Return a vehicle's true states over a candidate's record, (6, duration x rate), m, m/s and m/s2."""
    times = candidate.t_start + np.arange(round(study.record.duration_s * rate_hz)) / rate_hz
    return motion.states(recording, recording.tracks[vehicle], times, study.motion)


def _past(study: DatasetStudy, recording: Recording, candidate: Candidate) -> Array:
    """Return a TV's true states in the run-in before its record, (6, R), m, m/s and m/s2.

    Before its track begins, they are the track's first state carried back.
    """
    rate_hz, track = study.record.tv_rate_hz, recording.tracks[candidate.tv]
    count = run_in_snapshots(rate_hz, study.sensing.tracking)
    times = candidate.t_start + np.arange(-count, 1) / rate_hz
    known = motion.states(recording, track, times[times >= recording.times(track)[0]], study.motion)
    return run_in(known[:, -1:], rate_hz, count, known[:, :-1])


def _carrier(study: DatasetStudy, recording: Recording, candidate: Candidate, key: tuple[str | int, ...]) -> Carrier:
    """Return the motion of a candidate's UV, as it is and as the UV reports it."""
    state, noise = _states(study, recording, candidate.uv, candidate, study.record.uv_rate_hz), study.report
    reported = report(state, noise, key).astype(np.float64)
    sd = noise.position_sd_m, noise.speed_sd_mps
    return Carrier(state, study.record.uv_rate_hz, reported, *sd, vehicles=(candidate.uv,))


def _by_intention(intentions: Iterable[Intention]) -> dict[str, int]:
    """Return how often each intention occurs, in the order of the labels."""
    counted = Counter(intentions)
    return {intention.text: counted[intention] for intention in Intention if counted[intention]}
