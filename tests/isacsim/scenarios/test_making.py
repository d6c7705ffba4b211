"""Scenarios made from maps and bare networks, and users' scenarios used as they are."""

import gzip
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.scenarios.demand import DemandSettings, make_demand
from isac_cosim.isacsim.scenarios.making import add_sites, import_map
from isac_cosim.isacsim.scenarios.scenario import bundled, load, resolved
from isac_cosim.isacsim.scenarios.site_placement import PlacementSettings, place
from isac_cosim.isacsim.scenarios.xml_files import elements
from isac_cosim.isacsim.sensing.chain import LEAST_SITES, ViewSettings, assign
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from tests.support.roads import straight_road, vehicle

SHORT = TrafficSettings(run_in_s=20.0, duration_s=5.0)


def osm(folder: Path, name: str = "map.osm.gz") -> Path:
    """A motorway of 2.5 km, three lanes, with an exit, as OpenStreetMap has it."""
    nodes = [(k + 1, 52.0, 10.0 + 0.004 * k) for k in range(10)] + [(20, 51.995, 10.024)]
    text = "".join(f'<node id="{i}" lat="{lat}" lon="{lon}" version="1"/>' for i, lat, lon in nodes)
    ways = [(100, range(1, 11), "motorway", 3), (101, (5, 20), "motorway_link", 1)]
    for number, refs, kind, lanes in ways:
        tags = {"highway": kind, "lanes": str(lanes), "oneway": "yes", "maxspeed": "120"}
        text += f'<way id="{number}" version="1">' + "".join(f'<nd ref="{r}"/>' for r in refs)
        text += "".join(f'<tag k="{k}" v="{v}"/>' for k, v in tags.items()) + "</way>"
    path = folder / name
    with gzip.open(path, "wt") as file:
        file.write(f'<?xml version="1.0"?><osm version="0.6">{text}</osm>')
    return path


def test_nothing_is_written_beside_a_users_scenario(tmp_path: Path) -> None:
    folder = straight_road(tmp_path / "users", vehicle("a"))
    (folder / "detectors.add.xml").write_text(
        '<additional><e1Detector id="d" lane="e0_1" pos="100" freq="10" file="e1.xml"/>'
        '<edgeData id="m" file="edges.xml" freq="10"/><parkingArea id="p" lane="e1_0" startPos="5" endPos="20"/>'
        "</additional>"
    )
    (folder / "r.sumocfg").write_text(
        '<configuration><net-file value="r.net.xml"/><r value="r.rou.xml"/>'
        '<additional-files value="sites.add.xml, detectors.add.xml"/><tripinfo-output value="trips.xml"/>'
        '<log value="log.txt"/><step-length value="0.5"/><begin value="100"/><gui-settings-file value="no.xml"/>'
        '<scale value="1"/></configuration>'
    )
    (folder / "r.rou.xml").write_text((folder / "r.rou.xml").read_text().replace('depart="0.0"', 'depart="101"'))
    before = sorted(path.name for path in folder.iterdir())
    scenario = load(folder)
    recording = record(scenario, 1, TrafficSettings(run_in_s=2.0, duration_s=3.0), ManeuverSettings())
    assert sorted(path.name for path in folder.iterdir()) == before
    assert scenario.overridden == ("gui-settings-file", "log", "step-length", "tripinfo-output")
    assert scenario.kept == {"scale": "1"}
    times = recording.times(recording.tracks["a"])
    assert 102.0 < times[0] < 102.05
    np.testing.assert_allclose(np.diff(times), 0.01)


def test_a_folder_of_results_does_not_hide_the_bundled_scenario_of_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "motorway").mkdir()
    (tmp_path / "motorway/metrics.json").write_text("{}")
    assert (resolved("motorway"), load("motorway").network) == ("motorway", bundled()["motorway"] / "motorway.net.xml")
    own = straight_road(tmp_path / "urban", vehicle("a"))
    assert (resolved("urban"), load("urban").network) == (str(own), Path("urban/r.net.xml"))


