"""Reading scenarios: the bundled ones, and what is wrong with a user's."""

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios.demand import DemandSettings
from isac_cosim.isacsim.scenarios.making import add_sites
from isac_cosim.isacsim.scenarios.remarks import remarks
from isac_cosim.isacsim.scenarios.scenario import Elevation, bundled, load, load_without_sites
from isac_cosim.isacsim.scenarios.site_placement import PlacementSettings
from tests.support.roads import SITE, straight_road, vehicle

COVERED = ("west", "merge", "approach", "curve", "leave", "diverge", "east")


@pytest.fixture(scope="module")
def road(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return straight_road(tmp_path_factory.mktemp("road") / "road0", vehicle("a"))


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


@pytest.mark.parametrize(
    ("name", "count", "spacing_m", "longer_m"),
    [("motorway", 20, 150.0, [200.0, 280.0, 299.0]), ("motorway_sparse", 7, 500.0, [])],
)
def test_poles_of_the_motorway_stand_as_its_readme_says(
    name: str, count: int, spacing_m: float, longer_m: list[float]
) -> None:
    scenario = load(name)
    lanes = {(lane.edge, lane.index): lane for lane in scenario.lanes}
    width_m = next(iter(lanes.values())).width_m
    # The fourth lane from the left goes through from end to end; the middle of the road is two lanes to its left.
    through = [lanes[edge, max(k for e, k in lanes if e == edge) - 3].shape for edge in COVERED]
    line = densified(np.concatenate(through))
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    heading = np.gradient(line, axis=0)
    poles = np.unique([(site.x, site.y) for site in scenario.sites], axis=0)
    nearest = np.array([np.hypot(*(line - pole).T).argmin() for pole in poles])
    (ahead_x, ahead_y), (away_x, away_y) = heading[nearest].T, (poles - line[nearest]).T
    left_m = (ahead_x * away_y - ahead_y * away_x) / np.hypot(ahead_x, ahead_y) - 1.5 * width_m
    order = np.argsort(along[nearest])
    gaps = np.diff(along[nearest][order])
    longer = gaps > spacing_m * 1.1
    assert len(poles) == count == len(scenario.sites) / 2
    # The lane is outside the middle of the curve, and longer by up to 1 %.
    assert gaps[~longer] == pytest.approx(spacing_m, rel=0.04)
    assert sorted(gaps[longer]) == pytest.approx(longer_m, rel=0.02)
    # Two lanes and the set-back; one lane more beside a ramp, and some steps where the ramp itself is near.
    assert np.abs(left_m).min() == pytest.approx(2 * width_m + 12.0, abs=0.3)
    assert np.abs(left_m).max() < 3 * width_m + 12.5
    if name == "motorway_sparse":
        assert (np.diff(np.sign(left_m[order])) != 0).all()


def densified(line: Array) -> Array:
    """A line with points every half metre."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    line, along = line[np.diff(along, prepend=-1.0) > 0], along[np.diff(along, prepend=-1.0) > 0]
    at = np.arange(0.0, along[-1], 0.5)
    return np.stack([np.interp(at, along, values) for values in line.T], axis=1)


@pytest.mark.parametrize("name", ["motorway", "motorway_sparse"])
def test_panels_of_the_motorway_face_the_road(name: str) -> None:
    scenario = load(name)
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
    ("spoil", "message"),
    [
        (lambda f: (f / "r.rou.xml").unlink(), "names r.rou.xml, which does not exist: add"),
        (lambda f: (f / "sites.add.xml").write_text("<additional/>"), "has no sites: make"),
        (lambda f: (f / "sites.add.xml").write_text(SITE.replace('value="15"', 'value="tall"')), "height"),
        (
            lambda f: (f / "sites.add.xml").write_text(SITE.replace('x="100"', 'x="nan"')),
            "needs numbers x and y.*: add or fix them",
        ),
        (lambda f: (f / "sites.add.xml").write_text(SITE.replace('value="180"', 'value="inf"')), "azimuth"),
        (lambda f: (f / "r.net.xml").write_text("<net"), r"cannot be read as XML \(.+\): fix the file"),
        (
            lambda f: (f / "r.net.xml").write_text('<net><lane id="a"/></net>'),
            r"cannot be read as a SUMO network \(.+\): fix the file",
        ),
        (lambda f: (f / "r.sumocfg").write_text("<configuration"), "cannot be read as XML"),
        (lambda f: (f / "r.sumocfg").write_text("<configuration/>"), "names 0 networks: give it exactly one"),
        (
            lambda f: (f / "b.sumocfg").write_text("<configuration/>"),
            r"has 2 SUMO configurations \(b.sumocfg, r.sumocfg\): give the path",
        ),
    ],
)
def test_bad_input_is_refused_in_one_line(tmp_path: Path, spoil: object, message: str) -> None:
    folder = straight_road(tmp_path / "road", vehicle("a"))
    spoil(folder)  # type: ignore[operator]
    with pytest.raises(InputError, match=message) as caught:
        load(folder)
    assert "\n" not in str(caught.value)


def test_an_unknown_scenario_is_refused_with_the_bundled_ones() -> None:
    with pytest.raises(InputError, match=r"no scenario nowhere: give a folder, a .sumocfg, a .net.xml, .*motorway"):
        load("nowhere")


@pytest.mark.parametrize("read", [load, load_without_sites])
def test_a_folder_with_a_network_alone_says_that_a_network_will_do(tmp_path: Path, read: object) -> None:
    """And the command that the message gives makes a scenario of it."""
    folder = straight_road(tmp_path / "road", vehicle("a"))
    for file in (folder / "r.sumocfg", folder / "r.rou.xml", folder / "sites.add.xml"):
        file.unlink()
    with pytest.raises(
        InputError, match=r"a \.net\.xml will do: make .* by `cosim network sites (.*) -o FOLDER`"
    ) as caught:
        read(folder)  # type: ignore[operator]
    assert "\n" not in str(caught.value)
    command = str(caught.value).split("`")[1].split()
    assert command[:3] == ["cosim", "network", "sites"]
    new = add_sites(command[3], tmp_path / "new", PlacementSettings(), DemandSettings(vehicles=10))
    assert load(tmp_path / "new").sites
    assert new.made_demand


def test_a_folder_without_configuration_and_network_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"has no SUMO configuration \(.sumocfg\) and no network \(.net.xml\): give"):
        load(tmp_path)


def test_a_network_file_alone_is_read_but_has_no_demand(tmp_path: Path) -> None:
    network = straight_road(tmp_path / "road", vehicle("a")) / "r.net.xml"
    assert load_without_sites(network).name == "r"
    with pytest.raises(InputError, match="has no demand: make a scenario with demand by `cosim network sites"):
        load(network)


@pytest.mark.parametrize("height", ["-30", "0", "1e5"])
def test_a_site_in_the_ground_or_in_the_sky_is_refused(tmp_path: Path, height: str) -> None:
    folder = straight_road(tmp_path / "road", vehicle("a"), SITE.replace('value="15"', f'value="{height}"'))
    with pytest.raises(InputError, match=r"site s0 is -?\d+ m high: give the height .* more than 0 and at most 1000 m"):
        load(folder)


def test_edges_that_are_not_level_are_counted_and_reported(tmp_path: Path) -> None:
    """The second of two edges rises by 12.5 m."""
    folder = straight_road(tmp_path / "road", vehicle("a"))
    assert load(folder).elevation is None
    assert remarks(load(folder)) == []
    network = folder / "r.net.xml"
    rising = re.sub(r'(<lane id="e1_\d"[^>]*shape="[^" ]+ [^" ]+)"', r'\1,12.5"', network.read_text())
    network.write_text(rising)
    assert load(folder).elevation == Elevation(edges=1, of=2, low_m=0.0, high_m=12.5)
    (remark,) = remarks(load(folder))
    assert "1 of 2 edges leave the median height by more than 1 m (0 to 12.5 m): the network is taken as flat" in remark
