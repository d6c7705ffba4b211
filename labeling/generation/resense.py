"""Sensing a dataset's records anew: another channel, estimator or sensor over the same motion.

A dataset holds the true motion of its TVs, what its UVs reported, and the sites. That is all that sensing needs, except
the other vehicles. For a scene, the episode is recorded again (`labeling.generation.recorded_again`); what else depends
on them (blockage, the radar's line of sight) cannot be sensed anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.settings import checked
from isac_cosim.base.versions import OF_DATASETS, versions
from isac_cosim.base.workers.attempts import Outcome
from isac_cosim.base.workers.engine import Engine, LocalEngine
from isac_cosim.base.workers.missing import Tally, run_missing
from isac_cosim.base.workers.threads import limited
from isac_cosim.isacsim.sensing.chain import SensingSettings
from isac_cosim.isacsim.sensing.following import TOGETHER
from isac_cosim.isacsim.sensing.passages import Carrier, Passage, SensedRecord, WatchedTraffic
from isac_cosim.isacsim.sensing.reports import ReportSettings, report_noise
from isac_cosim.isacsim.sensing.sensors import DEFAULT, SCENE, SENSORS, Watch, watch
from isac_cosim.isacsim.sensing.sensors.protocol import SensorSettings
from isac_cosim.isacsim.sensing.sensors.scene import as_sensed
from isac_cosim.isacsim.traffic.motion import MotionSettings
from isac_cosim.labeling.dataset.dataset import (
    SHARDS,
    Dataset,
    Meta,
    Sample,
    Shard,
    ShardIndex,
    write_roads,
    write_shard,
)
from isac_cosim.labeling.dataset.pull_outs import dropped_pull_outs, write_dropped_pull_outs
from isac_cosim.labeling.dataset.record_point import in_plane, relative
from isac_cosim.labeling.dataset.shard import SCHEMA_VERSION
from isac_cosim.labeling.generation import log
from isac_cosim.labeling.generation.episode import median_error_m, record_key, track_columns
from isac_cosim.labeling.generation.folder import claimed, fingerprint, finish
from isac_cosim.labeling.generation.journal import Journal
from isac_cosim.labeling.generation.log import Note
from isac_cosim.labeling.generation.recorded_again import Recorder

REPEAT = "-r"
"""Separates a sample's id from the number of its repeat."""


class ResenseSettings(SensorSettings):
    """How records are sensed anew."""

    sensor: Annotated[str, AfterValidator(SENSORS.check)] = Field(
        DEFAULT, description="; ".join(f"{name}: {sensor.label}" for name, sensor in SENSORS.items())
    )
    records: int | None = Field(
        None,
        ge=1,
        le=1_000_000_000,
        description="records to sense, the dataset's over and over with new noise; as many as it holds when absent",
    )


@dataclass(frozen=True)
class ShardJob:
    """One shard to sense anew: all its records `times` over, and the first `more` of them once more."""

    shard: Shard
    times: int
    more: int

    @property
    def file(self) -> str:
        """The name of the shard's file."""
        return self.shard.file

    @property
    def records(self) -> int:
        """Records to sense, repeats included."""
        return self.times * self.shard.samples + self.more


def own_sensing(dataset: Dataset) -> SensingSettings:
    """Return the sensing settings that a dataset was generated with."""
    return checked(SensingSettings, dataset.meta.study.get("sensing", {}), dataset.path)


def own_report(dataset: Dataset) -> ReportSettings:
    """Return the noise of the reports of a dataset's UVs; none if the dataset does not say."""
    silent = {"position_sd_m": 0.0, "speed_sd_mps": 0.0, "acceleration_sd_mps2": 0.0}
    return checked(ReportSettings, silent | dataset.meta.study.get("report", {}), dataset.path)