OF_USERS = {
    "calibrator": '<routeProbe id="p" edge="e0" freq="10" file="probe.xml"/>'
    '<calibrator id="c" edge="e0" pos="0" freq="10" output="c.xml" routeProbe="p"/>',
    "nowhere": '<inductionLoop id="d" lane="e0_1" pos="100" freq="10" file="NUL"/>',
    "speed sign": '<e1Detector id="d" lane="e0_1" pos="100" freq="10" file="e1.xml"/>'
    '<variableSpeedSign id="s" lanes="e1_0" file="steps.xml"/>',
    "include": '<include href="more/detectors.add.xml"/>',
}


@pytest.mark.parametrize("kind", OF_USERS)
def test_what_a_users_files_measure_or_include_is_loaded_and_nothing_is_written(tmp_path: Path, kind: str) -> None:
    folder = straight_road(tmp_path / "users", vehicle("a"), additional=OF_USERS[kind])
    (folder / "steps.xml").write_text('<vss><step time="0" speed="10"/></vss>')
    (folder / "more").mkdir()
    (folder / "more/detectors.add.xml").write_text(
        '<additional><e1Detector id="d" lane="e0_1" pos="100" freq="10" file="e1.xml"/>'
        '<include href="stop.add.xml"/></additional>'
    )
    (folder / "more/stop.add.xml").write_text('<additional><busStop id="b" lane="e1_0"/></additional>')
    before = sorted(path.relative_to(folder) for path in folder.rglob("*"))
    recording = record(load(folder), 1, TrafficSettings(run_in_s=2.0, duration_s=20.0), ManeuverSettings())
    assert "a" in recording.tracks
    assert sorted(path.relative_to(folder) for path in folder.rglob("*")) == before


def test_demand_may_be_included_and_a_missing_file_is_named(tmp_path: Path) -> None:
    folder = straight_road(tmp_path / "users", vehicle("a"))
    (folder / "r.rou.xml").rename(folder / "all.rou.xml")
    (folder / "r.rou.xml").write_text('<routes><include href="all.rou.xml"/></routes>')
    assert "a" in record(load(folder), 1, TrafficSettings(run_in_s=2.0, duration_s=3.0), ManeuverSettings()).tracks
    (folder / "all.rou.xml").unlink()
    with pytest.raises(InputError, match=r"r\.rou\.xml includes 'all\.rou\.xml', which does not exist: add the file"):
        load(folder)


def test_a_short_road_gets_demand_and_names_may_hold_any_character(tmp_path: Path) -> None:
    folder = straight_road(tmp_path / "R&D", vehicle("a"))
    text = make_demand(
        straight_road(tmp_path / "short", vehicle("a"), edge_m=60.0) / "r.net.xml", DemandSettings(), seed=1
    )
    assert "<flow" in text
    for path in folder.glob("r.rou.xml"):
        path.unlink()
    add_sites(str(folder / "r.net.xml"), tmp_path / "new", PlacementSettings(), DemandSettings(vehicles=30))
    assert load(tmp_path / "new").network.samefile(folder / "r.net.xml")


def test_a_bare_network_gets_demand_and_sites(tmp_path: Path) -> None:
    network = straight_road(tmp_path / "bare", vehicle("a")) / "r.net.xml"
    new = add_sites(str(network), tmp_path / "new", PlacementSettings(), DemandSettings(vehicles=30))
    assert new.made_demand
    scenario = load(tmp_path / "new")
    assert len(scenario.sites) == new.sites
    recording = record(scenario, 1, SHORT, ManeuverSettings())
    assert len(recording.tracks) > 5
    assert {track.kind for track in recording.tracks.values()} <= {"passenger", "truck"}


def test_a_scenario_with_sites_and_an_output_folder_in_use_are_refused(tmp_path: Path) -> None:
    folder = straight_road(tmp_path / "road", vehicle("a"))
    with pytest.raises(InputError, match="sites already"):
        add_sites(str(folder), tmp_path / "x", PlacementSettings(), DemandSettings())
    (folder / "sites.add.xml").write_text("<additional/>")
    with pytest.raises(InputError, match="not an empty folder: give another"):
        add_sites(str(folder), folder, PlacementSettings(), DemandSettings())


