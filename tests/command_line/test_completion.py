"""Completion in the shell, asked for as a shell does."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

COSIM = Path(sys.executable).with_name("cosim")


@pytest.mark.parametrize(
    ("typed", "word", "offered"),
    [
        ("cosim gen", 1, "generate"),
        ("cosim train data --mod", 3, "--model"),
        ("cosim evaluate run --tra", 3, "--traffic"),
    ],
)
def test_commands_and_options_are_completed(typed: str, word: int, offered: str) -> None:
    asked = {"_COSIM_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": str(word)}
    done = subprocess.run([COSIM], env={**os.environ, **asked}, capture_output=True, text=True, check=True)
    assert offered in done.stdout.split()


def test_the_script_for_a_shell_is_shown() -> None:
    command = [str(COSIM), "--show-completion", "bash"]
    # Outside a shell there is none to be found.
    named = {**os.environ, "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    shown = subprocess.run(command, env=named, capture_output=True, text=True, check=True).stdout
    assert "complete -o default -F _cosim_completion cosim" in shown
