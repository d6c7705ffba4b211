"""The records of a dataset sensed anew: another channel, estimator or sensor over the same motion.

A dataset holds the true motion of its TVs, what its UVs reported, and the sites; sensing needs no more, but for the
other vehicles that blockage and a line of sight ask for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from isacsim.errors import InputError, OutputError, RunError
from isacsim.feedback import SILENT, Feedback, Move
from isacsim.onboard_radar import Carrier, RadarSettings, sense_onboard
from isacsim.scenarios.scenario import Site
from isacsim.sensing import TOGETHER, SensedRecord, SensingSettings, sense
from isacsim.settings import Settings, checked
from isacsim.versions import OF_DATASETS, versions
from labeling.dataset.dataset import SHARDS, Dataset, Meta, Sample, Shard, write_roads, write_shard
from labeling.dataset.shard import read_samples
from labeling.generation import log
from labeling.generation.engine import Engine, LocalEngine
from labeling.generation.episode import UNSEEN, median_error_m, record_key
from labeling.generation.folder import claimed, existing_shards, fingerprint, finish
from labeling.generation.log import Note

UNDETECTED = "not_detected"
"""Why a record is left out that the radar never saw before it began."""
REPEAT = "-r"
"""What stands in a sample's id before the number of its repeat."""


class ResenseSettings(Settings):
    """How records are sensed anew."""

    sensor: Literal["isac", "radar", "truth"] = Field(
        "isac", description="the sites; the UV's own radar; neither: the true state"
    )
    sensing: SensingSettings = SensingSettings()
    radar: RadarSettings = RadarSettings()
    records: int | None = Field(
        None,
        ge=1,
        description="records to sense, the dataset's over and over with new noise; its own number when absent",
    )


@dataclass(frozen=True)
class Job:
    """One shard to sense anew: all its records `times` over, and the first `more` of them once more."""

    shard: Shard
    times: int
    more: int

    @property
    def records(self) -> int:
        return self.times * self.shard.samples + self.more


def own_sensing(dataset: Dataset) -> SensingSettings:
    """The sensing settings that a dataset was made with."""
    return checked(SensingSettings, dataset.meta.study.get("sensing", {}), dataset.path)


def resense(
    dataset: Dataset,
    settings: ResenseSettings,
    out: Path,
    engine: Engine | None = None,
    feedback: Feedback = SILENT,
) -> Dataset:
    """Sense a dataset's records anew into another folder, or finish it where it was begun, and open it.

    With a dataset's own settings its `tv` comes out the same, to the bit. Records that the sensor cannot use are left
    out, and counted in their episode. engine: what senses the shards, one worker process when absent; the samples do
    not depend on it. feedback: where progress is reported.
    Raises InputError where settings, dataset or folder are at fault, RunError where a shard fails.
    """
    _check(dataset, settings, out)
    started = _describe(dataset, settings)
    jobs = plan(dataset.meta.shards, settings.records)
    made: dict[str, Shard] = {}
    roads = {scenario.name: dataset.roads(scenario.name) for scenario in dataset.meta.scenarios}
    with claimed(out, started):
        for name, lanes in roads.items():
            write_roads(out, name, lanes)
        made |= existing_shards(out, started)
        missing = [job for job in jobs if job.shard.file not in made]
        if missing:
            task = partial(_work, dataset, settings, started.fingerprint, (out / SHARDS).resolve())
            noted = partial(log.record, out, feedback)
            with feedback.bar("sensing", "records") as move:
                _make(task, jobs, made, engine or LocalEngine(1), move, noted)
        finish(out, started, [made[job.shard.file] for job in jobs], dataset.meta.lost, dataset.meta.short)
    return Dataset.open(out)


def plan(shards: Sequence[Shard], records: int | None) -> list[Job]:
    """How often each record is sensed, so that `records` come of all shards, taken in their order over and over."""
    own = sum(shard.samples for shard in shards)
    times, rest = (1, 0) if records is None or not own else divmod(records, own)
    jobs = []
    for shard in shards:
        more = min(rest, shard.samples)
        jobs.append(Job(shard, times, more))
        rest -= more
    return jobs


def _make(
    task: Callable[[Job], Shard | InputError | OutputError],
    jobs: Sequence[Job],
    made: dict[str, Shard],
    engine: Engine,
    move: Move,
    note: Note,
) -> None:
    """Sense the shards that are not among those made, and add them there."""
    total = sum(job.records for job in jobs)
    done = sum(job.records for job in jobs if job.shard.file in made)
    move(done, total)
    with closing(engine.run(task, [job for job in jobs if job.shard.file not in made])) as outcomes:
        for outcome in outcomes:
            if isinstance(outcome.result, InputError | OutputError):
                raise outcome.result
            if outcome.result is None:
                raise RunError(f"{outcome.item.shard.file}: {outcome.error}")
            made[outcome.item.shard.file] = outcome.result
            note(log.entry_of(outcome.result, outcome))
            done += outcome.item.records
            move(done, total)


def _work(
    dataset: Dataset, settings: ResenseSettings, mark: str, folder: Path, job: Job
) -> Shard | InputError | OutputError:
    """Sense one shard; runs in a worker. A fault that another try would not mend is returned."""
    try:
        return _sense_shard(dataset, settings, mark, folder, job)
    except (InputError, OutputError) as error:
        return error


