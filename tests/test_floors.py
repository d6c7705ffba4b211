"""The house: imports never run upward, folders make no circle, files and folders stay small, tests mirror it."""

from __future__ import annotations

import ast
import re
from collections import Counter
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from isac_cosim.benchmarks.findings.architecture import FLOORS, imports, modules, rooms
from isac_cosim.benchmarks.findings.figures.plan import ROOT

LONGEST = 420
"""Lines of a file: about 400."""
MOST_FILES = 16
"""Modules in a folder."""
LARGEST_SHARE = 0.28
"""Of the largest package in all lines."""
MODULES, IMPORTS = modules(), imports()
ENTRANCES = re.compile(r"^(From .+ to |In comes? .+; out comes? )", re.MULTILINE | re.DOTALL)
FOLDERS = sorted({path.parent.relative_to(ROOT) for path in MODULES.values()} - {Path()})


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
    fail_on_a_circle({module: set(names - {module}) for module, names in IMPORTS.items()})


@pytest.mark.parametrize("folder", FOLDERS, ids=str)
def test_the_rooms_of_a_folder_make_no_circle(folder: Path) -> None:
    fail_on_a_circle(rooms(folder))


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


def test_every_room_says_what_comes_in_and_what_goes_out() -> None:
    silent = [
        str(path.relative_to(ROOT))
        for path in MODULES.values()
        if path.name == "__init__.py"
        and not ENTRANCES.search(ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "")
    ]
    assert silent == []


def test_tests_mirror_the_packages() -> None:
    """A test's folder is a folder of the project."""
    for path in (ROOT / "tests").rglob("test_*.py"):
        folder = path.parent.relative_to(ROOT / "tests")
        assert (ROOT / folder).is_dir(), f"{path}: tests a room that does not exist"
