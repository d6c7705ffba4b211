"""The SUMO that answers is the one that results name."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.traffic.sources.sumo_library import NEEDED, check_version, load_libsumo

ROOT = Path(__file__).parents[4]


def test_the_installed_library_answers_with_its_version() -> None:
    assert load_libsumo().getVersion()[1] == f"SUMO {version('libsumo')}"


def test_another_release_is_refused_with_its_place(tmp_path: Path) -> None:
    module = ModuleType("libsumo")
    module.__file__ = str(tmp_path / "libsumo/__init__.py")
    with pytest.raises(
        InputError, match=rf"{tmp_path}/libsumo: is libsumo 1\.27\.1, but SUMO {NEEDED} is needed; take "
    ):
        check_version("libsumo", module, "1.27.1")
    with pytest.raises(InputError, match=rf"is libsumo {NEEDED}\.9, but {version('libsumo')} is installed"):
        check_version("libsumo", module, f"{NEEDED}.9")
    check_version("libsumo", module, version("libsumo"))


def test_a_library_on_the_python_path_ends_the_command(tmp_path: Path) -> None:
    """Before a simulation starts: the dataset has no shard."""
    done = with_another_library(
        tmp_path, "generate", "straight_road", "-o", str(tmp_path / "data"), "--seeds", "1:1", "--jobs", "1", "--quiet"
    )
    assert done.returncode == 2
    assert done.stderr.startswith(f"cosim: {tmp_path / 'path/libsumo'}: is libsumo 1.27.1, but SUMO {NEEDED} is needed")
    assert done.stderr.count("\n") == 1
    assert not any((tmp_path / "data/shards").iterdir())


def test_the_version_shown_is_not_that_of_a_library_that_would_not_answer(tmp_path: Path) -> None:
    done = with_another_library(tmp_path, "--version")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"cosim: {tmp_path / 'path/libsumo'}: is libsumo 1.27.1, but SUMO {NEEDED} is needed")


def with_another_library(folder: Path, *command: str) -> subprocess.CompletedProcess[str]:
    """A finished command, with a libsumo of another release first on its path."""
    (folder / "path/libsumo").mkdir(parents=True)
    (folder / "path/libsumo/__init__.py").write_text('getVersion = lambda: (21, "SUMO 1.27.1")\n')
    environment = {**os.environ, "PYTHONPATH": f"{folder / 'path'}{os.pathsep}{ROOT}"}
    return subprocess.run(
        [sys.executable, "cosim.py", *command], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
