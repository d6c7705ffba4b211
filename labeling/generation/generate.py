"""Generates a dataset from scenarios and seeds: runs the episodes that it needs and does not have yet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.versions import OF_DATASETS, versions
from isac_cosim.base.workers.attempts import Outcome
from isac_cosim.base.workers.engine import Engine, LocalEngine
from isac_cosim.base.workers.missing import run_missing
from isac_cosim.base.workers.threads import limited
from isac_cosim.isacsim.scenarios.naming import check_name
from isac_cosim.isacsim.scenarios.scenario import Scenario, resolved
from isac_cosim.isacsim.traffic.recordings.traffic_facts import TrafficFacts
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource, recorded
from isac_cosim.isacsim.traffic.sources.registry import MOTION_SOURCES, motion_source
from isac_cosim.labeling.dataset.dataset import (
    CLASS_NAMES,
    SHARDS,
    Dataset,
    Lost,
    Meta,
    ScenarioMeta,
    Shard,
    ShardIndex,
    SiteMeta,
    shard_name,
    write_roads,
)
from isac_cosim.labeling.generation import log
from isac_cosim.labeling.generation.episode import ready, shard_of
from isac_cosim.labeling.generation.episode_plan import EpisodeJob, EpisodePlan, Jobs
from isac_cosim.labeling.generation.folder import claimed, fingerprint, finish
from isac_cosim.labeling.generation.journal import Journal
from isac_cosim.labeling.generation.log import Entry, Note, withheld
from isac_cosim.labeling.generation.settings import DatasetStudy


def generate(
    study: DatasetStudy,
    out: Path,
    engine: Engine | None = None,
    feedback: Feedback = SILENT,
    source: MotionSource | None = None,
) -> Dataset:
    """Generate a study's dataset in a folder, or finish it if it has been begun there, and open it.

    engine: runs the episodes, one worker process when absent; the samples do not depend on it.
    feedback: receives the progress, counted in samples if the study sets a number of them, otherwise in episodes.
    source: where motion comes from; by default, the one that the study names.
    Raises InputError if the study, a scenario or the folder is at fault, RunError if every episode fails or the output
    cannot be written.
    """
    source = source or motion_source(study)
    scenarios = read_scenarios(study, source)
    started = describe(study, scenarios, source)
    jobs = Jobs(tuple((where, place.name, study.seeds.among(source, place)) for where, place in scenarios.items()))
    unused = study.known_sections().keys() - study.source_settings().keys()
    with claimed(out, started, unused) as started:
        for (name, scenario), scenario_meta in zip(scenarios.items(), started.scenarios, strict=True):
            for line in (*withheld(name, scenario), *scenario_meta.remarks):
                feedback.message(line)
        plan = EpisodePlan(jobs, study.selection)
        for scenario in scenarios.values():
            write_roads(out, scenario.name, scenario.lanes)
        journal = Journal.open(out, started)
        _add_existing(plan, jobs, journal.shards)
        if not plan.done:
            task = partial(_work, study, source, started.fingerprint, (out / SHARDS).resolve())
            keep = partial(_keep, plan, journal, partial(log.record, out, feedback))
            run_missing(
                task,
                plan.missing(),
                engine or LocalEngine(1),
                feedback,
                title="generating",
                unit=study.unit,
                keep=keep,
                progress=plan.progress,
                enough=lambda: plan.done,
            )
        files = (shard_name(job.scenario, job.seed) for job in plan.kept())
        finish(out, started, journal, files, plan.lost, plan.short())
        if (difference := plan.difference) is not None:
            feedback.message(difference)
    return Dataset.open(out)


@dataclass(frozen=True)
class EpisodeResult:
    """An episode's shard, and what became of the demand in its simulation."""

    shard: Shard
    traffic: TrafficFacts | None


def _add_existing(plan: EpisodePlan, jobs: Jobs, shards: ShardIndex) -> None:
    """Add to a plan the episodes whose shards exist already."""
    columns = shards.scenarios, shards.numbers("seed").tolist(), shards.by_intention().tolist()
    for scenario, seed, counts in zip(*columns, strict=True):
        if job := jobs.find(scenario, seed):
            plan.add(job, dict(zip(CLASS_NAMES, counts, strict=True)))


