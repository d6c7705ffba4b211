"""Limits of vehicle types at the thresholds of labels, and our drivers in the place of others."""

from __future__ import annotations

from pathlib import Path

import pytest

from isac_cosim.isacsim.scenarios.scenario import bundled
from isac_cosim.isacsim.scenarios.sumo_config import read_config
from isac_cosim.isacsim.scenarios.sumo_files import Handover
from isac_cosim.isacsim.scenarios.xml_files import Element, elements
from isac_cosim.isacsim.traffic.drivers.driver_types import VARIANTS, OurDrivers, limits_at_thresholds

THRESHOLDS = {"accel": 2.5, "decel": 4.0}
TYPES = """<additional>
<vType id="bus" vClass="bus" accel="1.0" decel="4.0"/>
<vType id="plain" decel="4.5" sigma="0.5" length="4.3" color="1,0,0"><param key="a" value="b"/></vType>
<vType id="lorry" vClass="truck" length="12"/>
<vTypeDistribution id="mixed"><vType id="one" probability="0.4"/><vType id="other" vClass="bus" probability="0.6"/>
</vTypeDistribution>
<vTypeDistribution id="named" vTypes="plain bus" probabilities="0.2 0.8"/>
</additional>"""


def types(folder: Path, text: str = TYPES) -> Path:
    file = folder / "types.add.xml"
    file.write_text(text)
    return file


def test_types_at_a_threshold_are_named(tmp_path: Path) -> None:
    lines = limits_at_thresholds([types(tmp_path)], THRESHOLDS)
    assert [line.split(" have ")[1].split(",")[0] for line in lines] == ["decel = 4 to 4.5 m/s2"]
    assert "3 of 3 types of cars and trucks (plain, lorry, one)" in lines[0]
    assert "--drivers ours" in lines[0]


def test_a_demand_without_types_has_the_default_one(tmp_path: Path) -> None:
    lines = limits_at_thresholds([types(tmp_path, "<routes/>")], THRESHOLDS)
    assert [" accel = 2.6 m/s2, 1 value," in lines[0], " decel = 4.5 m/s2, 1 value," in lines[1]] == [True, True]


@pytest.mark.parametrize("name", bundled())
def test_our_own_drivers_are_not_at_a_threshold(name: str) -> None:
    inputs = read_config(next(bundled()[name].glob("*.sumocfg")))
    assert not limits_at_thresholds((*inputs.demand, *inputs.additional), THRESHOLDS)


def handed(folder: Path, file: Path, seed: int = 1) -> list[Element]:
    """What SUMO gets of a file, with our drivers."""
    out = folder / f"handed-{seed}"
    out.mkdir()
    return list(elements(Handover(out, OurDrivers(("road", seed)).replaced).path_of(file)))


def test_our_drivers_keep_class_size_and_looks(tmp_path: Path) -> None:
    file = types(tmp_path)
    got = handed(tmp_path, file)
    made = {element.attributes["id"]: element for element in got if element.name == "vType"}
    assert made["bus"].attributes == {"id": "bus", "vClass": "bus", "accel": "1.0", "decel": "4.0"}
    assert made["other"].attributes == {"id": "other", "vClass": "bus", "probability": "0.6"}
    plain = [made[f"plain-{k}"] for k in range(VARIANTS)]
    assert {one.attributes["length"] for one in plain} == {"4.3"}
    assert {one.attributes["color"] for one in plain} == {"1,0,0"}
    assert {one.attributes["carFollowModel"] for one in plain} == {"IDM"}
    assert not any("sigma" in one.attributes for one in plain)
    assert len({one.attributes["decel"] for one in plain}) > VARIANTS / 2
    assert sum(element.name == "param" for element in got) == VARIANTS
    assert {made[f"lorry-{k}"].attributes["vClass"] for k in range(VARIANTS)} == {"truck"}
    shares = [float(one.attributes["probability"]) for name, one in made.items() if name.split("-")[0] == "one"]
    assert sum(shares) == pytest.approx(0.4)
    named = next(one for one in got if one.attributes.get("id") == "named").attributes
    assert named["vTypes"].split() == [*(f"plain-{k}" for k in range(VARIANTS)), "bus"]
    assert sum(map(float, named["probabilities"].split()[:-1])) == pytest.approx(0.2)
    assert file.read_text() == TYPES


def test_seeds_have_drivers_of_their_own(tmp_path: Path) -> None:
    file = types(tmp_path)
    first, second = (handed(tmp_path, file, seed) for seed in (1, 2))
    assert first != second
    assert [element.name for element in first] == [element.name for element in second]


def test_a_default_type_that_the_demand_defines_stays_one_definition(tmp_path: Path) -> None:
    ours = OurDrivers(("road", 1))
    text = ours.default_type()
    assert text is not None
    assert text.count("<vType ") == VARIANTS
    again = OurDrivers(("road", 1))
    list(again.replaced([Element(0, "routes", {}), Element(1, "vType", {"id": "DEFAULT_VEHTYPE"})]))
    assert again.default_type() is None
