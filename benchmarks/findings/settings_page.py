"""Writes docs/settings.md from the settings objects: every setting of a study, its default, and where that comes from.

Run: python -m isac_cosim.benchmarks.findings.settings_page
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from enum import Enum
from types import NoneType
from typing import Any, get_args

from pydantic_core import PydanticUndefined

from isac_cosim.base.files import replace_file
from isac_cosim.base.settings import Settings
from isac_cosim.benchmarks.findings.figures.plan import ROOT
from isac_cosim.evaluation.report.parts import markdown
from isac_cosim.isacsim.traffic.sources.registry import MOTION_SOURCES
from isac_cosim.models.predictors.registry import sections
from isac_cosim.studies.study import Study

PAGE = ROOT / "docs" / "settings.md"
TEXT = """# Settings

`make settings` writes this page from the settings objects; a test says when it is out of date.

Every setting of a study, by the section of the study file in which it stands ([studies.md](studies.md)). A setting that
is not given has its default. A pair such as `[4.0, 14.0]` is a range: where a maneuver or vehicle needs a value, it is
drawn from it evenly. Numbers beyond their bounds are refused in a line that names them. A source that begins with
"chosen" is this project's own choice, and says why; "measured" is what SUMO 1.28 did with such commands.
"""


def written() -> str:
    """Return the text of the page."""
    parts = [TEXT, *_section("", Study)]
    for name, source in MOTION_SOURCES.items():
        for section, settings in source.sections.items():
            parts += _section(f"dataset.{section}", settings, f" Of the source `{name}`.")
    for section, settings in sections().items():
        parts += _section(f"training.{section}", settings)
    return "\n".join(parts)


def _section(path: str, settings: type[Settings], remark: str = "") -> Iterator[str]:
    """Yield the parts of the page about a section of a study file, and those inside it."""
    inside = {name: of for name, field in settings.model_fields.items() if (of := _settings_of(field.annotation))}
    rows = [
        [
            f"`{name}`",
            _toml(field.get_default(call_default_factory=True)),
            _cell(field.description or _told(settings, name)),
            _source(field),
        ]
        for name, field in settings.model_fields.items()
        if name not in inside
    ]
    if rows:
        heading = f"`[{path}]`" if path else "The study itself"
        purpose = " ".join((settings.__doc__ or "").split("\n\n")[0].split())
        columns = ["setting", "default", "what it is", "source"]
        if not any(row[-1] for row in rows):
            columns, rows = columns[:-1], [row[:-1] for row in rows]
        yield f"## {heading}\n\n{purpose}{remark}\n\n{markdown(columns, rows)}\n"
    for name, of in inside.items():
        yield from _section(f"{path}.{name}" if path else name, of)


def _told(settings: type[Settings], name: str) -> str:
    """Return what the docstring of settings says of a field, "name: what it is."; nothing if that is missing."""
    text = " ".join((settings.__doc__ or "").split())
    told = re.search(rf"(?:^|[ ,]){name}(?:, \w+)*: (.+?)(?:\. |\.$)", text)
    return told[1] if told else ""


def _settings_of(annotation: Any) -> type[Settings] | None:
    """Return the settings that a field holds, also where it may hold none; None for any other field."""
    held = [part for part in (get_args(annotation) or (annotation,)) if part is not NoneType]
    return held[0] if len(held) == 1 and isinstance(held[0], type) and issubclass(held[0], Settings) else None


def _toml(value: Any) -> str:
    """Return a default as a study file writes it; nothing for what has none, or is left out."""
    if value is None or value is PydanticUndefined:
        return ""
    if isinstance(value, Enum):
        value = value.value
    if isinstance(value, float):
        short = f"{value:g}"
        return f"`{short if float(short) == value else repr(value)}`"
    if isinstance(value, tuple | list | frozenset | set):
        parts = [_toml(part).strip("`") for part in (sorted(value) if isinstance(value, frozenset | set) else value)]
        return f"`[{', '.join(parts)}]`"
    return f"`{json.dumps(value, default=str)}`"


def _source(field: Any) -> str:
    return _cell(field.json_schema_extra.get("source")) if isinstance(field.json_schema_extra, dict) else ""


def _cell(text: str | None) -> str:
    return " ".join((text or "").split()).replace("|", "\\|")


def main() -> None:
    """Write the page."""
    text = written()
    replace_file(PAGE, lambda partial: partial.write_text(text, encoding="utf-8"))


if __name__ == "__main__":
    main()