def _sense_shard(dataset: Dataset, settings: ResenseSettings, mark: str, folder: Path, job: Job) -> Shard:
    own = read_samples(dataset.shard_path(job.shard))
    wanted = [_repeated(each, turn) for turn in range(job.times) for each in own]
    wanted += [_repeated(each, job.times) for each in own[: job.more]]
    episode, meta = job.shard.episode, dataset.meta
    sites = dataset.sites(episode.scenario)
    samples: list[Sample] = []
    fix_errors: list[float] = []
    for begin in range(0, len(wanted), TOGETHER):
        part = wanted[begin : begin + TOGETHER]
        if settings.sensor == "truth":
            samples += [replace(each, sensor="truth", snr_db=np.nan, n_sites=0, tv=each.tv_truth) for each in part]
            continue
        for each, got in zip(part, _sensed(part, sites, meta, settings), strict=True):
            if got.usable:
                samples.append(_with(each, got, settings.sensor))
                fix_errors.append(median_error_m(got.fixes, each.tv_truth))
    left_out = dict(episode.left_out)
    if dropped := len(wanted) - len(samples):
        why = UNSEEN if settings.sensor == "isac" else UNDETECTED
        left_out[why] = left_out.get(why, 0) + dropped
    update = {
        "fingerprint": mark,
        "left_out": left_out,
        "fix_error_m": tuple(fix_errors),
        "state_error_m": tuple(median_error_m(each.tv, each.tv_truth) for each in samples),
    }
    return write_shard(folder, samples, episode.model_copy(update=update), meta.tv_length, meta.uv_length)


def _sensed(part: Sequence[Sample], sites: Sequence[Site], meta: Meta, settings: ResenseSettings) -> list[SensedRecord]:
    """Sense records with the sites or with the UVs' radars."""
    truth = np.stack([each.tv_truth for each in part]).astype(np.float64)
    keys = [_key(each) for each in part]
    if settings.sensor == "isac":
        return sense(truth, meta.tv_rate_hz, sites, settings.sensing, keys)
    carrier = Carrier(np.stack([each.uv for each in part]).astype(np.float64), meta.uv_rate_hz)
    return sense_onboard(truth, meta.tv_rate_hz, carrier, settings.radar, keys)


def _with(sample: Sample, got: SensedRecord, sensor: str) -> Sample:
    """A sample as sensed now; the radar uses no site."""
    n_sites = got.n_sites if sensor == "isac" else 0
    return replace(sample, sensor=sensor, snr_db=got.snr_db, n_sites=n_sites, tv=got.state.astype(np.float32))


def _repeated(sample: Sample, turn: int) -> Sample:
    """A record as it is sensed for the (turn + 1)-th time; the first time keeps its id."""
    return replace(sample, sample_id=f"{sample.sample_id}{REPEAT}{turn}") if turn else sample


def _key(sample: Sample) -> tuple[str | int, ...]:
    """Names a record's draws: as when its dataset was generated, and the number of its repeat."""
    key = record_key(sample.scenario, sample.seed, sample.tv_id, sample.intention, sample.t_start)
    # Scenario names may hold what stands before a repeat's number; what follows the seed does not.
    _, _, turn = sample.sample_id.removeprefix(f"{sample.scenario}-{sample.seed}-").partition(REPEAT)
    return (*key, "repeat", int(turn)) if turn else key


def _check(dataset: Dataset, settings: ResenseSettings, out: Path) -> None:
    if out.resolve() == dataset.path.resolve():
        raise InputError(f"{out}: is the dataset to sense anew; choose another folder with -o")
    if settings.sensor == "isac" and settings.sensing.channel.blockage:
        raise InputError(
            f"{dataset.path}: blockage asks for the other vehicles, which a dataset does not hold; "
            "generate with it, or sense without it (--no-blockage)"
        )
    if settings.sensor == "radar" and settings.radar.condition == "nlos" and settings.radar.pattern == "line_of_sight":
        raise InputError(
            f"{dataset.path}: pattern line_of_sight asks for the other vehicles, which a dataset does not hold; "
            "choose random or contiguous"
        )
    before = dataset.meta.resensed or {}
    if settings.records is not None and before.get("settings", {}).get("records") is not None:
        raise InputError(
            f"{dataset.path}: repeats records already; give --records with the dataset that it was made of"
        )


def _describe(dataset: Dataset, settings: ResenseSettings) -> Meta:
    """The `dataset.json` of a dataset of which no shard is sensed yet."""
    resensed: dict[str, Any] = {"of": dataset.digest, "settings": settings.model_dump(mode="json")}
    study, now = dict(dataset.meta.study), versions(OF_DATASETS)
    if settings.sensor == "isac":
        study["sensing"] = resensed["settings"]["sensing"]
    scenarios = [each.model_dump(mode="json") for each in dataset.meta.scenarios]
    update = {
        "complete": False,
        "fingerprint": fingerprint(study, now, scenarios, resensed),
        "study": study,
        "versions": now,
        "shards": (),
        "resensed": resensed,
    }
    return dataset.meta.model_copy(update=update)
