from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from isacsim.errors import InputError
from isacsim.scenarios.scenario import bundled, load
from tests.support.roads import SITE, straight_road, vehicle

COVERED = ("west", "merge", "approach", "curve", "leave", "diverge", "east")


@pytest.fixture(scope="module")
def road(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return straight_road(tmp_path_factory.mktemp("road"), vehicle("a"))


def test_the_motorway_is_what_its_readme_says() -> None:
    scenario = load("motorway")
    assert "motorway" in bundled()
    assert len(scenario.sites) >= 8
    main = {lane.edge for lane in scenario.lanes if not lane.edge.startswith(":")}
    assert main == {"runin", "onramp", "offramp", *COVERED}
    length = {lane.edge: lane.length_m for lane in scenario.lanes}
    covered = sum(length[e] for e in COVERED)
    assert covered == pytest.approx(3300.0, rel=0.02)
    assert sum(lane.edge == "curve" for lane in scenario.lanes) == 4


def test_panels_of_the_motorway_face_the_road() -> None:
    scenario = load("motorway")
    ends = [pair for lane in scenario.lanes if not lane.edge.startswith(":") for pair in pairwise(lane.shape)]
    points = np.concatenate([np.linspace(a, b, max(2, int(np.hypot(*(b - a)) / 4.0)), endpoint=False) for a, b in ends])
    for site in scenario.sites:
        toward = points - (site.x, site.y)
        near = toward[np.hypot(*toward.T) < 60.0]
        facing = np.radians(site.azimuth_deg)
        ahead = near @ (np.sin(facing), np.cos(facing))
        assert (ahead > 0).mean() > 0.55, site.id


def test_lanes_know_what_continues_them(road: Path) -> None:
    lanes = {lane.id: lane for lane in load(road).lanes}
    (inside,) = lanes["e0_1"].successors
    assert inside.startswith(":")
    assert lanes[inside].successors == ("e1_1",)
    assert lanes["e0_1"].length_m + lanes[inside].length_m == pytest.approx(1500.0, abs=20.0)


def test_large_coordinates_get_a_near_origin(tmp_path: Path) -> None:
    far = load(straight_road(tmp_path / "far", vehicle("a"), SITE, shift=5_000_000.0))
    assert far.origin == (5_002_000.0, 5_000_000.0) or far.origin == (5_001_000.0, 5_000_000.0)
    assert max(np.abs(lane.shape).max() for lane in far.lanes) < 3_000.0


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda f: (f / "r.rou.xml").unlink(), "r.rou.xml, which is not there"),
        (lambda f: (f / "sites.add.xml").write_text("<additional/>"), "has no sites"),
        (lambda f: (f / "sites.add.xml").write_text(SITE.replace('value="15"', 'value="tall"')), "height"),
        (lambda f: (f / "sites.add.xml").write_text(SITE.replace('x="100"', 'x="nan"')), "needs numbers x and y"),
        (lambda f: (f / "sites.add.xml").write_text(SITE.replace('value="180"', 'value="inf"')), "azimuth"),
        (lambda f: (f / "r.net.xml").write_text("<net"), "cannot be read as XML"),
        (lambda f: (f / "r.net.xml").write_text('<net><lane id="a"/></net>'), "cannot be read as a SUMO network"),
        (lambda f: (f / "r.sumocfg").write_text("<configuration"), "cannot be read as XML"),
        (lambda f: (f / "r.sumocfg").write_text("<configuration/>"), "names 0 networks"),
        (lambda f: (f / "b.sumocfg").write_text("<configuration/>"), "holds 2 SUMO configurations"),
    ],
)
def test_bad_input_is_told_in_one_line(tmp_path: Path, spoil: object, says: str) -> None:
    folder = straight_road(tmp_path / "road", vehicle("a"))
    spoil(folder)  # type: ignore[operator]
    with pytest.raises(InputError, match=says) as caught:
        load(folder)
    assert "\n" not in str(caught.value)


def test_a_scenario_that_is_not_there_is_told_with_those_that_are() -> None:
    with pytest.raises(InputError, match=r"no scenario nowhere.*motorway"):
        load("nowhere")
