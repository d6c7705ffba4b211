"""What is finished of a long stage, kept in the documents until all of it is: a later run, elsewhere, goes on from it.

docs/unfinished/STAGE/begun.json    the settings behind it, and the digests of the files beside it
docs/unfinished/STAGE/...           the files that the stage's `kept` names, as they lie in the folder of its work
"""

from __future__ import annotations

import shutil
from pathlib import Path

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import file_digest
from isac_cosim.base.settings import read_json
from isac_cosim.benchmarks.findings.figures.plan import FigureStage
from isac_cosim.benchmarks.findings.figures.record import (
    PRESENT,
    WORK,
    Record,
    begun_file,
    record_now,
    status,
    write,
)

UNFINISHED = "docs/unfinished"


def kept_files(name: str, stage: FigureStage, root: Path) -> list[Path]:
    """Return the files that are kept of a stage, the record of what made them first; none where nothing is."""
    folder = root / UNFINISHED / name
    begun = folder / begun_file(name, root).name
    return [begun, *_named(stage, folder)] if begun.is_file() else []


def keep(name: str, stage: FigureStage, root: Path) -> str:
    """Copy what is finished of an unfinished stage into the documents; return what became of it, empty if nothing is.

    Raises InputError where more is kept of the stage than lies in the folder of its work.
    """
    work, folder = root / WORK / name, root / UNFINISHED / name
    record = read_json(Record, begun_file(name, root))
    finished = [path.relative_to(work) for path in _named(stage, work)]
    if record is None or not finished or status(name, stage, root) == PRESENT:
        return ""
    if difference := record.difference(record_now(name, stage, root)):
        return f"was begun with other settings: {difference}; not kept"
    if lost := sorted({path.relative_to(folder) for path in _named(stage, folder)}.difference(finished)):
        raise InputError(f"{folder / lost[0]}: is not in {work}; delete {folder} to keep less than before")
    for path in finished:
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(work / path, folder / path)
    digests = {path.as_posix(): file_digest(folder / path) for path in finished}
    write(folder / begun_file(name, root).name, record.model_copy(update={"results": digests}))
    return f"{len(finished)} files kept in {folder.relative_to(root)}; commit them"


def go_on(name: str, stage: FigureStage, root: Path) -> str:
    """Copy what is kept of a stage into the folder of its work, where that is missing; return what became of it.

    What other settings or versions made is left alone, and the text says which. Empty where nothing is kept. Raises
    InputError where a kept file is not the one that was recorded.
    """
    work, folder = root / WORK / name, root / UNFINISHED / name
    kept = kept_files(name, stage, root)
    if work.exists() or not kept:
        return ""
    record = read_json(Record, kept[0])
    assert record is not None
    found = {path.relative_to(folder).as_posix(): file_digest(path) for path in kept[1:]}
    if wrong := sorted(path for path in record.results.keys() | found if record.results.get(path) != found.get(path)):
        raise InputError(f"{folder / wrong[0]}: is not the file that was kept; restore it, or delete {folder}")
    now = record_now(name, stage, root)
    if difference := record.difference(now):
        return f"{folder}: is of other settings: {difference}; begins anew"
    if others := sorted(set(record.versions.items()) - set(now.versions.items())):
        package, version = others[0]
        return f"{folder}: was made with {package} {version}; install that to go on from it; begins anew"
    for path in record.results:
        (work / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(folder / path, work / path)
    write(begun_file(name, root), record.model_copy(update={"results": {}}))
    return f"goes on from {folder}"


def discard(name: str, root: Path) -> None:
    """Remove what is kept of a stage: all of it is finished."""
    shutil.rmtree(root / UNFINISHED / name, ignore_errors=True)


def _named(stage: FigureStage, folder: Path) -> list[Path]:
    return sorted({path for pattern in stage.kept for path in folder.glob(pattern) if path.is_file()})
