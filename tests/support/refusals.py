"""How a command refuses bad input."""

from collections.abc import Sequence
from pathlib import Path

import pytest

import cosim


def refusal(arguments: Sequence[str], folder: Path, capfd: pytest.CaptureFixture[str]) -> str:
    """Run a command that refuses its input, and return the one line that it prints.

    folder: where it could write; nothing in it may come or go.
    """
    before = sorted(folder.rglob("*"))
    assert cosim.main(arguments) == 2
    printed = capfd.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("cosim: ")
    assert printed.err.endswith("\n")
    assert printed.err.count("\n") == 1
    assert sorted(folder.rglob("*")) == before
    return printed.err
