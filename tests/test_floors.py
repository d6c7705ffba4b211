"""The house: imports never run upward, rooms make no circle, files stay small, tests mirror the packages."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import cosim

ROOT = Path(cosim.__file__).parent
FLOORS = ("isacsim", "labeling", "models", "command_line", "cosim")
"""From the lowest up; each may import only itself and what is below it."""
BESIDE = ("benchmarks", "studies", "sumo_nets")
"""May import everything but the command line's entry; only the command line imports them."""
LONGEST = 420
"""Lines of a file: about 400."""


def files() -> Iterator[Path]:
    """Every module of the project, tests left out."""
    yield ROOT / "cosim.py"
    for package in (*FLOORS[:-1], *BESIDE):
        yield from sorted((ROOT / package).rglob("*.py"))


def module_of(path: Path) -> str:
    """`isacsim/radio/echo.py` -> `isacsim.radio.echo`."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


MODULES = {module_of(path): path for path in files()}


def imported(path: Path) -> set[str]:
    """The project's modules that a file imports at its top level or inside a function."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            members = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= {member if member in MODULES else node.module for member in members}
    return {name for name in names if name in MODULES}


def room_of(module: str) -> str:
    """`isacsim.radio.echo` -> `isacsim.radio`; a file that lies beside the rooms is a room of its own."""
    parts = module.split(".")
    return ".".join(parts[:2])


@pytest.mark.parametrize("module", MODULES)
def test_no_import_runs_upward(module: str) -> None:
    floor = module.split(".")[0]
    if floor in BESIDE:
        allowed = {*FLOORS[:-1], *BESIDE}
    else:
        allowed = {*FLOORS[: FLOORS.index(floor) + 1]}
        if floor in ("command_line", "cosim"):
            allowed |= {*BESIDE}
    assert {name.split(".")[0] for name in imported(MODULES[module])} <= allowed


@pytest.mark.parametrize("grain", [str, room_of], ids=["modules", "rooms"])
def test_there_is_no_circle(grain: type) -> None:
    graph: dict[str, set[str]] = defaultdict(set)
    for module, path in MODULES.items():
        graph[grain(module)] |= {grain(name) for name in imported(path)} - {grain(module)}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"imports go round: {' -> '.join(error.args[1])}")


@pytest.mark.parametrize("room", ["radio", "tracking"])
def test_radio_and_tracking_do_not_know_each_other(room: str) -> None:
    other = {"radio": "tracking", "tracking": "radio"}[room]
    for path in (ROOT / "isacsim" / room).glob("*.py"):
        assert not [name for name in imported(path) if name.startswith(f"isacsim.{other}")]


@pytest.mark.parametrize("module", MODULES)
def test_files_are_small(module: str) -> None:
    assert len(MODULES[module].read_text(encoding="utf-8").splitlines()) <= LONGEST


def test_every_room_says_what_it_is_for() -> None:
    silent = [
        str(path.relative_to(ROOT))
        for path in MODULES.values()
        if path.name == "__init__.py" and not ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert silent == []


def test_tests_mirror_the_packages() -> None:
    """A test's folder is a folder of the project."""
    for path in (ROOT / "tests").rglob("test_*.py"):
        folder = path.parent.relative_to(ROOT / "tests")
        assert (ROOT / folder).is_dir(), f"{path}: tests a room that does not exist"