def resense(
    dataset: Dataset,
    settings: ResenseSettings,
    out: Path,
    engine: Engine | None = None,
    feedback: Feedback = SILENT,
) -> Dataset:
    """Sense a dataset's records anew into another folder, or finish a dataset begun there, and open it.

    The dataset's own settings give the same `tv`, to the bit. Records that the sensor cannot use are left out and
    counted in their episode.
    engine: senses the shards, one worker process when absent; the samples do not depend on it.
    feedback: receives the progress.
    Raises InputError if the settings, the dataset or the folder are at fault, RunError if a shard fails.
    """
    settings = settings.model_copy(update={"sensing": as_sensed(settings.sensing, settings.sensor == SCENE)})
    _check(dataset, settings, out)
    recorder = Recorder.of(dataset) if settings.sensor == SCENE else None
    started = _describe(dataset, settings)
    roads = {scenario.name: dataset.roads(scenario.name) for scenario in dataset.meta.scenarios}
    with claimed(out, started):
        for name, lanes in roads.items():
            write_roads(out, name, lanes)
        journal = Journal.open(out, started)
        stored = set(journal.shards.files)
        files, jobs = dataset.meta.shards.files, plan(dataset.meta.shards, settings.records)
        if any(file not in stored for file in files):
            # Every task carries the dataset: leave out the index, which may be long. Workers may run in another folder.
            meta = dataset.meta.model_copy(update={"shards": ShardIndex.of(())})
            sent = replace(dataset, path=dataset.path.absolute(), meta=meta)
            task = partial(_work, sent, settings, recorder, started.fingerprint, (out / SHARDS).resolve())
            missing = [job for job in jobs if job.file not in stored]
            tally = Tally(records_in(jobs), records_in(jobs) - records_in(missing))
            keep = partial(_keep, tally, journal, partial(log.record, out, feedback))
            run_missing(
                task,
                missing,
                engine or LocalEngine(1),
                feedback,
                title="sensing",
                unit="records",
                keep=keep,
                progress=tally,
            )
        finish(out, started, journal, files, dataset.meta.lost, dataset.meta.short)
    return Dataset.open(out)


def plan(shards: ShardIndex, records: int | None) -> list[ShardJob]:
    """Return how often to sense the records of each shard.

    records: number of records to sense in all, each once if None. They are taken in their order, over and over.
    """
    stored = int(shards.numbers("samples").sum())
    times, rest = (1, 0) if records is None or not stored else divmod(records, stored)
    jobs = []
    for shard in shards:
        more = min(rest, shard.samples)
        jobs.append(ShardJob(shard, times, more))
        rest -= more
    return jobs


def records_in(jobs: Sequence[ShardJob]) -> int:
    """Return the number of records of some jobs, repeats included."""
    return sum(job.records for job in jobs)


def _keep(tally: Tally, journal: Journal, note: Note, outcome: Outcome[ShardJob, Shard]) -> None:
    """Add a finished shard to the journal and the log. Raises RunError if it failed."""
    if outcome.result is None:
        raise RunError(f"{outcome.item.file}: {outcome.error}")
    journal.add(outcome.result)
    note(log.entry_of(outcome.result, outcome))
    tally.done += outcome.item.records


@limited()
def _work(
    dataset: Dataset, settings: ResenseSettings, recorder: Recorder | None, mark: str, folder: Path, job: ShardJob
) -> Shard:
    """Sense one shard and write it; runs in a worker. recorder: of its episode, where all vehicles are needed."""
    alone = replace(dataset, meta=dataset.meta.model_copy(update={"shards": ShardIndex.of([job.shard])}))
    stored, episode = alone.samples(job.shard), alone.episode(job.shard)
    wanted = [_repeated(sample, turn) for turn in range(job.times) for sample in stored]
    wanted += [_repeated(sample, job.times) for sample in stored[: job.more]]
    recording = None if recorder is None else recorder.record(episode.scenario, episode.seed, stored)
    traffic = WatchedTraffic(
        episode.scenario,
        episode.seed,
        dataset.sites(episode.scenario),
        dataset.meta.tv_rate_hz,
        own_report(dataset),
        recording,
        MotionSettings() if recorder is None else recorder.study.motion,
    )
    sensor = watch(settings.sensor, traffic, settings)
    samples, fix_errors = _sense(wanted, dataset.meta, traffic.report, sensor)
    # They are sensed once, however often the records are.
    dropped = dropped_pull_outs(alone)
    kept = [sample for shard in dropped.meta.shards for sample in dropped.samples(shard)]
    pull_outs, _ = _sense(kept, dataset.meta, traffic.report, sensor)
    left_out = dict(episode.left_out)
    if unusable := len(wanted) - len(samples):
        left_out[sensor.unusable] = left_out.get(sensor.unusable, 0) + unusable
    update = {
        "schema_version": SCHEMA_VERSION,
        "fingerprint": mark,
        "left_out": left_out,
        "fix_error_m": tuple(fix_errors),
        "scene": sensor.scene_scores,
        "state_error_m": tuple(median_error_m(sample.tv, sample.tv_truth) for sample in samples),
    }
    meta, sensed = dataset.meta, episode.model_copy(update=update)
    dropped_shard = write_dropped_pull_outs(folder.parent, pull_outs, sensed, meta.lengths)
    return write_shard(folder, samples, sensed, *meta.lengths, dropped_shard)


