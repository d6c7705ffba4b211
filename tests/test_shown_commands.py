"""The commands that the documents and the figures' plan show: each exists, with its options, modules and files."""

from __future__ import annotations

import ast
import re
import shlex
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

import cosim
from isac_cosim.benchmarks.findings.figures.plan import read_plan
from tests.command_line.test_help import commands

ROOT = Path(cosim.__file__).parent
COMMANDS = commands()
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("sumo_nets/**/*.md")])
TEXTS = {str(page.relative_to(ROOT)): page.read_text(encoding="utf-8") for page in PAGES}
BLOCK_LINE = re.compile(r"^ {4,}(?:\$ )?((?:cosim|python -m|make|pytest) .*)$", re.MULTILINE)
IN_TEXT = re.compile(r"`((?:cosim|python -m|make|pytest)\s[^`]+)`")


def words_of(line: str) -> list[str]:
    """The words of a command, without the comment behind it, or the sign that it goes on in another line."""
    return shlex.split(line.rstrip("\\"), comments=True)


def command_of(words: list[str]) -> tuple[Any, list[str]] | None:
    """The command that words call, and the words after its name; None without one, or for a group of commands."""
    if not words or words[0].startswith("-") or words[0].isupper():
        return None
    for length in (2, 1):
        name = " ".join(words[:length])
        if name in COMMANDS:
            return COMMANDS[name], words[length:]
    if any(name.startswith(f"{words[0]} ") for name in COMMANDS):
        return None
    pytest.fail(f"cosim {' '.join(words)}: there is no such command")


SHOWN = sorted({(page, line) for page, text in TEXTS.items() for line in BLOCK_LINE.findall(text)})
NAMED = sorted({(page, " ".join(line.split())) for page, text in TEXTS.items() for line in IN_TEXT.findall(text)})


@pytest.mark.parametrize(("page", "line"), [shown for shown in SHOWN if shown[1].startswith("cosim ")])
def test_a_command_in_a_block_is_understood(page: str, line: str) -> None:
    if found := command_of(words_of(line)[1:]):
        command, rest = found
        command.make_context(command.name, [word for word in rest if word != "…"])


@pytest.mark.parametrize(("page", "line"), [named for named in NAMED if named[1].startswith("cosim ")])
def test_a_command_in_a_sentence_has_its_options(page: str, line: str) -> None:
    """A sentence may leave out arguments."""
    if found := command_of(words_of(line)[1:]):
        command, rest = found
        known = {option for parameter in command.params for option in [*parameter.opts, *parameter.secondary_opts]}
        given = {word.partition("=")[0] for word in rest if re.match(r"--?[a-z]", word)}
        assert given <= known | {"--help"}


@pytest.mark.parametrize(("page", "line"), [line for line in SHOWN + NAMED if not line[1].startswith("cosim ")])
def test_another_command_names_what_there_is(page: str, line: str) -> None:
    words = words_of(line)
    if words[0] == "python" and words[2].startswith("isac_cosim"):
        assert words[2].endswith("NAME") or find_spec(words[2]) is not None
    elif words[0] == "make":
        targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
        assert {word for word in words[1:] if "=" not in word} <= targets
        stages = [word.removeprefix("STAGE=") for word in words if word.startswith("STAGE=")]
        assert set(stages) <= {"list", "withdraw", "keep", *read_plan().stage}
    elif words[0] == "pytest":
        assert all((ROOT / word).exists() for word in words if word.startswith("tests/"))


PLANNED = sorted({line for stage in read_plan().stage.values() for line in (*stage.commands, *stage.tables)})


@pytest.mark.parametrize("line", PLANNED)
def test_a_command_of_the_plan_is_understood(line: str) -> None:
    """Nobody runs some of these for months."""
    words = [word for word in words_of(line.partition(">")[0]) if word != "$WORKERS"]
    if words[0] == "cosim":
        found = command_of(words[1:])
        assert found is not None
        found[0].make_context(found[0].name, ["2" if word == "$JOBS" else word for word in found[1]])
    elif words[:2] == ["python", "-c"]:
        for node in ast.walk(ast.parse(words[2])):
            if isinstance(node, ast.ImportFrom) and node.module:
                assert {alias.name for alias in node.names} <= set(dir(import_module(node.module)))
