"""The plan: the stages that make every figure of the documents, each with its commands, its cost and its pages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Annotated, Self

from pydantic import AfterValidator, Field, field_validator, model_validator

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import file_digest
from isac_cosim.base.registry import nearest
from isac_cosim.base.settings import Settings, checked, read_toml
from isac_cosim.studies.study import Study, read_study
from isac_cosim.studies.world import PARTS, WITHOUT_SCENES

PLAN = Path(__file__).with_name("plan.toml")
ROOT = Path(__file__).resolve().parents[3]
"""The checkout."""


def _inside(path: str) -> str:
    if Path(path).is_absolute() or ".." in Path(path).parts:
        raise ValueError(f"{path}: lies outside of the checkout; give a path from its top")
    return path


Inside = Annotated[str, AfterValidator(_inside)]
"""A path from the top of the checkout."""


class FigureStage(Settings):
    """A step of the plan.

    commands: shell commands, run at the top of the checkout with $FIGURES, the folder of all stages' work, and
    $WORKERS, the options that say on what they run. They continue where they were interrupted. tables: commands that
    print the tables of the results in Markdown (`pages.printed_tables`).
    """

    question: str = Field(min_length=1, description="what the figures answer")
    commands: tuple[str, ...] = Field(min_length=1)
    results: tuple[Inside, ...] = Field(min_length=1, description="files that the commands leave, or patterns of them")
    tables: tuple[str, ...] = ()
    pages: tuple[Inside, ...] = Field((), description="pages that show the figures")
    kept: tuple[Inside, ...] = Field(
        (), description="files, or patterns of them, that finished parts leave in the folder of the stage's work"
    )
    given: dict[Inside, str] = Field(
        default_factory=dict,
        description="files that commands read and the project does not ship: what to put there",
    )
    cost_min: float = Field(gt=0.0, description="duration on two cores, minutes")
    cost_is: str = Field(min_length=1, description="where the cost comes from")
    needs: tuple[str, ...] = Field((), description="stages whose results the commands read")
    study: Inside | None = Field(None, description="the study file whose settings count; the defaults if absent")
    parts: tuple[str, ...] = Field(
        WITHOUT_SCENES, min_length=1, description="parts of the settings that the figures rest on"
    )
    reads: tuple[Inside, ...] = Field((), description="files besides, or patterns of them, whose content counts")
    measurement: tuple[str, ...] = Field((), description="modules that measure, whose constants count, too")

    @field_validator("parts")
    @classmethod
    def _known_parts(cls, parts: tuple[str, ...]) -> tuple[str, ...]:
        if unknown := [part for part in parts if part not in PARTS]:
            raise ValueError(f"{unknown[0]}: no such part; there are {', '.join(PARTS)}")
        return parts

    @property
    def in_documents(self) -> bool:
        """Whether its results lie in the documents, and are no step between."""
        return any(path.startswith("docs/") for path in self.results)

    def files(self, root: Path) -> dict[str, list[Path]]:
        """Return the results that are there, by the path or pattern that names them."""
        return {pattern: sorted(path for path in root.glob(pattern) if path.is_file()) for pattern in self.results}

    def read_digests(self, root: Path) -> dict[str, str]:
        """Return the digest of each file besides the study whose content counts, by path."""
        found = sorted({path for pattern in self.reads for path in root.glob(pattern)})
        return {path.relative_to(root).as_posix(): file_digest(path) for path in found}

    def settings(self, root: Path) -> Study:
        """Return the study whose settings the figures rest on."""
        return Study() if self.study is None else read_study(root / self.study)


class Plan(Settings):
    """All stages, by name."""

    stage: dict[Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]*$")], FigureStage]

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for name, stage in self.stage.items():
            if unknown := [other for other in stage.needs if other not in self.stage]:
                raise ValueError(f"{name}: needs {unknown[0]}, which is no stage")
        try:
            TopologicalSorter({name: stage.needs for name, stage in self.stage.items()}).prepare()
        except CycleError as error:
            raise ValueError(f"stages need each other: {' -> '.join(error.args[1])}") from None
        owners: dict[str, str] = {}
        for name, stage in self.stage.items():
            for result in stage.results:
                if owners.setdefault(result, name) != name:
                    raise ValueError(f"{result}: is the result of {owners[result]} and of {name}")
        return self

    def chosen(self, names: Iterable[str]) -> Mapping[str, FigureStage]:
        """Return the stages with these names, and those whose results they need; all if there are no names.

        Raises InputError for a name that is no stage.
        """
        wanted = list(names) or list(self.stage)
        offered = ", ".join(self.stage)
        for name in wanted:
            if name not in self.stage:
                raise InputError(f"{name}: no such stage; {nearest(name, self.stage)}choose among {offered}")
        found: set[str] = set()
        while wanted:
            name = wanted.pop()
            found.add(name)
            wanted += [other for other in self.stage[name].needs if other not in found]
        return {name: stage for name, stage in self.stage.items() if name in found}


def read_plan(path: Path = PLAN) -> Plan:
    """Return the plan in a file. Raises InputError where it is at fault."""
    return checked(Plan, read_toml(path), path)
