"""How a command ends: the exit code and the one line of each kind of error."""

from __future__ import annotations

import errno
import io
import os
import signal
import time

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
        (typer.Abort(), 130, "the same command continues from there"),
        (OSError(errno.ENOSPC, "no space", "out"), 1, "out"),
        (OSError(errno.EROFS, "Read-only file system", "out"), 1, "out"),
        (OSError(errno.EMFILE, "Too many open files", "in"), 1, "ulimit -n"),
        (MemoryError(), 1, "no memory is left"),
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


@pytest.mark.skipif(os.name != "posix", reason="signals are of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("turned_into", [None, SystemExit(1), RuntimeError("interrupted"), ImportError("half")])
def test_a_signal_is_one_line_and_its_own_exit_code(
    number: int, turned_into: BaseException | None, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also where a library makes an error of its own of it."""
    # A shell's background jobs ignore SIGINT, and what nohup starts SIGHUP.
    usual = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
    before = signal.signal(number, usual)

    def command() -> None:
        try:
            os.kill(os.getpid(), number)
            time.sleep(10)
        except KeyboardInterrupt:
            if turned_into is None:
                raise
            raise turned_into from None

    try:
        assert exit_code(command) == 128 + number
    finally:
        assert signal.getsignal(number) == usual
        signal.signal(number, before)
    printed = capsys.readouterr().err
    assert printed == "cosim: interrupted; what was finished is kept, and the same command continues from there\n"


def test_a_closed_terminal_does_not_change_the_exit_code(monkeypatch: pytest.MonkeyPatch) -> None:
    class Closed(io.StringIO):
        def write(self, _: str) -> int:
            raise OSError(errno.EIO, "Input/output error")

    def fail() -> None:
        raise InputError("no such road; draw one")

    monkeypatch.setattr("sys.stderr", Closed())
    assert exit_code(fail) == 2


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
