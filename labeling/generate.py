"""Scenarios and seeds to a dataset: which episodes are needed, made on the engine, kept where they already stand."""

from __future__ import annotations

import fcntl
import hashlib
import importlib.metadata
import json
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from isacsim.errors import InputError
from isacsim.scenario import Scenario
from labeling.dataset import (
    META_FILE,
    ROADS,
    SHARDS,
    Dataset,
    Lost,
    Meta,
    ScenarioMeta,
    Shard,
    SiteMeta,
    read_meta,
    read_shard,
    shard_name,
    write_meta,
    write_roads,
)
from labeling.engine import Engine, LocalEngine
from labeling.episode import Source, SumoSource, make_shard
from labeling.plan import Job, Plan
from labeling.study import DatasetStudy

VERSIONED = ("isac-cosim", "libsumo", "numpy", "pyarrow", "scipy")
"""Packages whose version may change the bytes of a shard."""

Progress = Callable[[int, int], None]
"""Called with how much is done and of how much: samples when the study asks for windows, episodes otherwise."""


def generate(
    study: DatasetStudy,
    out: Path,
    engine: Engine | None = None,
    progress: Progress | None = None,
    source: Source | None = None,
) -> Dataset:
    """Make a study's dataset in a folder, or finish it where it was begun, and open it.

    engine: what runs the episodes, one worker process when absent; the samples do not depend on it.
    source: where motion comes from, SUMO when absent.
    Raises InputError where the study, a scenario or the folder is at fault, RuntimeError where every episode failed.
    """
    source = source or SumoSource(study.traffic, study.maneuvers)
    scenarios = {_where(name): source.load(_where(name)) for name in study.scenarios}
    started = _describe(study, scenarios)
    with _claimed(out, started):
        plan = Plan([Job(w, s.name, seed) for seed in study.seeds for w, s in scenarios.items()], study.selection)
        for scenario in scenarios.values():
            write_roads(out, scenario.name, scenario.lanes)
        for job, shard in _standing(out, started, plan.jobs):
            plan.add(job, shard)
        if not plan.done:
            task = partial(_work, study, source, started.fingerprint, (out / SHARDS).resolve())
            _make_missing(task, plan, engine or LocalEngine(1), progress or (lambda done, total: None))
        _finish(out, started, plan)
    return Dataset.open(out)


def _make_missing(task: Callable[[Job], Shard | InputError], plan: Plan, engine: Engine, progress: Progress) -> None:
    """Make the episodes that the plan still needs."""
    progress(*plan.progress())
    with closing(engine.run(task, plan.missing())) as outcomes:
        for outcome in outcomes:
            if isinstance(outcome.result, InputError):
                raise outcome.result
            job = outcome.item
            plan.add(job, outcome.result or Lost(scenario=job.scenario, seed=job.seed, reason=_reason(outcome.error)))
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


def _finish(out: Path, started: Meta, plan: Plan) -> None:
    """Write the finished `dataset.json` and delete the shards of episodes that turned out not to be needed."""
    shards = tuple(each for each in plan.run() if isinstance(each, Shard))
    lost = tuple(each for each in plan.run() if isinstance(each, Lost))
    if lost and not shards:
        raise RuntimeError(f"all {len(lost)} episodes failed, the first with: {lost[0].reason}")
    kept = {shard.file for shard in shards}
    for path in (out / SHARDS).iterdir():
        if path.name not in kept:
            path.unlink()
    finished = {"complete": True, "shards": shards, "lost": lost, "short": plan.short()}
    write_meta(out, started.model_copy(update=finished))


def _standing(out: Path, started: Meta, jobs: Sequence[Job]) -> Iterator[tuple[Job, Shard]]:
    """The episodes whose shards stand already, whole and of this study."""
    before = read_meta(out)
    known = {shard.file: shard for shard in before.shards} if before else {}
    present = {path.name: path for path in (out / SHARDS).iterdir()}
    for job in jobs:
        path = present.get(shard_name(job.scenario, job.seed))
        if path is None:
            continue
        shard = known.get(path.name)
        if shard is None or shard.bytes != path.stat().st_size:
            try:
                shard = read_shard(path)
            except InputError:
                continue
        if shard.episode.fingerprint == started.fingerprint:
            yield job, shard


