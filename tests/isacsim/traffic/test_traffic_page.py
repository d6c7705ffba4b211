"""docs/traffic.md against the code, and what is drawn for reactions and commands against the thresholds of labels."""

import re
from pathlib import Path

import pytest

from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings
from isac_cosim.labeling.detectors.events import LabelSettings

PAGE = (Path(__file__).parents[3] / "docs" / "traffic.md").read_text(encoding="utf-8")
SECTIONS = [name for name, value in ManeuverSettings() if isinstance(value, Settings)]


@pytest.mark.parametrize("name", SECTIONS)
def test_the_page_says_what_every_reaction_and_command_is(name: str) -> None:
    section = PAGE.partition("## What reactions and commands are like\n")[2].split("\n## ")[0]
    assert f"`{name}`" in section


@pytest.mark.parametrize(
    ("drawn", "sign", "threshold"),
    [
        ("evasion.steer_ttc_s", "<", "evasive_swerve.threat_ttc_s"),
        ("hard_accel.peak_mps2", ">=", "hard_accel.threshold_mps2"),
        ("brisk_start.peak_mps2", ">=", "hard_accel.threshold_mps2"),
        ("brisk_start.lasts_s", ">=", "hard_accel.hold_s"),
        ("overtake.pass_s", "<", "overtake.horizon_s"),
        ("swerve.offset_m", ">=", "evasive_swerve.aside_m"),
        ("swerve.peak_mps2", ">=", "evasive_swerve.threshold_mps2"),
        ("swerve.hold_s", "<", "evasive_swerve.reversal_s"),
        ("slow_vehicle.deceleration_mps2", "<", "hard_brake.threshold_mps2"),
        ("stop_in_lane.deceleration_mps2", "<", "hard_brake.threshold_mps2"),
    ],
)
def test_what_is_drawn_meets_the_threshold_of_its_label(drawn: str, sign: str, threshold: str) -> None:
    """The whole range is on that side of it."""
    (name, key), (label, level) = drawn.split("."), threshold.split(".")
    value = getattr(getattr(ManeuverSettings(), name), key)
    low, high = value if isinstance(value, tuple) else (value, value)
    limit = getattr(getattr(LabelSettings(), label), level)
    assert low >= limit if sign == ">=" else high < limit


@pytest.mark.parametrize("setting", ["run_in_s", "duration_s", "lateral_resolution_m", "step_s", "action_step_s"])
def test_the_text_gives_the_defaults_of_the_simulation(setting: str) -> None:
    unit = "m" if setting.endswith("_m") else "s"
    assert re.search(rf"`traffic\.{setting}` \({getattr(TrafficSettings(), setting):g} {unit}\)", PAGE)