def test_a_map_of_a_country_that_drives_on_the_left_keeps_left(tmp_path: Path) -> None:
    """The same lanes lie on the other side of the line in the map, and lane 0 is the outermost one still."""
    offsets = []
    for lefthand in (False, True):
        folder = tmp_path / str(lefthand)
        import_map(osm(tmp_path), folder, None, PlacementSettings(), DemandSettings(vehicles=5), lefthand=lefthand)
        scenario = load(folder)
        assert scenario.lefthand is lefthand
        inner = next(lane for lane in scenario.lanes if lane.index == 1 and not lane.edge.startswith(":"))
        outer = next(lane for lane in scenario.lanes if lane.edge == inner.edge and lane.index == 0)
        along, across = outer.shape[-1] - outer.shape[0], inner.shape[0] - outer.shape[0]
        offsets.append((along[0] * across[1] - along[1] * across[0]) / np.hypot(*along))
    assert offsets == pytest.approx([3.2, -3.2], abs=0.3)


def test_a_map_becomes_a_scenario(tmp_path: Path) -> None:
    new = import_map(osm(tmp_path), tmp_path / "city", None, PlacementSettings(), DemandSettings(vehicles=40))
    scenario = load(tmp_path / "city")
    assert new.sites == len(scenario.sites) > 8
    assert max(lane.index for lane in scenario.lanes) >= 2
    assert len(record(scenario, 1, SHORT, ManeuverSettings()).tracks) > 5


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("m.osm", "<osm>", r"m\.osm cannot be read as XML \(.*\): fix the file"),
        ("m.osm", "<osm/>", "netconvert cannot make a network of .*: fix the map"),
        ("m.png", "", "not an OpenStreetMap file: give one that ends in .osm"),
        ("gone.osm", None, "there is no file .*gone.osm: give"),
    ],
)
def test_a_bad_map_is_refused_in_one_line(tmp_path: Path, name: str, text: str | None, message: str) -> None:
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        import_map(tmp_path / name, tmp_path / "out", None, PlacementSettings(), DemandSettings())
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()
    assert not list(tmp_path.glob(".out*"))


def test_demand_is_reproducible_and_its_routes_are_connected(tmp_path: Path) -> None:
    motorway = load("motorway")
    text = make_demand(motorway.network, DemandSettings(), 3)
    assert text == make_demand(motorway.network, DemandSettings(), 3)
    assert text != make_demand(motorway.network, DemandSettings(), 4)
    file = tmp_path / "d.rou.xml"
    file.write_text(text)
    routes = [node.attributes["edges"].split() for node in elements(file) if node.name == "route"]
    follows = {
        (lane.edge, last.edge)
        for lane in motorway.lanes
        for inside in motorway.lanes
        if inside.id in lane.successors
        for last in motorway.lanes
        if last.id in inside.successors
    }
    assert len(routes) >= 3
    assert all(pair in follows for route in routes for pair in pairwise(route))


@pytest.mark.parametrize("name", sorted(bundled()))
def test_poles_stand_clear_of_the_road_and_apart(name: str) -> None:
    scenario = load(name)
    settings = PlacementSettings()
    edges = {lane.edge for lane in scenario.lanes if not lane.edge.startswith(":")}
    sites = place(scenario.lanes, edges, settings, scenario.lefthand)
    poles = np.unique(np.array([(site.x, site.y) for site in sites]), axis=0)
    assert len(sites) == 2 * len(poles)
    for lane in scenario.lanes:
        start, step = lane.shape[:-1], np.diff(lane.shape, axis=0)
        share = np.einsum("pkd,kd->pk", poles[:, None] - start, step) / np.maximum((step**2).sum(1), 1e-12)
        nearest = start + np.clip(share, 0.0, 1.0)[..., None] * step
        distance = np.hypot(*(poles[:, None] - nearest).transpose(2, 0, 1)).min(axis=1)
        assert distance.min() > lane.width_m / 2.0 + 0.7 * settings.set_back_m
    between = np.hypot(*(poles[:, None] - poles).transpose(2, 0, 1)) + 1e9 * np.eye(len(poles))
    assert between.min() > 0.6 * settings.spacing_m
    assert between.min(axis=1).max() < 2.0 * settings.spacing_m


