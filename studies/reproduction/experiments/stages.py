"""Stages of a reproduction: each answers one question, leaves one small file, and is not run again.

OUT/reproduction.json       the paper, the size and the settings; identifies the folder
OUT/stages/<stage>.json     what a stage measured, with a digest: scores, no weights
OUT/work/                   datasets, trained predictors and scores of single trainings
OUT/tables, OUT/figures     CSV and PNG
OUT/index.html              the page
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import Feedback, spoken_time
from isac_cosim.base.files import claim, file_digest, json_text, replace_file, write_json
from isac_cosim.base.settings import Settings, read_json
from isac_cosim.base.versions import OF_RUNS, versions
from isac_cosim.models.runs.run import read_card
from isac_cosim.models.training.progress import Steps
from isac_cosim.studies.reproduction.experiments.stage_results import StageResult
from isac_cosim.studies.sweep import finished

MARK = "reproduction.json"
STAGES = "stages"
ALWAYS = ("claims", "page")
"""Names that stand for no stage: claims and page follow from the files of the stages, and are always written."""


@dataclass(frozen=True)
class Capacity:
    """What stages run on. workers: number of worker processes. cores: number of processor cores that they share."""

    workers: int
    cores: int


@dataclass(frozen=True)
class Stage:
    """One step of a reproduction.

    name: as `--stages` takes it. group: other name, shared by stages that fill one table together. question: what it
    answers, for people. cost_s: expected processor time, s. parallel: how many of its parts can run side by side.
    run: does the work; returns what the stage's file holds, of the type `kind`. check: raises InputError, with the fix,
    where something is missing that the stage needs. makes: what it makes in `work` unless it is there, datasets and
    predictors, with the processor time of each, s, which `cost_s` leaves out.
    """

    name: str
    group: str
    question: str
    cost_s: float
    parallel: int
    run: Callable[[], StageResult]
    kind: type[StageResult]
    check: Callable[[], None] = lambda: None
    makes: Mapping[Path, float] = field(default_factory=dict)

    def seconds(self, capacity: Capacity) -> float:
        """Return the expected duration, s. Parts of equal length run in rounds, and share the cores."""
        full, rest = divmod(self.parallel, capacity.workers)
        rounds = full * max(1.0, capacity.workers / capacity.cores)
        if rest:
            rounds += max(1.0, rest / capacity.cores)
        return self.cost_s * rounds / self.parallel


class Identity(Settings):
    """The content of `reproduction.json`: a folder holds one reproduction, with one size and one set of settings."""

    paper: str
    size: str
    settings: dict[str, Any]
    versions: dict[str, str]


class Cost(Settings):
    """What a reproduction costs.

    stages: expected duration of each stage that is not finished, s, by name. cpu_s: processor time, s. seconds:
    duration, s. workers, cores: number of worker processes behind the durations, and of the cores that they share.
    """

    stages: dict[str, float]
    cpu_s: float
    seconds: float
    workers: int
    cores: int


def chosen_stages(stages: Sequence[Stage], names: Sequence[str] | None) -> list[Stage]:
    """Return the stages with these names or in these groups, all of them if None. Raises InputError for other names."""
    if names is None:
        return list(stages)
    offered = [*dict.fromkeys(name for stage in stages for name in (stage.name, stage.group)), *ALWAYS]
    if unknown := [name for name in names if name not in offered]:
        raise InputError(f"--stages {unknown[0]}: no such stage; choose among {', '.join(offered)}")
    return [stage for stage in stages if {stage.name, stage.group} & set(names)]


def fastest(stages: Sequence[Stage], cores: int) -> Capacity:
    """Return how many workers make the stages short on that many cores: the fewest, from one to two for each core."""
    offered = [Capacity(workers, cores) for workers in range(cores, 2 * cores + 1)]
    return min(offered, key=lambda capacity: sum(stage.seconds(capacity) for stage in stages))


def in_full(stages: Sequence[Stage], folder: Path) -> list[Stage]:
    """Return the stages with costs that include what each makes: what neither lies there nor is made by one before.

    A dataset or a training that was interrupted counts in full.
    """
    made: set[Path] = set()
    counted = []
    for stage in stages:
        needed = {} if _file(folder, stage.name).is_file() else stage.makes
        missing = {path: s for path, s in needed.items() if path not in made and not _is_made(path)}
        made |= missing.keys()
        counted.append(replace(stage, cost_s=stage.cost_s + sum(missing.values()), makes={}))
    return counted


def _is_made(path: Path) -> bool:
    """Return whether a file, a complete dataset or a complete run lies at a path."""
    if path.is_file() or finished(path):
        return True
    card = read_card(path)
    return card is not None and card.complete


def cost_of(stages: Sequence[Stage], folder: Path, capacity: Capacity) -> Cost:
    """Return what the stages cost that are not finished in a folder."""
    missing = [stage for stage in in_full(stages, folder) if not _file(folder, stage.name).is_file()]
    durations = {stage.name: round(stage.seconds(capacity), 1) for stage in missing}
    return Cost(
        stages=durations,
        cpu_s=round(sum(stage.cost_s for stage in missing), 1),
        seconds=round(sum(durations.values()), 1),
        workers=capacity.workers,
        cores=capacity.cores,
    )


def cost_in_words(cost: Cost) -> str:
    """Return the cost of a reproduction in one sentence."""
    if not cost.stages:
        return "every stage is finished; only the page is written"
    longest = max(cost.stages, key=lambda name: cost.stages[name])
    workers = "1 worker" if cost.workers == 1 else f"{cost.workers} workers"
    cores = "1 core" if cost.cores == 1 else f"{cost.cores} cores"
    return (
        f"{len(cost.stages)} stages to run: about {spoken_time(cost.cpu_s)} of processor time, "
        f"{spoken_time(cost.seconds)} with {workers} on {cores}; "
        f"the longest, {longest}, {spoken_time(cost.stages[longest])}"
    )


def run_stages(
    identity: Identity,
    stages: Sequence[Stage],
    folder: Path,
    capacity: Capacity,
    feedback: Feedback,
    shown: Sequence[Stage] = (),
) -> None:
    """Run the stages that are not finished in a folder, in order, and write the file of each.

    shown: other stages, whose files are read afterwards where there are any. Raises InputError where the folder holds
    something else or a reproduction with other settings, and, before any stage runs, where one of them lacks what it
    needs or a file is damaged.
    """
    for stage in stages:
        if not _file(folder, stage.name).is_file():
            stage.check()
    with claim(folder, MARK, "reproduction"):
        _identify(folder, identity)
        (folder / STAGES).mkdir(exist_ok=True)
        for stage in (*stages, *shown):
            result_of(folder, stage.name, stage.kind)
        feedback.message(cost_in_words(cost_of(stages, folder, capacity)))
        stages = in_full(stages, folder)
        steps = Steps(feedback, sum(stage.seconds(capacity) for stage in stages))
        for number, stage in enumerate(stages):
            file, duration_s = _file(folder, stage.name), stage.seconds(capacity)
            title = f"stage {number + 1} of {len(stages)}, {stage.name}: {stage.question}"
            with steps.step(title, duration_s, file.is_file()):
                if not file.is_file():
                    _write(stage.run(), folder, stage.name)


def _write(result: StageResult, folder: Path, stage: str) -> None:
    """Write the file of a stage, with its digest and whose it is."""
    whose = {"schema_version": 2, "stage": stage, "reproduction": file_digest(folder / MARK)}
    # Without line breaks: matrices would take a line for every number.
    content = json_text(result.model_copy(update=whose).sealed()) + "\n"
    replace_file(_file(folder, stage), partial(Path.write_text, data=content, encoding="utf-8"))


Result = TypeVar("Result", bound=StageResult)


def result_of(folder: Path, stage: str, kind: type[Result]) -> Result | None:
    """Return what a stage measured, or None where it was not run.

    kind: what its file holds. Raises InputError where the file is damaged, or of another stage or reproduction.
    """
    file = _file(folder, stage)
    try:
        result = read_json(kind, file)
        if result is not None and result.schema_version > 1:
            if result.stage != stage:
                raise InputError(f"{file}: stage: is {result.stage!r}, not {stage!r}")
            if result.reproduction != file_digest(folder / MARK):
                raise InputError(f"{file}: reproduction: is not the digest of {MARK}; it is another reproduction's")
    except InputError as error:
        raise InputError(f"{error}; delete the file, and run the same command again") from None
    return result


def identity_of(paper: str, size: str, settings: dict[str, Any]) -> Identity:
    """Return the identity of a reproduction with the installed versions."""
    return Identity(paper=paper, size=size, settings=settings, versions=versions(OF_RUNS))


def _identify(folder: Path, identity: Identity) -> None:
    """Write the identity of a claimed folder, or check it against the one that is there."""
    file = folder / MARK
    stored = read_json(Identity, file)
    if stored is None:
        write_json(file, identity.model_dump(mode="json"))
    elif stored.model_dump(mode="json") != identity.model_dump(mode="json"):
        raise InputError(
            f"{folder}: holds a reproduction of another paper, size, setting or version; choose another folder with -o"
        )


def _file(folder: Path, stage: str) -> Path:
    return folder / STAGES / f"{stage}.json"
