"""The Dockerfile: what it installs exists, its base is pinned, and the tool does not run as root."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from dockerfile_parse import DockerfileParser

import cosim

ROOT = Path(cosim.__file__).parent


@pytest.fixture
def instructions() -> list[dict[str, str]]:
    parsed = DockerfileParser(fileobj=io.BytesIO((ROOT / "Dockerfile").read_bytes()))
    return [step for step in parsed.structure if step["instruction"] != "COMMENT"]


def values(instructions: list[dict[str, str]], name: str) -> list[str]:
    return [step["value"] for step in instructions if step["instruction"] == name]


def test_the_base_is_pinned_to_a_python_that_the_tool_supports(instructions: list[dict[str, str]]) -> None:
    (base,) = values(instructions, "FROM")
    image, _, tag = base.partition(":")
    assert image == "python"
    assert tag.count(".") == 2
    assert tuple(map(int, tag.split("-")[0].split(".")))[:2] >= (3, 11)


def test_the_tool_runs_as_a_user_in_a_folder_of_its_own(instructions: list[dict[str, str]]) -> None:
    names = [step["instruction"] for step in instructions]
    assert values(instructions, "USER") == ["cosim"]
    assert names.index("USER") > max(k for k, name in enumerate(names) if name == "RUN")
    assert values(instructions, "WORKDIR")[-1] == "/work"
    assert values(instructions, "ENTRYPOINT") == ['["cosim"]']


def test_nothing_is_left_of_the_installation(instructions: list[dict[str, str]]) -> None:
    for command in values(instructions, "RUN"):
        assert "apt-get install" not in command or "rm -rf /var/lib/apt/lists" in command
        assert "pip install" not in command or command.count("pip install") == command.count("--no-cache-dir")


def test_results_and_environments_do_not_travel() -> None:
    left_out = (ROOT / ".dockerignore").read_text(encoding="utf-8").split()
    assert {".git", ".venv", "results", "build"} <= set(left_out)
