"""What SUMO says: its warnings, counted by kind, and the reason why it refuses a scenario.

SUMO writes warnings into a log, in their thousands where something is wrong. Errors that end its start go to the error
stream alone; the exception beside them says `Process Error`.
"""

from __future__ import annotations

import contextlib
import os
import re
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from pydantic import Field

from isac_cosim.base.settings import Settings

WARNING, ERROR = "Warning:", "Error:"
"""The beginnings of SUMO's messages."""
ENDING = "Quitting"
"""The beginning of the line that follows an error."""
MOST_KINDS = 20
"""So many kinds of warnings are told apart; the others are counted together."""
OTHER = "other warnings"
MOST_CHARACTERS = 300
"""Longest example of a warning, and longest reason."""
_NAMED = re.compile(r"'[^']*'")
_DIGITS = re.compile(r"(\d\.\d{3})\d+")
_NUMBER = re.compile(r"(?<![\w.])-?\d+(\.\d+)?(e[+-]?\d+)?(?![\w])")


class SumoWarning(Settings):
    """The warnings of one kind that SUMO gave in a simulation.

    kind: their text, with `'...'` in place of each name and `#` of each number. count: how many. example: the first of
    them, without the folders of files, and with three decimals of numbers.
    """

    kind: str
    count: int = Field(ge=1)
    example: str

    def __str__(self) -> str:
        return f"SUMO warned {'once' if self.count == 1 else f'{self.count} times, for example'}: {self.example}"


def warnings_in(log: Iterable[str], folders: Iterable[Path] = ()) -> tuple[SumoWarning, ...]:
    """Return the warnings of a log by kind, in the order in which the kinds appear.

    folders: their names are left out of the examples, so that these do not depend on where a scenario lies.
    """
    counts: dict[str, int] = {}
    examples: dict[str, str] = {}
    for text in _messages(log, WARNING):
        kind = _NUMBER.sub("#", _NAMED.sub("'...'", text))
        if kind not in counts and len(counts) >= MOST_KINDS:
            kind = OTHER
        counts[kind] = counts.get(kind, 0) + 1
        examples.setdefault(kind, _DIGITS.sub(r"\1", text))
    parts = _beginnings(folders)
    return tuple(
        SumoWarning(kind=_without(parts, kind), count=count, example=_without(parts, examples[kind]))
        for kind, count in counts.items()
    )


def added_up(episodes: Iterable[Iterable[SumoWarning]]) -> tuple[SumoWarning, ...]:
    """Return the warnings of several simulations, added up by kind, the most frequent kind first."""
    counts: dict[str, int] = {}
    examples: dict[str, str] = {}
    for warning in (warning for episode in episodes for warning in episode):
        counts[warning.kind] = counts.get(warning.kind, 0) + warning.count
        examples.setdefault(warning.kind, warning.example)
    order = sorted(counts, key=lambda kind: -counts[kind])
    return tuple(SumoWarning(kind=kind, count=counts[kind], example=examples[kind]) for kind in order)


def reason_of(error: object, said: Iterable[str], folders: Iterable[Path] = ()) -> str:
    """Return why SUMO refuses a scenario, in one line: what it said, or else the text of its exception.

    said: what it wrote to the error stream. folders: their names are left out.
    """
    reasons = list(dict.fromkeys(_messages(said, ERROR)))
    text = "; ".join(reasons) or " ".join(str(error).split()) or type(error).__name__
    return _without(_beginnings(folders), text).rstrip(".")


@contextlib.contextmanager
def heard(folder: Path) -> Iterator[list[str]]:
    """Take what SUMO writes to the process's error stream inside the block; the list holds its lines at the end.

    folder: for a temporary file. What others write in the meantime goes to the error stream afterwards.
    """
    said: list[str] = []
    try:
        stream = os.dup(2)
    except OSError:  # there is no error stream
        yield said
        return
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            os.dup2(file.fileno(), 2)
            try:
                yield said
            finally:
                os.dup2(stream, 2)
                file.seek(0)
                said += file.read().decode(errors="replace").splitlines()
                for line in _of_others(said):
                    os.write(stream, f"{line}\n".encode())
    finally:
        os.close(stream)


def _messages(lines: Iterable[str], beginning: str) -> Iterator[str]:
    """Yield the texts of the messages that begin so, each in one line. A line that begins with a blank goes on."""
    text: str | None = None
    for line in lines:
        if text is not None and line.startswith(" "):
            text = f"{text} {line}"
            continue
        if text is not None:
            yield " ".join(text.split())
        text = line.removeprefix(beginning) if line.startswith(beginning) else None
    if text is not None:
        yield " ".join(text.split())


def _of_others(lines: Iterable[str]) -> Iterator[str]:
    """Yield the lines that are no message of SUMO's."""
    of_sumo = False
    for line in lines:
        of_sumo = line.startswith((ERROR, WARNING, ENDING)) or (of_sumo and line.startswith(" ")) or not line
        if not of_sumo:
            yield line


def _beginnings(folders: Iterable[Path]) -> list[str]:
    """Return what paths in some folders begin with, the longest first."""
    return sorted({f"{folder}{os.sep}" for folder in folders}, key=len, reverse=True)


def _without(parts: Iterable[str], text: str) -> str:
    for part in parts:
        text = text.replace(part, "")
    return _short(text)


def _short(text: str) -> str:
    return text if len(text) <= MOST_CHARACTERS else f"{text[:MOST_CHARACTERS]}..."