def _describe(study: DatasetStudy, scenarios: dict[str, Scenario]) -> Meta:
    """The `dataset.json` of a dataset of which no episode is made yet."""
    names = [scenario.name for scenario in scenarios.values()]
    if twice := [name for name, times in Counter(names).items() if times > 1]:
        raise InputError(f"two scenarios are called {twice[0]}; rename the folder or configuration of one")
    content = study.model_dump(mode="json")
    versions = _versions()
    described = tuple(
        _describe_scenario(source, scenario)
        for source, scenario in zip(study.scenarios, scenarios.values(), strict=True)
    )
    identity = [content, versions, [each.model_dump(mode="json") for each in described]]
    return Meta(
        complete=False,
        fingerprint=hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest(),
        tv_rate_hz=study.record.tv_rate_hz,
        uv_rate_hz=study.record.uv_rate_hz,
        duration_s=study.record.duration_s,
        study=content,
        versions=versions,
        scenarios=described,
    )


def _versions() -> dict[str, str]:
    """Versions of the packages in VERSIONED; the tool itself may run from its source tree without being installed."""
    found = {}
    for name in VERSIONED:
        with suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found


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


@contextmanager
def _claimed(out: Path, started: Meta) -> Iterator[None]:
    """Hold a folder for one study, begun now or before, against every other study, command and content."""
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: is a file; give a folder for the dataset")
    try:
        foreign = out.is_dir() and any(not path.name.startswith(f".{META_FILE}.") for path in out.iterdir())
        if foreign and not (out / META_FILE).is_file():
            raise InputError(f"{out}: holds something that is no dataset; give a new or empty folder")
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{out}: cannot be used as the dataset's folder ({error.strerror}); choose another") from None
    with _locked(out):
        before = read_meta(out)
        if before is not None and before.fingerprint != started.fingerprint:
            raise InputError(
                f"{out}: holds the dataset of another study ({_difference(before, started)}); choose another folder"
            )
        for folder in (out / SHARDS, out / ROADS):
            folder.mkdir(exist_ok=True)
        for partial_file in [*out.glob(".*.json.*"), *out.glob(f"{SHARDS}/.*.parquet.*")]:
            partial_file.unlink()
        if before is None:
            write_meta(out, started)
        yield


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Keep a second command out of a folder. The lock ends with the process, however it ends, and leaves no file."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError:
        raise InputError(f"{folder}: another command is writing it; wait for it, or choose another folder") from None
    finally:
        os.close(descriptor)


def _difference(before: Meta, now: Meta) -> str:
    """The first setting, scenario or version in which two datasets differ, with both values."""

    def tree(meta: Meta) -> dict[str, Any]:
        inputs = {each.name: each.model_dump(mode="json") for each in meta.scenarios}
        return {**meta.study, "inputs": inputs, "versions": meta.versions}

    return _first_difference("", tree(before), tree(now)) or "its fingerprint differs"


def _first_difference(path: str, before: Any, now: Any) -> str | None:
    if isinstance(before, dict) and isinstance(now, dict):
        for key in [*before, *(key for key in now if key not in before)]:
            found = _first_difference(f"{path}.{key}".lstrip("."), before.get(key), now.get(key))
            if found:
                return found
        return None
    return None if before == now else f"{path} is {json.dumps(before)} there and {json.dumps(now)} here"


def _where(scenario: str) -> str:
    """A scenario that is a path, made absolute for workers; a bundled one's name as it is."""
    return str(Path(scenario).resolve()) if Path(scenario).exists() else scenario


def _reason(error: BaseException | None) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:500]
