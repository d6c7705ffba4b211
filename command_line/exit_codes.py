"""How a command ends: its exit code, and in one line what went wrong."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from typing import Any

import typer

from isac_cosim.base.errors import NO_ROOM, WRONG_PATH, InputError, RunError, output_error

DONE, FAILED, WRONG_INPUT, INTERRUPTED = 0, 1, 2, 130
LONGEST = 1000
"""Longest error message, characters."""
KEPT = "interrupted; what was finished is kept, and the same command continues from there"


def exit_code(command: Callable[[], Any]) -> int:
    """Run a command and return its exit code; an error that the user can fix is one line on standard error."""
    usage_error: Any = typer.BadParameter.__base__
    try:
        code = int(command() or DONE)
    except InputError as error:
        return _complain(str(error), WRONG_INPUT)
    except usage_error as error:
        return _complain(f"{error.format_message()} Try `cosim --help`.", WRONG_INPUT)
    except RunError as error:
        return _complain(str(error), FAILED)
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except OSError as error:
        if error.errno in NO_ROOM:
            return _complain(str(output_error(error.filename or "the output", error)), FAILED)
        if error.errno in WRONG_PATH and error.filename is not None:
            message = f"{error.filename}: cannot be used ({error.strerror}); fix that, or give another path"
            return _complain(message, WRONG_INPUT)
        traceback.print_exc()
        return FAILED
    except Exception:
        traceback.print_exc()
        return FAILED
    # Newer versions of typer turn Ctrl-C into this code themselves.
    return _complain(KEPT, code) if code == INTERRUPTED else code


def _complain(message: str, code: int) -> int:
    """Print one line, of bounded length and without control characters. Returns the code."""
    line = "".join(letter if letter.isprintable() else "?" for letter in " ".join(message.split()))
    print(f"cosim: {line if len(line) <= LONGEST else line[:LONGEST] + '...'}", file=sys.stderr)
    return code