def _sense(
    wanted: Sequence[Sample], meta: Meta, report: ReportSettings, sensor: Watch
) -> tuple[list[Sample], list[float]]:
    """Return those of the samples that the sensor can use, sensed anew, and the errors of their fixes, m.

    A sensor without a filter has no fixes.
    """
    filtered = SENSORS[sensor.name].filtered
    samples: list[Sample] = []
    fix_errors: list[float] = []
    for begin in range(0, len(wanted), TOGETHER):
        part = wanted[begin : begin + TOGETHER]
        for sample, record in zip(
            part, sensor.record([_passage(sample, meta, report) for sample in part]), strict=True
        ):
            if record.usable:
                samples.append(_with(sample, record, sensor.name))
                if filtered:
                    fixes = relative(record.fixes, (sample.x0, sample.y0))
                    fix_errors.append(median_error_m(fixes, sample.tv_truth))
    return samples, fix_errors


def _passage(sample: Sample, meta: Meta, report: ReportSettings) -> Passage:
    """Return a sample in the form that sensors take."""
    return Passage(
        tv=sample.tv_id,
        start_s=sample.t_start,
        truth=in_plane(sample.tv_truth, sample.x0, sample.y0),
        key=_key(sample),
        past=in_plane(sample.tv_run_in, sample.x0, sample.y0) if meta.run_in_length else None,
        find_carrier=partial(_carrier, sample, meta, report),
    )


def _carrier(sample: Sample, meta: Meta, report: ReportSettings) -> Carrier:
    """Return the motion of a sample's UV.

    A dataset stores what the UVs reported. Their true motion, which carries a radar, is that minus the noise, which is
    drawn again from the record's key.
    """
    reported = in_plane(sample.uv, sample.x0, sample.y0)
    return Carrier(
        state=reported - report_noise(meta.uv_length, report, _record_key(sample)),
        rate_hz=meta.uv_rate_hz,
        reported=reported,
        position_sd_m=report.position_sd_m,
        speed_sd_mps=report.speed_sd_mps,
        vehicles=(sample.uv_id,),
    )


def _with(sample: Sample, record: SensedRecord, sensor: str) -> Sample:
    """Return a sample with its TV as it was sensed anew."""
    tv = relative(record.state, (sample.x0, sample.y0))
    known = {"snr_db": record.snr_db, "n_sites": record.n_sites, **track_columns(record)}
    return replace(sample, sensor=sensor, tv=tv, **known)


def _repeated(sample: Sample, turn: int) -> Sample:
    """Return a sample with the id of its (turn + 1)-th sensing; the first one keeps its id."""
    return replace(sample, sample_id=f"{sample.sample_id}{REPEAT}{turn}") if turn else sample


def _record_key(sample: Sample) -> tuple[str | int, ...]:
    """Return the key that a record had when its dataset was generated."""
    return record_key(sample.scenario, sample.seed, sample.tv_id, sample.intention, sample.t_start)


def _key(sample: Sample) -> tuple[str | int, ...]:
    """Return the key of a record's random draws: that of its generation, and the number of its repeat."""
    # The name of a scenario may contain REPEAT; what follows the seed does not.
    _, _, turn = sample.sample_id.removeprefix(f"{sample.scenario}-{sample.seed}-").partition(REPEAT)
    return (*_record_key(sample), "repeat", int(turn)) if turn else _record_key(sample)


def _check(dataset: Dataset, settings: ResenseSettings, out: Path) -> None:
    """Raise InputError if the records cannot be sensed in this way or into this folder."""
    if out.resolve() == dataset.path.resolve():
        raise InputError(f"{out}: is the dataset to sense anew; choose another folder with -o")
    if refusal := SENSORS[settings.sensor].refusal(settings):
        raise InputError(f"{dataset.path}: {refusal}")
    if settings.sensor == SCENE and settings.records is not None:
        raise InputError(f"{dataset.path}: --records repeats records, and a scene is sensed once; leave it out")
    before = dataset.meta.resensed or {}
    if settings.records is not None and before.get("settings", {}).get("records") is not None:
        raise InputError(f"{dataset.path}: repeats records already; give --records with the dataset it was made from")


def _describe(dataset: Dataset, settings: ResenseSettings) -> Meta:
    """Return the `dataset.json` of the new dataset while it has no shards."""
    resensed: dict[str, Any] = {"of": dataset.digest, "settings": settings.model_dump(mode="json")}
    study, now = dict(dataset.meta.study), versions(OF_DATASETS)
    if SENSORS[settings.sensor].by_sites:
        study["sensing"] = resensed["settings"]["sensing"]
    scenarios = [scenario.identity for scenario in dataset.meta.scenarios]
    update = {
        "schema_version": SCHEMA_VERSION,
        "complete": False,
        "fingerprint": fingerprint(study, now, scenarios, resensed, SCHEMA_VERSION),
        "study": study,
        "versions": now,
        "shards": ShardIndex.of(()),
        "resensed": resensed,
    }
    return dataset.meta.model_copy(update=update)
