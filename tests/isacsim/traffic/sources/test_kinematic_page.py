"""docs/kinematic.md and studies/kinematic.toml against the code: every setting, its default, unit and source."""

from __future__ import annotations

import importlib.resources
import re
from pathlib import Path
from typing import Any

import pytest

from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.sources.kinematic_settings import KinematicSettings
from isac_cosim.studies.study import read_study

PAGE = (Path(__file__).parents[4] / "docs" / "kinematic.md").read_text(encoding="utf-8")
STUDY = Path(str(importlib.resources.files("isac_cosim.studies") / "kinematic.toml"))
UNITS = {"_mps3": "m/s³", "_mps2": "m/s²", "_mps": "m/s", "_m": "m", "_s": "s"}
DEFAULTS = KinematicSettings()
SECTIONS = {"kinematics": DEFAULTS} | {name: value for name, value in DEFAULTS if isinstance(value, Settings)}


def rows(name: str) -> dict[str, list[str]]:
    """The table under a section's heading: the other cells of each row, by the setting in the first one."""
    _, _, after = PAGE.partition(f"### `{name}`: ")
    lines = re.split(r"^##", after, flags=re.MULTILINE)[0].splitlines()
    cells = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in lines if line.startswith("|")]
    return {row[0].strip("`"): row[1:] for row in cells if re.fullmatch(r"`\w+`", row[0])}


def written(default: Any) -> str:
    return f"{default[0]:g} to {default[1]:g}" if isinstance(default, tuple) else f"{default:g}"


@pytest.mark.parametrize("name", SECTIONS)
def test_the_table_of_a_section_is_its_settings(name: str) -> None:
    settings, table = SECTIONS[name], rows(name)
    fields = {
        key: field
        for key, field in type(settings).model_fields.items()
        if not isinstance(getattr(settings, key), Settings)
    }
    assert list(table) == list(fields)
    for key, field in fields.items():
        default, unit, description, source = table[key]
        assert isinstance(field.json_schema_extra, dict)
        expected_unit = next((text for suffix, text in UNITS.items() if key.endswith(suffix)), "1")
        assert (default, unit) == (written(field.default), expected_unit), key
        assert source == field.json_schema_extra["source"], key
        assert field.description is not None
        assert field.description.startswith(description)


def test_the_study_file_lists_every_default_and_splits_like_the_paper() -> None:
    study = read_study(STUDY)
    assert study.dataset.kinematics == DEFAULTS
    listed = re.findall(r"^(\w+) = ", STUDY.read_text(encoding="utf-8"), flags=re.MULTILINE)
    for settings in SECTIONS.values():
        names = {name for name in type(settings).model_fields if not isinstance(getattr(settings, name), Settings)}
        assert names <= set(listed)
    episodes, per_episode = len(study.dataset.seeds), 6 * study.dataset.kinematics.per_class
    assert episodes * per_episode == 7200
    for share in (study.training.split.validation, study.training.split.test):
        assert abs(round(share * episodes) * per_episode - 1200) < per_episode
    assert study.training.optimiser.clip_norm == 0.0
