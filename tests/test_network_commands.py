"""`cosim network`: scenarios made from a user's network, a bare network or a map."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

import cosim
from isac_cosim.isacsim.scenarios.scenario import bundled, load


@pytest.fixture
def siteless(tmp_path: Path) -> Path:
    """The folder of a scenario without sites."""
    folder = tmp_path / "siteless"
    shutil.copytree(bundled()["motorway"], folder, ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "sites.add.xml").write_text("<additional/>")
    return folder


def test_sites_are_placed_along_a_users_network(siteless: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """What the user's configuration says of outputs and steps is reported once, and not followed."""
    user = siteless
    config = user / "motorway.sumocfg"
    config.write_text(
        config.read_text().replace(
            "</configuration>",
            '<time><step-length value="1"/></time><output><fcd-output value="big.xml"/></output></configuration>',
        )
    )
    before = {path: path.read_bytes() for path in user.iterdir()}
    folder = siteless.parent / "scenario"
    assert cosim.main(["network", "sites", str(user), "-o", str(folder), "--spacing", "300", "--json"]) == 0
    printed = capfd.readouterr()
    result = json.loads(printed.out)
    assert result["folder"] == str(folder)
    assert result["made_demand"] is False
    assert result["overridden"] == ["fcd-output", "step-length"]
    assert printed.err.count("these options of its configuration are not passed to SUMO: fcd-output, step-length") == 1
    scenario = load(folder)
    assert len(scenario.sites) == result["sites"] > 10
    assert scenario.overridden == ()
    assert {path: path.read_bytes() for path in user.iterdir()} == before


def test_a_map_becomes_a_scenario(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A motorway of 2.5 km with an exit: as a whole, and by a box in which there is nothing."""
    nodes = "".join(f'<node id="{k + 1}" lat="52.0" lon="{10 + 0.004 * k}" version="1"/>' for k in range(10))
    nodes += '<node id="20" lat="51.995" lon="10.024" version="1"/>'
    ways = ""
    for way, refs, kind, lanes in ((100, range(1, 11), "motorway", 3), (101, (5, 20), "motorway_link", 1)):
        through = "".join(f'<nd ref="{node}"/>' for node in refs)
        tags = {"highway": kind, "lanes": lanes, "oneway": "yes"}.items()
        tag_elements = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags)
        ways += f'<way id="{way}" version="1">{through}{tag_elements}</way>'
    (tmp_path / "map.osm").write_text(f'<?xml version="1.0"?><osm version="0.6">{nodes}{ways}</osm>')
    command = ["network", "import", str(tmp_path / "map.osm"), "--vehicles", "30", "--json"]
    assert cosim.main([*command, "-o", str(tmp_path / "road"), "--box", "9.9,51.9,10.1,52.1"]) == 0
    printed = capfd.readouterr()
    result = json.loads(printed.out)
    assert set(result) == {
        "folder", "sites", "edges", "made_demand", "overridden", "corners", "removed", "remarks", "drivers",
    }  # fmt: skip
    assert result["made_demand"] is True
    assert len(load(tmp_path / "road").sites) == result["sites"] > 4
    assert "demand was made" in printed.err
    # A second command, later: the same bytes, whatever the time.
    (tmp_path / "again").mkdir()
    assert cosim.main([*command, "-o", str(tmp_path / "again" / "road"), "--box", "9.9,51.9,10.1,52.1"]) == 0
    capfd.readouterr()
    assert {path.name: path.read_bytes() for path in (tmp_path / "road").iterdir()} == {
        path.name: path.read_bytes() for path in (tmp_path / "again" / "road").iterdir()
    }
    assert cosim.main([*command, "-o", str(tmp_path / "sea"), "--box", "3,54,4,55"]) == 2
    assert capfd.readouterr().err.startswith(f"cosim: netconvert cannot make a network of {tmp_path / 'map.osm'}")
    assert not (tmp_path / "sea").exists()


def test_a_map_without_connected_roads_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    nodes = "".join(f'<node id="{k}" lat="52.0" lon="{10 + 0.004 * k}" version="1"/>' for k in (1, 2))
    way = '<way id="9" version="1"><nd ref="1"/><nd ref="2"/><tag k="highway" v="motorway"/></way>'
    lone = tmp_path / "lone.osm"
    lone.write_text(f'<?xml version="1.0"?><osm version="0.6">{nodes}{way}</osm>')
    assert cosim.main(["network", "import", str(lone), "-o", str(tmp_path / "out")]) == 2
    assert capfd.readouterr().err == f"cosim: {lone} has no connected roads for cars: give another map\n"


def test_a_bare_network_becomes_a_scenario_by_its_seed(siteless: Path, capfd: pytest.CaptureFixture[str]) -> None:
    network = str(siteless / "motorway.net.xml")
    for name, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        assert (
            cosim.main(["network", "sites", network, "-o", str(siteless.parent / name), "--seed", seed, "--json"]) == 0
        )
        assert json.loads(capfd.readouterr().out)["made_demand"] is True
    demand = {name: (siteless.parent / name / f"{name}.rou.xml").read_bytes() for name in "abc"}
    assert demand["a"] == demand["b"] != demand["c"]
