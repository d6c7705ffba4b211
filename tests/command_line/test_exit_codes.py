"""How a command ends: the exit code and the one line of each kind of error."""

from __future__ import annotations

import errno

import pytest
import typer

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.command_line.exit_codes import exit_code


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (InputError("no such road; draw one"), 2, "cosim: no such road; draw one"),
        (RunError("SUMO\nfailed"), 1, "cosim: SUMO failed"),
        (typer.BadParameter("not a number"), 2, "Try `cosim --help`."),
        (KeyboardInterrupt(), 130, "the same command continues from there"),
        (OSError(errno.ENOSPC, "no space", "out"), 1, "out"),
        (PermissionError(errno.EACCES, "Permission denied", "mine.xml"), 2, "mine.xml: cannot be used"),
    ],
)
def test_an_error_that_can_be_fixed_is_one_line(
    error: BaseException, code: int, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail() -> None:
        raise error

    assert exit_code(fail) == code
    printed = capsys.readouterr().err
    assert line in printed
    assert printed.count("\n") == 1


@pytest.mark.parametrize("error", [ZeroDivisionError("ours"), OSError(errno.EIO, "Input/output error")])
def test_a_fault_of_the_tool_shows_its_traceback(error: Exception, capsys: pytest.CaptureFixture[str]) -> None:
    def fail() -> None:
        raise error

    assert exit_code(fail) == 1
    assert "Traceback" in capsys.readouterr().err


def test_a_long_line_is_cut_and_has_no_control_characters(capsys: pytest.CaptureFixture[str]) -> None:
    def fail() -> None:
        raise InputError("\x1b[31m" + "x" * 2000)

    exit_code(fail)
    printed = capsys.readouterr().err
    assert "\x1b" not in printed
    assert len(printed) < 1100


def test_what_a_command_returns_is_its_exit_code() -> None:
    assert exit_code(lambda: None) == 0
    assert exit_code(lambda: 1) == 1
