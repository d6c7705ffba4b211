"""One episode: the traffic of one scenario and seed, from its recording to the samples of its shard."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from isacsim import sensing
from isacsim.arrays import Array
from isacsim.radio.blockage import blockers_of
from isacsim.scenarios.scenario import Scenario
from isacsim.seeding import stream
from isacsim.traffic import motion
from isacsim.traffic.recording import Recording
from labeling.dataset.dataset import Episode, Sample, Shard, write_shard
from labeling.events import label
from labeling.generation.settings import DatasetStudy, ReportSettings, SelectionSettings
from labeling.intentions import Intention
from labeling.road.surroundings import Surroundings
from labeling.samples.candidates import Candidate, candidates

TOO_MANY = "beyond_cap"
UNSEEN = "too_few_sites"


def shard_of(study: DatasetStudy, scenario: Scenario, recording: Recording, folder: Path, fingerprint: str) -> Shard:
    """Label and sense an episode's recording, and write its shard into a folder.

    fingerprint: of the study, stored in the shard. Raises OutputError where it cannot be written.
    """
    around = Surroundings(recording)
    labels = label(recording, study.labels, around)
    found = candidates(recording, labels, study.pairs, study.record, around, study.motion)
    chosen, surplus = select(found.samples, study.selection, (scenario.name, recording.seed))
    samples, fixes = make_samples(study, scenario, recording, chosen)
    dropped = {TOO_MANY: surplus, UNSEEN: len(chosen) - len(samples)}
    record = study.record
    episode = Episode(
        scenario=scenario.name,
        seed=recording.seed,
        fingerprint=fingerprint,
        events=_by_intention(event.intention for event in labels.events),
        counts=labels.counts,
        left_out={**found.left_out, **{reason: number for reason, number in dropped.items() if number}},
        collided=len(recording.incidents.collided),
        teleported=len(recording.incidents.teleported),
        fix_error_m=[median_error_m(each, sample.tv_truth) for each, sample in zip(fixes, samples, strict=True)],
        state_error_m=[median_error_m(sample.tv, sample.tv_truth) for sample in samples],
    )
    lengths = (round(record.duration_s * record.tv_rate_hz), round(record.duration_s * record.uv_rate_hz))
    return write_shard(folder, samples, episode, *lengths)


def select(
    found: Sequence[Candidate], settings: SelectionSettings, key: tuple[str, int]
) -> tuple[list[Candidate], int]:
    """A class's share of an episode's candidates, drawn evenly where there are more, and how many were left.

    Returns them in the order of onset. key: scenario and seed, which name the draw.
    """
    chosen: list[Candidate] = []
    for intention in Intention:
        of_class = [each for each in found if each.intention is intention]
        cap = settings.following if intention is Intention.FOLLOWING else settings.per_class
        drawn = stream("selection", *key, intention.text).permutation(len(of_class))[:cap]
        chosen += [of_class[k] for k in drawn]
    return sorted(chosen, key=lambda each: (each.t_onset, each.tv, each.intention)), len(found) - len(chosen)


def make_samples(
    study: DatasetStudy, scenario: Scenario, recording: Recording, chosen: Sequence[Candidate]
) -> tuple[list[Sample], list[Array]]:
    """Samples of those chosen candidates that enough sites see, and each one's fused fixes before the filter, (4, S).

    The truth is rounded to float32, as it is stored, before it is sensed, and every draw is named by what the row
    holds: sensing a stored record anew gives the same bytes.
    """
    if not chosen:
        return [], []
    truth = [_states(study, recording, each.tv, each, study.record.tv_rate_hz).astype(np.float32) for each in chosen]
    keys = [record_key(scenario.name, recording.seed, each.tv, each.intention, each.t_start) for each in chosen]
    blockers = None
    if study.sensing.channel.blockage:
        duration_s = study.record.duration_s
        blockers = [blockers_of(recording, each.t_start, each.t_start + duration_s, {each.tv}) for each in chosen]
    sensed = sensing.sense(
        np.stack(truth).astype(np.float64), study.record.tv_rate_hz, scenario.sites, study.sensing, keys, blockers
    )
    samples: list[Sample] = []
    for each, key, true, got in zip(chosen, keys, truth, sensed, strict=True):
        if not got.usable:
            continue
        own = _states(study, recording, each.uv, each, study.record.uv_rate_hz)
        samples.append(
            Sample(
                sample_id=f"{scenario.name}-{recording.seed}-{len(samples)}",
                scenario=scenario.name,
                seed=recording.seed,
                source=study.source,
                tv_id=each.tv,
                uv_id=each.uv,
                intention=each.intention,
                origin=each.origin,
                t_start=each.t_start,
                t_onset=each.t_onset,
                t_commit=each.t_commit,
                t_end=each.t_end,
                sensor="isac",
                snr_db=got.snr_db,
                n_sites=got.n_sites,
                tv=got.state.astype(np.float32),
                tv_truth=true,
                uv=report(own, study.report, key),
            )
        )
    return samples, [got.fixes for got in sensed if got.usable]


def record_key(scenario: str, seed: int, tv: str, intention: Intention, t_start: float) -> tuple[str | int, ...]:
    """Names the draws of one record, the same when it is sensed anew. t_start: s."""
    return scenario, seed, tv, intention.text, f"{t_start:.6f}"


def median_error_m(state: npt.NDArray[np.floating[Any]], truth: npt.NDArray[np.float32]) -> float:
    """Median over a record of the distance between positions, the first two rows of each, m, to the micrometre."""
    return round(float(np.median(np.hypot(*(state[:2].astype(np.float64) - truth[:2])))), 6)


def report(state: Array, settings: ReportSettings, key: tuple[str | int, ...]) -> npt.NDArray[np.float32]:
    """What the UV reports of its own state, float32, (6, n): the truth with the settings' white noise.

    state: true state, (6, n). key: names the draw.
    """
    return np.asarray(state + report_noise(state.shape[1], settings, key), np.float32)


def report_noise(count: int, settings: ReportSettings, key: tuple[str | int, ...]) -> Array:
    """Noise of a UV's `count` reports, (6, count). key: as in `report`; the same key gives the same noise."""
    sd = np.repeat([settings.position_sd_m, settings.speed_sd_mps, settings.acceleration_sd_mps2], 2)
    return np.asarray(stream("report", *key).standard_normal((6, count)) * sd[:, None])


def _states(study: DatasetStudy, recording: Recording, vehicle: str, each: Candidate, rate_hz: float) -> Array:
    """True states of a vehicle over a candidate's record, (6, duration x rate)."""
    times = each.t_start + np.arange(round(study.record.duration_s * rate_hz)) / rate_hz
    return motion.states(recording, recording.tracks[vehicle], times, study.motion)


def _by_intention(found: Iterable[Intention]) -> dict[str, int]:
    counted = Counter(found)
    return {intention.text: counted[intention] for intention in Intention if counted[intention]}
