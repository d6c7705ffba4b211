"""Lanes of a Lanelet2 map: side by side, one after the other, borders turned either way, and maps that are damaged."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.trajectory_files.roads import lanelets
from isac_cosim.isacsim.traffic.trajectory_files.roads.lanelets import lanelet_lanes, lanelet_map_beside
from tests.support.lanelet_writer import UTM, LaneletMap


def across(x: float, y: float, to_x: float, to_y: float) -> list[tuple[float, float]]:
    return [(x, y), ((x + to_x) / 2.0, (y + to_y) / 2.0), (to_x, to_y)]


def two_lanes(folder: Path) -> Path:
    """Two lanes to the east, one that continues the right one, one to the west, and a walkway."""
    drawn = LaneletMap()
    low, middle, high, top = (drawn.way(across(0.0, y, 100.0, y)) for y in (0.0, 3.5, 7.0, 10.0))
    drawn.lanelet(middle, low)
    drawn.lanelet(high, middle)
    drawn.lanelet(drawn.way(across(200.0, 3.5, 100.0, 3.5)), drawn.way(across(100.0, 0.0, 200.0, 0.0)), "road")
    drawn.lanelet(high, top)
    drawn.lanelet(low, drawn.way(across(0.0, -2.0, 100.0, -2.0)), "walkway")
    return drawn.write(folder / "map.osm")


def test_lanes_stand_beside_and_follow_each_other(tmp_path: Path) -> None:
    (right, left, onward, west), remarks = lanelet_lanes(two_lanes(tmp_path), UTM)
    assert remarks == []
    assert right.edge == left.edge
    assert (right.index, left.index) == (0, 1)
    assert right.successors == (onward.id,)
    assert left.successors == ()
    assert len({right.edge, onward.edge, west.edge}) == 3
    assert [lane.width_m for lane in (right, left, onward, west)] == pytest.approx([3.5, 3.5, 3.5, 3.0], abs=1e-3)
    assert [lane.length_m for lane in (right, west)] == pytest.approx([100.0, 100.0], abs=1e-3)
    np.testing.assert_allclose(left.shape[[0, -1]], [[0.0, 5.25], [100.0, 5.25]], atol=1e-3)
    np.testing.assert_allclose(onward.shape[[0, -1]], [[100.0, 1.75], [200.0, 1.75]], atol=1e-3)
    # Its left border is that of the others' leftmost lane, so that it is driven towards them.
    np.testing.assert_allclose(west.shape[[0, -1]], [[100.0, 8.5], [0.0, 8.5]], atol=1e-3)


def test_a_curve_keeps_its_centre(tmp_path: Path) -> None:
    turn = np.linspace(0.0, np.pi / 2.0, 60)
    drawn = LaneletMap()
    inner, outer = (drawn.way(np.column_stack([r * np.cos(turn), r * np.sin(turn)])) for r in (50.0, 54.0))
    drawn.lanelet(inner, outer)
    ((lane,), _) = lanelet_lanes(drawn.write(tmp_path / "map.osm"), UTM)
    assert np.abs(np.hypot(*lane.shape.T) - 52.0).max() < 0.01
    assert lane.length_m == pytest.approx(52.0 * np.pi / 2.0, abs=0.02)


def test_where_a_road_parts_one_branch_goes_on_beside_the_other_lane(tmp_path: Path) -> None:
    drawn = LaneletMap()
    high, low, ramp = (drawn.way(across(0.0, y, 100.0, end)) for y, end in ((4.0, 4.0), (0.0, 0.0), (0.0, -20.0)))
    middle = drawn.way(across(0.0, 4.0, 100.0, -16.0))
    straight, out = drawn.lanelet(high, low), drawn.lanelet(middle, ramp)
    found = {lane.id: lane for lane in lanelet_lanes(drawn.write(tmp_path / "map.osm"), UTM)[0]}
    assert found[str(straight)].edge != found[str(out)].edge


@pytest.mark.parametrize("name", ["maps/lanelets/2_x/location2.osm", "maps/lanelet2/2_place.osm", "lanelets/02.osm"])
def test_the_map_of_a_recording_is_found(tmp_path: Path, name: str) -> None:
    tracks = tmp_path / "exiD" / "data" / "03_tracks.csv"
    tracks.parent.mkdir(parents=True)
    assert lanelet_map_beside(tracks, "2") is None
    there = tmp_path / "exiD" / name
    there.parent.mkdir(parents=True)
    two_lanes(tmp_path).rename(there)
    two_lanes(there.parent).rename(there.with_name("20_other.osm"))
    assert lanelet_map_beside(tracks, "2") == there
    assert lanelet_map_beside(tracks, "20") == there.with_name("20_other.osm")
    assert lanelet_map_beside(tracks, "0") is None
    beside = two_lanes(tracks.parent)
    assert lanelet_map_beside(tracks, "0") == beside


def test_of_two_maps_of_a_place_none_is_taken_unasked(tmp_path: Path) -> None:
    """As in inD, which has one of the construction site too."""
    tracks = tmp_path / "inD" / "data" / "11_tracks.csv"
    tracks.parent.mkdir(parents=True)
    for name in ("01_bend/location1.osm", "01_bend_works/location1_works.osm", "02_other/location2.osm"):
        (there := tmp_path / "inD" / "maps" / "lanelets" / name).parent.mkdir(parents=True)
        two_lanes(tmp_path).rename(there)
    assert lanelet_map_beside(tracks, "2") == there
    with pytest.raises(
        InputError, match=r"place, 1, has the maps .*location1.osm and .*location1_works.osm; name that"
    ):
        lanelet_map_beside(tracks, "1")


def changed(folder: Path, change: Callable[[str], str]) -> Path:
    file = two_lanes(folder)
    file.write_text(change(file.read_text()))
    return file


def swap(old: str, new: str) -> Callable[[str], str]:
    def change(text: str) -> str:
        assert old in text
        return text.replace(old, new, 1)

    return change


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (
            swap("<nd ref='2' />", "<nd ref='999' />"),
            r"lanelet 7000: node 999 of its right border is not in the file; fix the map",
        ),
        (
            swap("<member type='way' ref='1' role='right' />", ""),
            r"lanelet 7000: its right border has 0 ways and needs 1 to 100; fix the map",
        ),
        (
            swap("ref='1' role='right'", "ref='77' role='right'"),
            r"lanelet 7000: its right border, way 77, is not in the",
        ),
        (swap("<nd ref='1' /><nd ref='2' /><nd ref='3' />", "<nd ref='1' />"), r"way 1, has 1 node\(s\) and needs two"),
        (swap("ref='1' role='right'", "ref='2' role='right'"), r"lanelet 7000: has way 2 on both sides; fix the map"),
        (swap("<node id='2'", "<node id='1'"), r"two nodes have the id '1', or it has none; give each its own"),
        (swap("<way id='2'", "<way"), r"two ways have the id '', or it has none"),
        (lambda text: text.replace(" lat=", " latitude="), r"node 1: has no lon and lat that UTM covers, degrees"),
        (lambda text: text.replace(" lon='", " lon='nan"), r"node 1: has no lon and lat"),
        (lambda text: text.replace(" lon='", " lon='1"), r"is more than 20 km from the recording; give the map of its"),
        (lambda text: text.replace("osm", "net"), r"is no Lanelet2 map: its first element is net, not osm"),
        (
            lambda text: text.replace("v='lanelet'", "v='multipolygon'"),
            r"has no lanelet for vehicles; give the Lanelet2",
        ),
        (lambda text: text[: len(text) // 2], r"cannot be read as XML"),
        (swap("<osm", "<!DOCTYPE osm [<!ENTITY a 'b'>]><osm"), r"declares a document type"),
        (lambda text: "<osm></osm>", r"has no points; give the Lanelet2 map"),
    ],
)
def test_a_damaged_map_is_refused(tmp_path: Path, change: Callable[[str], str], fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        lanelet_lanes(changed(tmp_path, change), UTM)


def test_borders_that_cross_are_refused(tmp_path: Path) -> None:
    drawn = LaneletMap()
    drawn.lanelet(
        drawn.way([(0.0, 4.0), (50.0, 4.0), (60.0, -4.0), (70.0, 4.0), (100.0, 4.0)]), drawn.way(across(0, 0, 100, 0))
    )
    with pytest.raises(InputError, match=r"lanelet 7000: its borders, ways 1 and 2, cross each other; fix the map"):
        lanelet_lanes(drawn.write(tmp_path / "map.osm"), UTM)


def test_what_is_too_wide_is_no_lane(tmp_path: Path) -> None:
    drawn = LaneletMap()
    drawn.lanelet(drawn.way(across(0.0, 50.0, 100.0, 50.0)), drawn.way(across(0.0, 0.0, 100.0, 0.0)))
    with pytest.raises(InputError, match=r"lanelet 7000 is 100 m long and 50 m wide, and no lane is; fix the map"):
        lanelet_lanes(drawn.write(tmp_path / "map.osm"), UTM)


def test_a_huge_map_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = two_lanes(tmp_path)
    monkeypatch.setattr(lanelets, "MOST_ELEMENTS", 100)
    assert lanelet_lanes(file, UTM)
    monkeypatch.setattr(lanelets, "MOST_ELEMENTS", 50)
    with pytest.raises(InputError, match=r"is larger than the map of any recording; cut out"):
        lanelet_lanes(file, UTM)
    monkeypatch.undo()
    wide = LaneletMap()
    ways = [wide.way(across(0.0, 3.0 * k, 100.0, 3.0 * k)) for k in range(40)]
    for right, left in pairwise(ways):
        wide.lanelet(left, right)
    with pytest.raises(InputError, match=r"lanelet 70\d\d has more than 32 lanes beside it"):
        lanelet_lanes(wide.write(tmp_path / "wide.osm"), UTM)


def test_a_gzipped_map_is_the_same(tmp_path: Path) -> None:
    file = two_lanes(tmp_path)
    packed = tmp_path / "map.osm.gz"
    packed.write_bytes(gzip.compress(file.read_bytes()))

    def told(lane: Lane) -> tuple[object, ...]:
        return (lane.id, lane.edge, lane.index, lane.width_m, lane.successors, lane.shape.tolist())

    assert [*map(told, lanelet_lanes(file, UTM)[0])] == [*map(told, lanelet_lanes(packed, UTM)[0])]
