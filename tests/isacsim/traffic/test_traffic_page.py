"""docs/traffic.md against the code: every setting of commanded maneuvers, its default, unit, source and threshold."""

import re
from pathlib import Path
from typing import Any

import pytest

from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.drivers.speed_wander import SpeedWanderSettings
from isac_cosim.isacsim.traffic.drivers.sway import SwaySettings
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings
from isac_cosim.labeling.detectors.events import LabelSettings

PAGE = (Path(__file__).parents[3] / "docs" / "traffic.md").read_text(encoding="utf-8")
UNITS = {"_mps3": "m/s³", "_mps2": "m/s²", "_mps": "m/s", "_per_s": "1/s", "_hour": "1/h", "_share": "1", "_gain": "1"}
UNITS |= {"_w_per_kg": "W/kg"}
UNITS |= {"_m": "m", "_s": "s"}
SECTIONS = [name for name, value in ManeuverSettings() if isinstance(value, Settings)]
THRESHOLD = re.compile(r"([≥<]) `(\w+)\.(\w+)` \((.+)\)")


def rows(text: str) -> dict[str, list[str]]:
    """The rows of the tables in a text whose first cell is a setting's name, by that name: the other cells."""
    cells = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in text.splitlines() if "|" in line]
    return {row[0].strip("`"): row[1:] for row in cells if re.fullmatch(r"`[\w.]+`", row[0])}


def section(name: str) -> str:
    """The part of the page under a command's heading."""
    _, _, after = PAGE.partition(f"### `{name}`: ")
    assert after, f"docs/traffic.md has no heading for {name}"
    return re.split(r"^##", after, flags=re.MULTILINE)[0]


def written(default: Any) -> str:
    return f"{default[0]:g} to {default[1]:g}" if isinstance(default, tuple) else f"{default:g}"


def unit(name: str) -> str:
    return next(unit for suffix, unit in UNITS.items() if name.endswith(suffix))


@pytest.mark.parametrize("name", SECTIONS)
def test_the_table_of_a_command_is_its_settings(name: str) -> None:
    settings, table = getattr(ManeuverSettings(), name), rows(section(name))
    fields = type(settings).model_fields
    assert list(table) == list(fields)
    for key, field in fields.items():
        default, unit_cell, _, source, _ = table[key]
        assert isinstance(field.json_schema_extra, dict)
        assert (default, unit_cell) == (written(field.default), unit(key)), key
        assert source == field.json_schema_extra["source"], key


def test_every_command_has_a_heading_and_no_other() -> None:
    assert sorted(re.findall(r"^### `(\w+)`: ", PAGE, flags=re.MULTILINE)) == sorted(SECTIONS)


def test_the_rates_and_limits_are_those_of_the_director() -> None:
    before, _, _ = PAGE.partition("## What reactions and commands are like")
    table = rows(before)
    single = {name: field for name, field in ManeuverSettings.model_fields.items() if name not in SECTIONS}
    assert {name for name in table if "." not in name} == set(single)
    for name, field in single.items():
        assert table[name][:2] == [written(field.default), unit(name)], name
    for name in ("step_s", "sample_s", "action_step_s"):
        assert table[f"traffic.{name}"][0] == written(getattr(TrafficSettings(), name))


def test_thresholds_are_those_of_the_labels_and_the_commands_meet_them() -> None:
    """Written `≥ hard_brake.threshold_mps2 (4)`: the label's value, and the whole range is on that side of it."""
    checked = 0
    for name in SECTIONS:
        for key, cells in rows(section(name)).items():
            if not cells[-1]:
                continue
            match = THRESHOLD.fullmatch(cells[-1])
            assert match, f"{name}.{key}: {cells[-1]}"
            sign, label, threshold, value = match.groups()
            level = getattr(getattr(LabelSettings(), label), threshold)
            assert value == f"{level:g}", f"{name}.{key}"
            default = getattr(getattr(ManeuverSettings(), name), key)
            low, high = default if isinstance(default, tuple) else (default, default)
            assert low >= level if sign == "≥" else high < level, f"{name}.{key}"
            checked += 1
    assert checked >= 10


@pytest.mark.parametrize("setting", ["run_in_s", "duration_s", "lateral_resolution_m"])
def test_the_text_gives_the_defaults_of_the_simulation(setting: str) -> None:
    value = written(getattr(TrafficSettings(), setting))
    assert re.search(rf"`traffic\.{setting}` \({re.escape(value)} {unit(setting)}\)", PAGE)


@pytest.mark.parametrize(("section", "settings"), [("sway", SwaySettings), ("speed_wander", SpeedWanderSettings)])
def test_the_table_of_what_drivers_do_at_random_is_its_settings(section: str, settings: type[Settings]) -> None:
    prefix = f"{section}."
    table = {name.removeprefix(prefix): cells for name, cells in rows(PAGE).items() if name.startswith(prefix)}
    assert list(table) == list(settings.model_fields)
    for key, field in settings.model_fields.items():
        assert isinstance(field.json_schema_extra, dict)
        assert table[key][:2] == [written(field.default), unit(key)], key
        assert table[key][3] == field.json_schema_extra["source"], key
