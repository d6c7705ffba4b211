"""How a command ends: its exit code, and in one line what went wrong."""

from __future__ import annotations

import signal
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import typer

from isac_cosim.base.errors import NO_ROOM, WRONG_PATH, InputError, RunError, output_error
from isac_cosim.base.workers import interrupts

DONE, FAILED, WRONG_INPUT, SIGNALLED = 0, 1, 2, 128
"""SIGNALLED is added to the number of the signal that ended the command, as shells do: 130 Ctrl-C, 143 SIGTERM."""
LONGEST = 1000
"""Longest error message, characters."""
KEPT = "interrupted; what was finished is kept, and the same command continues from there"


def exit_code(command: Callable[[], Any]) -> int:
    """Run a command and return its exit code; an error that the user can fix is one line on standard error."""
    code, error = DONE, None
    with interrupts.raised_alike():
        try:
            code = int(command() or DONE)
        except BaseException as raised:
            error = raised
    # Some libraries make an exit code or an error of their own of an interrupt.
    number = interrupts.received()
    if isinstance(error, KeyboardInterrupt | typer.Abort) or code == SIGNALLED + signal.SIGINT:
        number = number or signal.SIGINT
    if number is not None:
        return _complain(KEPT, SIGNALLED + number)
    return code if error is None else _code_of(error)


def _code_of(error: BaseException) -> int:
    """Print what went wrong, and return the exit code for it."""
    usage_error: Any = typer.BadParameter.__base__
    if isinstance(error, usage_error):
        return _complain(f"{error.format_message()} Try `cosim --help`.", WRONG_INPUT)
    from isac_cosim.base.shortages import shortage  # only now, because help has to answer at once

    if isinstance(error, Exception) and (lacking := shortage(error)) is not None:
        return _complain(str(lacking), FAILED)
    if isinstance(error, InputError):
        return _complain(str(error), WRONG_INPUT)
    if isinstance(error, RunError):
        return _complain(str(error), FAILED)
    if isinstance(error, OSError) and error.errno in NO_ROOM:
        return _complain(str(output_error(error.filename or "the output", error)), FAILED)
    if isinstance(error, OSError) and error.errno in WRONG_PATH and error.filename is not None:
        message = f"{error.filename}: cannot be used ({error.strerror}); fix that, or give another path"
        return _complain(message, WRONG_INPUT)
    if not isinstance(error, Exception):
        raise error
    traceback.print_exception(error)
    return FAILED


def _complain(message: str, code: int) -> int:
    """Print one line, of bounded length and without control characters. Returns the code."""
    line = "".join(letter if letter.isprintable() else "?" for letter in " ".join(message.split()))
    with suppress(OSError):  # a terminal that was closed takes no more
        print(f"cosim: {line if len(line) <= LONGEST else line[:LONGEST] + '...'}", file=sys.stderr, flush=True)
    return code