def test_bundled_scenarios_have_a_pole_near_every_covered_lane() -> None:
    """Every lane but the run-ins', the ramps' and the cross streets' has a pole within 150 m of its middle.

    The straight roads of the kinematic source have sites around one point only, and motorway_sparse is sparse.
    """
    bare = ("runin", "onramp", "offramp", ":")
    for name in bundled().keys() - {"straight_road", "straight_road_rectangle", "motorway_sparse"}:
        scenario = load(name)
        poles = np.array([(site.x, site.y) for site in scenario.sites])
        for lane in scenario.lanes:
            if lane.edge.startswith(bare) or any(end[0] in "ns" for end in lane.edge.split("_")):
                continue
            middle = lane.shape.mean(axis=0)
            assert np.hypot(*(poles - middle).T).min() < 150.0, (name, lane.id)


@pytest.mark.parametrize("name", [*sorted(bundled()), "straight"])
def test_two_of_the_sites_made_for_a_bare_network_see_each_road_of_its_traffic(name: str, tmp_path: Path) -> None:
    """Along each lane with traffic, at least two panels are in view, and on a long one they change."""
    network = straight_road(tmp_path / name, vehicle("a")) / "r.net.xml" if name == "straight" else load(name).network
    add_sites(str(network), tmp_path / "new", PlacementSettings(), DemandSettings(vehicles=30))
    scenario = load(tmp_path / "new")
    routes = [node.attributes for node in elements(tmp_path / "new" / "new.rou.xml") if node.name == "route"]
    used = {edge for route in routes for edge in route["edges"].split()}
    panels = Panels.of(scenario.sites, 0.8)
    for lane in scenario.lanes:
        if lane.edge not in used:
            continue
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(lane.shape, axis=0).T))])
        stations = np.arange(0.0, along[-1], 5.0)
        points = np.stack([np.interp(stations, along, values) for values in lane.shape.T], axis=1)
        sites = assign(points, 10.0, panels, ViewSettings())
        assert (sites >= 0).sum(axis=1).min() >= LEAST_SITES, lane.id
        assert len(np.unique(sites[:, 0])) > 1 or along[-1] < 150.0, lane.id


def test_poles_beside_a_road_for_left_hand_traffic_are_the_mirror_image(tmp_path: Path) -> None:
    settings = PlacementSettings(spacing_m=400.0)
    poles = []
    for lefthand in (False, True):
        scenario = load(straight_road(tmp_path / str(lefthand), vehicle("a"), lefthand=lefthand))
        assert scenario.lefthand is lefthand
        sites = place(scenario.lanes, {"e0", "e1"}, settings, scenario.lefthand)
        poles.append(np.array([(site.x, site.y) for site in sites]))
        edges_m = np.array([lane.shape[:, 1] for lane in scenario.lanes])
        clear_m = np.maximum(edges_m.min() - 1.8 - poles[-1][:, 1], poles[-1][:, 1] - edges_m.max() - 1.8)
        np.testing.assert_allclose(clear_m, settings.set_back_m, atol=2.5)
        assert {side > edges_m.max() for side in poles[-1][:, 1]} == {False, True}
    np.testing.assert_allclose(poles[1], poles[0] * (1.0, -1.0), atol=1e-6)


def test_a_scenario_made_from_a_network_for_left_hand_traffic_keeps_left(tmp_path: Path) -> None:
    road = straight_road(tmp_path / "road", vehicle("a"), lefthand=True)
    new = add_sites(str(road / "r.net.xml"), tmp_path / "new", PlacementSettings(), DemandSettings(vehicles=5))
    assert load(new.folder).lefthand
