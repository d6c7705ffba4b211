"""Help: it answers at once, is complete, and its examples are understood; the version."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer

import cosim
from isac_cosim.isacsim.scenarios.site_placement import PlacementSettings

ROOT = Path(cosim.__file__).parent


def test_help_answers_without_the_heavy_packages() -> None:
    code = (
        "import sys, cosim; cosim.main(['generate', '--help']); "
        "print(sorted({'torch', 'dask', 'libsumo'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert "--samples" in done.stdout
    assert "--windows" not in done.stdout


@pytest.mark.slow
def test_a_study_says_what_will_happen_before_it_loads_what_measures() -> None:
    code = (
        "import sys, isac_cosim.command_line.study, isac_cosim.studies.single, isac_cosim.studies.cost_estimate; "
        "print(sorted({'lightning', 'matplotlib', 'pandas', 'scipy.stats', 'sklearn'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def commands() -> dict[str, Any]:
    """Every command by what calls it, `network sites`."""
    root: Any = typer.main.get_command(cosim.app)
    leaves = {}
    for name, command in root.commands.items():
        parts = getattr(command, "commands", None)
        leaves |= {f"{name} {part}": leaf for part, leaf in parts.items()} if parts else {name: command}
    return leaves


@pytest.mark.parametrize("name", commands())
def test_help_is_complete_and_its_examples_are_understood(name: str, capfd: pytest.CaptureFixture[str]) -> None:
    """Defaults and choices that only the packages know are filled in; every example has only known options."""
    assert cosim.main([*name.split(), "--help"]) == 0
    shown = capfd.readouterr().out
    assert not re.search(r"\{[a-z_]+\}", shown)
    command = commands()[name]
    lines = re.findall(r"`cosim ([^`]+)`", command.epilog)
    assert lines
    for line in lines:
        words = shlex.split(line)
        assert words[: len(name.split())] == name.split()
        command.make_context(name, words[len(name.split()) :])


def test_help_shows_the_defaults_of_the_settings(capfd: pytest.CaptureFixture[str]) -> None:
    assert cosim.main(["network", "sites", "--help"]) == 0
    shown = " ".join(capfd.readouterr().out.replace("│", "").split())
    for field in ("spacing_m", "set_back_m", "height_m"):
        assert f"Default: {PlacementSettings.model_fields[field].default:g}." in shown


def test_the_version_names_what_results_depend_on(capfd: pytest.CaptureFixture[str]) -> None:
    assert cosim.main(["--version"]) == 0
    assert re.fullmatch(r"isac-cosim \S+, SUMO 1\.\S+, torch 2\.\S+\n", capfd.readouterr().out)
