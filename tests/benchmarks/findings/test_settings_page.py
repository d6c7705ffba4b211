"""docs/settings.md is written from the settings objects, and is up to date."""

from __future__ import annotations

import re
import tomllib

from isac_cosim.benchmarks.findings import settings_page
from isac_cosim.studies.study import Study

PAGE = settings_page.PAGE.read_text(encoding="utf-8")


def rows(section: str) -> list[list[str]]:
    """Return the cells of the table under a section's heading."""
    text = PAGE.partition(f"## `[{section}]`\n")[2].split("\n## ")[0]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in text.splitlines() if "| `" in line]


def test_the_page_is_up_to_date() -> None:
    assert settings_page.written() == PAGE, "run `make settings`"


def test_every_setting_says_what_it_is() -> None:
    silent = [line for line in PAGE.splitlines() if re.match(r"\| `\w+` \|[^|]*\| *\|", line)]
    assert silent == []


def test_the_defaults_are_written_as_a_study_file_takes_them() -> None:
    """The sections of the dataset, read as a study file, make the default study again."""
    sections = re.findall(r"^## `\[(dataset[\w.]*)\]`", PAGE, flags=re.MULTILINE)
    files = ("dataset.fcd", "dataset.levelx", "dataset.ngsim", "dataset.kinematics", "dataset.sensing.scene")
    text = ""
    for section in sections:
        if not section.startswith(files):
            lines = [f"{row[0].strip('`')} = {row[1].strip('`')}" for row in rows(section) if row[1]]
            text += "\n".join([f"[{section}]", *lines, ""])
    assert len(text.splitlines()) > 150
    assert Study.model_validate(tomllib.loads(text)) == Study()
