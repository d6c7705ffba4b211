"""Scenarios and seeds to a dataset: which episodes are needed, made on the engine, kept where they already stand."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from functools import lru_cache, partial
from pathlib import Path

from pydantic import ValidationError

from isacsim.errors import InputError
from isacsim.scenario import Scenario
from labeling.dataset import (
    SHARDS,
    Dataset,
    Lost,
    Meta,
    ScenarioMeta,
    Shard,
    SiteMeta,
    shard_name,
    write_roads,
)
from labeling.engine import Engine, LocalEngine
from labeling.episode import Source, SumoSource, make_shard
from labeling.folder import Progress, claimed, fingerprint, finish, standing, versions
from labeling.plan import Job, Plan
from labeling.study import DatasetStudy


def generate(
    study: DatasetStudy,
    out: Path,
    engine: Engine | None = None,
    progress: Progress | None = None,
    source: Source | None = None,
    tell: Callable[[str, Sequence[str]], None] | None = None,
) -> Dataset:
    """Make a study's dataset in a folder, or finish it where it was begun, and open it.

    engine: what runs the episodes, one worker process when absent; the samples do not depend on it.
    progress: counts samples where the study asks for windows, episodes otherwise.
    source: where motion comes from, SUMO when absent. tell: is given each scenario of
    whose configuration something is overridden, and those options.
    Raises InputError where the study, a scenario or the folder is at fault, RunError where every episode failed.
    """
    source = source or SumoSource(study.traffic, study.maneuvers)
    scenarios = {_where(name): source.load(_where(name)) for name in study.scenarios}
    for name, scenario in scenarios.items():
        if tell and scenario.overridden:
            tell(name, scenario.overridden)
    started = _describe(study, scenarios)
    with claimed(out, started):
        plan = Plan([Job(w, s.name, seed) for seed in study.seeds for w, s in scenarios.items()], study.selection)
        for scenario in scenarios.values():
            write_roads(out, scenario.name, scenario.lanes)
        files = {shard_name(job.scenario, job.seed): job for job in plan.jobs}
        for file, shard in standing(out, started, list(files)).items():
            plan.add(files[file], shard)
        if not plan.done:
            task = partial(_work, study, source, started.fingerprint, (out / SHARDS).resolve())
            _make_missing(task, plan, engine or LocalEngine(1), progress or (lambda done, total: None))
        run = plan.run()
        shards, lost = [s for s in run if isinstance(s, Shard)], [s for s in run if isinstance(s, Lost)]
        finish(out, started, shards, lost, plan.short())
    return Dataset.open(out)


def _make_missing(task: Callable[[Job], Shard | InputError], plan: Plan, engine: Engine, progress: Progress) -> None:
    """Make the episodes that the plan still needs."""
    progress(*plan.progress())
    with closing(engine.run(task, plan.missing())) as outcomes:
        for outcome in outcomes:
            if isinstance(outcome.result, InputError):
                raise outcome.result
            job = outcome.item
            plan.add(job, outcome.result or Lost(scenario=job.scenario, seed=job.seed, reason=str(outcome.error)))
            progress(*plan.progress())
            if plan.done:
                return


def _work(study: DatasetStudy, source: Source, fingerprint: str, folder: Path, job: Job) -> Shard | InputError:
    """Make one episode's shard; runs in a worker. A fault of the input is returned: trying again would not mend it."""
    try:
        return make_shard(study, source, _load(source, job.where), job.seed, folder, fingerprint)
    except InputError as error:
        return error


@lru_cache(maxsize=4)
def _load(source: Source, where: str) -> Scenario:
    """A worker reads a scenario once, not once an episode."""
    return source.load(where)


def _describe(study: DatasetStudy, scenarios: dict[str, Scenario]) -> Meta:
    """The `dataset.json` of a dataset of which no episode is made yet."""
    names = [scenario.name for scenario in scenarios.values()]
    if twice := [name for name, times in Counter(names).items() if times > 1]:
        raise InputError(f"two scenarios are called {twice[0]}; rename the folder or configuration of one")
    content = study.model_dump(mode="json")
    found = versions()
    described = tuple(
        _describe_scenario(source, scenario)
        for source, scenario in zip(study.scenarios, scenarios.values(), strict=True)
    )
    return Meta(
        complete=False,
        fingerprint=fingerprint(content, found, [each.model_dump(mode="json") for each in described]),
        tv_rate_hz=study.record.tv_rate_hz,
        uv_rate_hz=study.record.uv_rate_hz,
        duration_s=study.record.duration_s,
        study=content,
        versions=found,
        scenarios=described,
    )


def _describe_scenario(source: str, scenario: Scenario) -> ScenarioMeta:
    digest = hashlib.sha256()
    for path in (scenario.network, *scenario.demand, *scenario.additional):
        digest.update(f"{path.name} {path.stat().st_size}\n".encode())
        digest.update(path.read_bytes())
    sites = tuple(
        SiteMeta(id=site.id, x=site.x, y=site.y, height_m=site.height_m, azimuth_deg=site.azimuth_deg)
        for site in scenario.sites
    )
    try:
        return ScenarioMeta(
            name=scenario.name, source=source, sha256=digest.hexdigest(), origin=scenario.origin, sites=sites
        )
    except ValidationError:
        raise InputError(
            f"{source}: the scenario's name {scenario.name!r} makes no file name; use letters, digits, '-', '_' and '.'"
        ) from None


def _where(scenario: str) -> str:
    """A scenario that is a path, made absolute for workers; a bundled one's name as it is."""
    return str(Path(scenario).resolve()) if Path(scenario).exists() else scenario
