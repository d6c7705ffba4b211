"""What people see of a command where standard error is a file or a pipe."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from rich.table import Table

import cosim
from isac_cosim.command_line.output import console_of

WIDE = """
from rich.table import Table
from isac_cosim.command_line.output import console_of
table = Table("a", *[f"heading of column {k}" for k in range(12)])
table.add_row("row", *[f"content {k} of a cell that is long" for k in range(12)])
console_of(quiet=False).print(table)
"""


def test_no_table_of_any_command_is_cut_off_in_a_pipe() -> None:
    command = [sys.executable, "-c", WIDE]
    text = subprocess.run(command, cwd=Path(cosim.__file__).parent, capture_output=True, text=True, check=True).stderr
    for k in range(12):
        assert f"heading of column {k} " in text
        assert f"content {k} of a cell that is long" in text


def test_a_quiet_console_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    console_of(quiet=True).print(Table("a"))
    assert capsys.readouterr() == ("", "")
