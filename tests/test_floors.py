"""The house: imports never run upward, folders make no circle, files and folders stay small, tests mirror it."""

from __future__ import annotations

import ast
from collections import Counter, defaultdict
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import cosim

ROOT = Path(cosim.__file__).parent
NAME = "isac_cosim"
"""The name that every package is imported under."""
FLOORS = (
    "base", "isacsim", "sumo_nets", "labeling", "models", "evaluation", "studies", "benchmarks", "command_line", "cosim"
)  # fmt: skip
"""The packages from the lowest up; each may import only itself and what is below it."""
LONGEST = 420
"""Lines of a file: about 400."""
MOST_FILES = 16
"""Modules in a folder."""
LARGEST_SHARE = 0.32
"""Of the largest package in all lines."""


def files() -> Iterator[Path]:
    """Every module of the project, tests left out."""
    yield ROOT / "cosim.py"
    for package in FLOORS[:-1]:
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
            names |= {alias.name.removeprefix(f"{NAME}.") for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            package = node.module.removeprefix(NAME).removeprefix(".")
            members = {f"{package}.{alias.name}".removeprefix(".") for alias in node.names}
            names |= {member if member in MODULES else package for member in members}
    return {name for name in names if name in MODULES}


IMPORTS = {module: imported(path) for module, path in MODULES.items()}
FOLDERS = sorted({path.parent.relative_to(ROOT) for path in MODULES.values()} - {Path()})


def room_of(module: str, folder: Path) -> str | None:
    """The room of a folder that a module lies in; the files of the folder itself are a room of their own, ".".

    None for a module that lies elsewhere, and for the folder's `__init__`, which may say what its rooms share.
    """
    path = MODULES[module].relative_to(ROOT)
    if not path.is_relative_to(folder) or path == folder / "__init__.py":
        return None
    inside = path.relative_to(folder).parts
    return inside[0] if len(inside) > 1 else "."


def fail_on_a_circle(graph: dict[str, set[str]]) -> None:
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"imports go round: {' -> '.join(error.args[1])}")


@pytest.mark.parametrize("module", MODULES)
def test_no_import_runs_upward(module: str) -> None:
    allowed = FLOORS[: FLOORS.index(module.split(".")[0]) + 1]
    assert {name.split(".")[0] for name in IMPORTS[module]} <= {*allowed}


def test_modules_make_no_circle() -> None:
    fail_on_a_circle({module: names - {module} for module, names in IMPORTS.items()})


@pytest.mark.parametrize("folder", FOLDERS, ids=str)
def test_the_rooms_of_a_folder_make_no_circle(folder: Path) -> None:
    graph: dict[str, set[str]] = defaultdict(set)
    for module, names in IMPORTS.items():
        room = room_of(module, folder)
        if room is not None:
            graph[room] |= {other for name in names if (other := room_of(name, folder)) not in (None, room)}  # type: ignore[misc]
    fail_on_a_circle(graph)


def test_the_circle_test_sees_a_circle() -> None:
    with pytest.raises(pytest.fail.Exception, match="imports go round"):
        fail_on_a_circle({"radio": {"tracking"}, "tracking": {"radio"}})


@pytest.mark.parametrize("room", ["radio", "tracking"])
def test_radio_and_tracking_do_not_know_each_other(room: str) -> None:
    other = {"radio": "tracking", "tracking": "radio"}[room]
    for module, names in IMPORTS.items():
        if module.startswith(f"isacsim.{room}."):
            assert not [name for name in names if name.startswith(f"isacsim.{other}")]


@pytest.mark.parametrize("module", MODULES)
def test_files_are_small(module: str) -> None:
    assert len(MODULES[module].read_text(encoding="utf-8").splitlines()) <= LONGEST


def test_folders_are_small() -> None:
    counts = Counter(path.parent for path in MODULES.values())
    assert {str(folder.relative_to(ROOT)): n for folder, n in counts.items() if n > MOST_FILES} == {}


def test_no_package_holds_most_of_the_house() -> None:
    lines: Counter[str] = Counter()
    for module, path in MODULES.items():
        lines[module.split(".")[0]] += len(path.read_text(encoding="utf-8").splitlines())
    largest, count = lines.most_common(1)[0]
    assert count / lines.total() < LARGEST_SHARE, largest


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
