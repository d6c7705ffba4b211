"""Makes the figures: runs the stages that are not present, several side by side, and rewrites the pages' tables."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from functools import cached_property
from graphlib import TopologicalSorter
from pathlib import Path
from threading import Lock

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.feedback import SILENT, Feedback, spoken_time
from isac_cosim.base.files import digests_of
from isac_cosim.base.settings import read_json
from isac_cosim.benchmarks.findings.figures import unfinished
from isac_cosim.benchmarks.findings.figures.pages import claims, printed_tables, rewrite
from isac_cosim.benchmarks.findings.figures.plan import FigureStage, Plan
from isac_cosim.benchmarks.findings.figures.record import (
    PRESENT,
    WORK,
    Record,
    begun_file,
    record_file,
    record_now,
    status,
    with_results,
    write,
)

MADE = "made"
FINISHED = (PRESENT, MADE)
LOG = "log.txt"
"""What the commands of a stage print, in the folder of the stage."""


@dataclass(frozen=True)
class Maker:
    """Makes stages in a checkout. jobs: stages side by side. cluster: address that the commands run on, if any."""

    root: Path
    jobs: int = 1
    cluster: str | None = None
    feedback: Feedback = SILENT
    _pages: Lock = field(default_factory=Lock)

    def make(self, plan: Plan, names: list[str]) -> dict[str, str]:
        """Make the stages with these names and what they need, all of the plan without names.

        Returns what became of each: "present", "made", "failed: why" or "left out: STAGE failed". Raises InputError
        for a name that is no stage.
        """
        self._check_sources()
        stages = self._missing(plan, names)
        order = TopologicalSorter({name: set(stage.needs) & stages.keys() for name, stage in stages.items()})
        order.prepare()
        done: dict[str, str] = {}
        running: dict[Future[str], str] = {}
        with ThreadPoolExecutor(self.jobs) as pool:
            while order.is_active():
                for name in order.get_ready():
                    if failed := [other for other in stages[name].needs if done.get(other, MADE) not in FINISHED]:
                        done[name] = f"left out: {failed[0]} failed"
                        order.done(name)
                        self.feedback.message(f"{name}: {done[name]}")
                    else:
                        running[pool.submit(self._make_one, name, stages[name])] = name
                if running:
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        name = running.pop(future)
                        done[name] = future.result()
                        order.done(name)
                        record = record_file(name, stages[name], self.root).relative_to(self.root)
                        anew = f"; delete {record} to make it anew" if done[name] == PRESENT else ""
                        self.feedback.message(f"{name}: {done[name]}{anew}")
        return done

    def _missing(self, plan: Plan, names: list[str]) -> dict[str, FigureStage]:
        """Return the wanted stages, and of those that they need the ones that have to be made first.

        Without names, stages are wanted for the documents' sake: what they need is not made for itself.
        """
        stages = plan.chosen(names)
        wanted = set(names) or {name for name, stage in stages.items() if stage.in_documents}
        order = TopologicalSorter({name: stage.needs for name, stage in stages.items()}).static_order()
        kept: dict[str, FigureStage] = {}
        read: set[str] = set()
        for name in reversed(list(order)):
            if name in wanted or name in read:
                kept[name] = stages[name]
                if status(name, stages[name], self.root) != PRESENT:
                    read |= set(stages[name].needs)
        return kept

    def _make_one(self, name: str, stage: FigureStage) -> str:
        try:
            if status(name, stage, self.root) != PRESENT:
                self._run(name, stage)
                became = MADE
            else:
                became = PRESENT
            self.rewrite_pages(name, stage)
        except (InputError, RunError) as error:
            return f"failed: {error}"
        return became

    def _run(self, name: str, stage: FigureStage) -> None:
        """Run the commands of a stage, and write the record of its results.

        Raises InputError where the stage was begun with other settings, leaves a result out or lacks a file that it is
        given, RunError where a command fails or the code was changed meanwhile.
        """
        folder, begun = self.root / WORK / name, begun_file(name, self.root)
        for path, what in stage.given.items():
            if not (self.root / path).is_file():
                raise InputError(f"{path}: is not there; put there {what}")
        self._check_sources()
        if became := unfinished.go_on(name, stage, self.root):
            self.feedback.message(f"{name}: {became}")
        record = record_now(name, stage, self.root)
        before = read_json(Record, begun)
        if before is None and folder.exists():
            raise InputError(f"{folder}: does not say what made it; delete the folder, and run again")
        if before is not None and (difference := before.difference(record)):
            raise InputError(f"{folder}: was begun with other settings: {difference}; delete the folder, and run again")
        write(begun, record)
        cost = spoken_time(60.0 * stage.cost_min)
        self.feedback.message(f"{name}: about {cost} on two cores; prints to {folder / LOG}")
        for folder_of_results in {Path(result).parent for result in stage.results}:
            if "*" not in folder_of_results.as_posix():
                (self.root / folder_of_results).mkdir(parents=True, exist_ok=True)
        with (folder / LOG).open("a", encoding="utf-8") as log:
            for command in stage.commands:
                print(f"$ {command}", file=log, flush=True)
                code = subprocess.run(
                    command, shell=True, cwd=self.root, env=self._environment(), stdout=log, stderr=log, check=False
                ).returncode
                if code:
                    raise RunError(f"{command}: exit code {code}; see {folder / LOG}")
        self._check_sources()
        write(record_file(name, stage, self.root), with_results(record, stage, self.root))
        unfinished.discard(name, self.root)

    @cached_property
    def _sources(self) -> dict[str, str]:
        """The digests of the code when this process began: what it says of settings is of that code."""
        return _sources(self.root)

    def _check_sources(self) -> None:
        """Raise RunError where the code is no longer that of this process: commands would run other settings."""
        now = _sources(self.root)
        if changed := sorted(
            path for path in now.keys() | self._sources.keys() if now.get(path) != self._sources.get(path)
        ):
            raise RunError(f"{changed[0]} was changed meanwhile; run again: what is finished and still holds is kept")

    def rewrite_pages(self, name: str, stage: FigureStage) -> None:
        """Rewrite the tables of a stage in its pages. Raises RunError where a command fails that prints them."""
        tables: dict[str, str] = {}
        for command in stage.tables:
            printed = subprocess.run(
                command, shell=True, cwd=self.root, env=self._environment(), capture_output=True, text=True, check=False
            )
            if printed.returncode:
                raise RunError(f"{command}: exit code {printed.returncode}: {printed.stderr.strip().splitlines()[-1:]}")
            tables |= printed_tables(printed.stdout)
        with self._pages:
            for page in stage.pages:
                rewrite(self.root / page, name, tables)
                if claims((self.root / page).read_text(encoding="utf-8")).get(name) is False:
                    self.feedback.message(
                        f"{page}: bring its sentences up to date, and claim it: <!-- figures: present {name} -->"
                    )

    def _environment(self) -> Mapping[str, str]:
        """Return the environment of commands: this interpreter and this checkout first, and where they work."""
        cores = max(1, (os.cpu_count() or 1) // self.jobs)
        return {
            **os.environ,
            "PATH": os.pathsep.join((str(Path(sys.executable).parent), os.environ.get("PATH", ""))),
            "PYTHONPATH": os.pathsep.join(filter(None, (str(self.root), os.environ.get("PYTHONPATH")))),
            "FIGURES": WORK,
            "WORKERS": f"--cluster {self.cluster}" if self.cluster else f"--jobs {cores}",
            "JOBS": str(cores),
        }


def _sources(root: Path) -> dict[str, str]:
    """Return the digests of the code that a stage runs."""
    files = root.glob("*/**/*.py")
    return digests_of(path for path in files if path.relative_to(root).parts[0] not in ("tests", "results"))