def _keep(plan: EpisodePlan, journal: Journal, note: Note, outcome: Outcome[EpisodeJob, EpisodeResult]) -> None:
    """Add a finished episode to the plan, the journal and the log."""
    job, result = outcome.item, outcome.result
    if result is not None:
        journal.add(result.shard)
        plan.add(job, result.shard.by_intention)
        note(log.entry_of(result.shard, outcome, result.traffic))
    else:
        lost = Lost(scenario=job.scenario, seed=job.seed, reason=str(outcome.error))
        plan.add(job, lost)
        spent = {"seconds": outcome.seconds, "retries": outcome.retries, "printed": outcome.printed}
        note(Entry(**lost.model_dump(), outcome="lost", **spent))


@limited()
def _work(study: DatasetStudy, source: MotionSource, fingerprint: str, folder: Path, job: EpisodeJob) -> EpisodeResult:
    """Run one episode in a worker and write its shard."""
    ready()
    scenario = _load(source, job.where)
    recording = recorded(source, scenario, job.seed)
    return EpisodeResult(shard_of(study, scenario, recording, folder, fingerprint), recording.facts)


@lru_cache(maxsize=4)
def _load(source: MotionSource, where: str) -> Scenario:
    """Load a scenario, only once per worker and not for each of its episodes."""
    return source.load(where)


def read_scenarios(study: DatasetStudy, source: MotionSource | None = None) -> dict[str, Scenario]:
    """Load a study's scenarios; return them by path or bundled name.

    source: where motion comes from; by default, the one that the study names. Raises InputError if a scenario is at
    fault, or if two of them are the same or have the same name.
    """
    source = source or motion_source(study)
    if repeated := [where for where, times in Counter(map(resolved, study.scenarios)).items() if times > 1]:
        raise InputError(f"{repeated[0]} is named twice; name every scenario once")
    scenarios = {resolved(name): source.load(resolved(name)) for name in study.scenarios}
    names = Counter(scenario.name for scenario in scenarios.values())
    if repeated := [name for name, times in names.items() if times > 1]:
        raise InputError(f"two scenarios are called {repeated[0]}; rename the folder or configuration of one")
    return scenarios


def describe(study: DatasetStudy, scenarios: dict[str, Scenario], source: MotionSource | None = None) -> Meta:
    """Return the `dataset.json` of a dataset that has no episodes yet.

    scenarios: as `read_scenarios` returns them. source: where motion comes from; by default, the one that the study
    names. Raises InputError if a scenario's name cannot be part of a file name, or a file cannot be read.
    """
    source = source or motion_source(study)
    content = study.model_dump(mode="json")
    package = MOTION_SOURCES.package(study.source)
    installed = versions(OF_DATASETS if package is None else (*OF_DATASETS, package))
    described = tuple(
        _describe_scenario(where, scenario, source, source.drivers_at(scenario, study.labels.limits_mps2))
        for where, scenario in zip(study.scenarios, scenarios.values(), strict=True)
    )
    return Meta(
        complete=False,
        fingerprint=fingerprint(
            {key: value for key, value in content.items() if key != "world"},
            installed,
            [scenario.identity for scenario in described],
        ),
        tv_rate_hz=study.record.tv_rate_hz,
        uv_rate_hz=study.record.uv_rate_hz,
        duration_s=study.record.duration_s,
        run_in_s=study.sensing.tracking.run_in_s,
        study=content,
        versions=installed,
        scenarios=described,
    )


def _describe_scenario(where: str, scenario: Scenario, source: MotionSource, drivers: Sequence[str]) -> ScenarioMeta:
    """Return a scenario's entry in `dataset.json`. where: the scenario as the study names it. drivers: as in it."""
    inputs = dict(source.inputs(scenario))
    sites = tuple(
        SiteMeta(id=site.id, x=site.x, y=site.y, height_m=site.height_m, azimuth_deg=site.azimuth_deg)
        for site in scenario.sites
    )
    check_name(scenario.name, where)
    return ScenarioMeta(
        name=scenario.name,
        source=where,
        sha256=source.digest(scenario),
        inputs=inputs,
        origin=scenario.origin,
        sites=sites,
        drivers=tuple(drivers),
        remarks=tuple(source.remarks(scenario)),
    )
