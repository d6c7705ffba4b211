"""What made a stored result: a file for each stage, with the settings behind it and the digests of its results."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar, Literal

from pydantic import JsonValue

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import content_digest, file_digest
from isac_cosim.base.settings import Sealed, read_json, write_sealed
from isac_cosim.base.versions import OF_EPISODES, versions
from isac_cosim.benchmarks.findings.figures.plan import FigureStage
from isac_cosim.studies.world import MEASUREMENT, differing, digests, world_of

WORK = "results/figures"
"""Where stages leave what is no result, from the top of the checkout."""
RECORDS = "docs/made_by"
"""Where the records lie of stages with results in the documents."""
UNKNOWN = "unknown, made before figures carried their world"
PRESENT = "present"
MOST_NAMED = 3
"""Settings of a part that a status names."""


class Record(Sealed):
    """What made the results of a stage.

    versions: of the packages that figures depend on; they are not compared. digests: of each part of the settings.
    settings: the settings themselves, so that a status can name those that differ. commands: digest of the stage's
    commands. results: digests of the files, by path; empty while the stage is not finished.
    """

    sealed_since: ClassVar[int] = 1

    schema_version: Literal[1] = 1
    stage: str
    versions: dict[str, str]
    digests: dict[str, str]
    commands: str
    results: dict[str, str]
    settings: dict[str, dict[str, JsonValue]]

    def difference(self, now: Record) -> str:
        """Return which settings differ from those of another record, in words; empty if none does."""
        changed = differing(self.settings, now.settings)
        named = [f"{part} ({_listed(names)})" for part, names in changed.items()]
        if self.commands != now.commands:
            named.append("commands of the stage")
        return ", ".join(named)


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more


def record_now(name: str, stage: FigureStage, root: Path) -> Record:
    """Return the record that the stage's results would have if they were made now, without results."""
    settings = world_of(stage.settings(root), stage.parts, stage.measurement)
    if files := stage.read_digests(root):
        settings[MEASUREMENT] = {**settings.get(MEASUREMENT, {}), **files}
    return Record(
        stage=name,
        versions=versions(OF_EPISODES),
        digests=digests(settings),
        commands=content_digest(list(stage.commands)),
        results={},
        settings=settings,
    )


def with_results(record: Record, stage: FigureStage, root: Path) -> Record:
    """Return a record with the digests of the results. Raises InputError where one is missing."""
    found = stage.files(root)
    if missing := [pattern for pattern, files in found.items() if not files]:
        raise InputError(f"{record.stage}: its commands left no {missing[0]}; correct the plan")
    return record.model_copy(update={"results": _digests(found, root)})


def _digests(found: Mapping[str, list[Path]], root: Path) -> dict[str, str]:
    return {path.relative_to(root).as_posix(): file_digest(path) for files in found.values() for path in files}


def record_file(name: str, stage: FigureStage, root: Path) -> Path:
    """Return where the record of a finished stage lies."""
    return root / (RECORDS if stage.in_documents else f"{WORK}/made_by") / f"{name}.json"


def begun_file(name: str, root: Path) -> Path:
    """Return where the record lies of what is in the folder of a stage, finished or not."""
    return root / WORK / name / "begun.json"


def write(path: Path, record: Record) -> None:
    """Write a record. Raises OutputError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_sealed(path, record)


def status(name: str, stage: FigureStage, root: Path) -> str:
    """Return `PRESENT`, or why the results of a stage are not those that the present settings would give."""
    found = stage.files(root)
    if missing := [pattern for pattern, files in found.items() if not files]:
        return f"not made: {missing[0]} is missing"
    record = read_json(Record, record_file(name, stage, root))
    if record is None:
        return UNKNOWN
    there = _digests(found, root)
    for path in sorted(record.results.keys() | there.keys()):
        if record.results.get(path) != there.get(path):
            return f"unknown: {path} is not the file that was recorded"
    if difference := record.difference(record_now(name, stage, root)):
        return f"made with other settings: {difference}"
    return PRESENT
