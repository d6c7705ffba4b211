"""Lanelet2 maps as people draw them in JOSM: borders of several ways, tags of every kind, and what was deleted."""

from __future__ import annotations

import itertools
import random
from pathlib import Path

import numpy as np
import pytest
from pyproj import Proj

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.trajectory_files.roads.lanelets import lanelet_lanes

UTM = (293487.1224, 5629711.5802)
"""Origin of the coordinates of a recording in UTM, zone 32, m."""
Point = tuple[float, float]


class Drawing:
    """A map in OSM XML as JOSM writes it: single quotes, Windows line ends, negative ids of what is new."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.numbers = itertools.count(-25001, -1)
        self.known: dict[Point, int] = {}
        self.to_degrees = Proj("+proj=utm +zone=32 +ellps=WGS84")

    def node(self, point: Point) -> int:
        if point not in self.known:
            self.known[point] = number = next(self.numbers)
            lon, lat = self.to_degrees(point[0] + UTM[0], point[1] + UTM[1], inverse=True)
            tags = "<tag k='ele' v='0.0' /><tag k='local_x' v='7.0' /><tag k='local_y' v='-3.5' />"
            self.lines.append(
                f"<node id='{number}' action='modify' visible='true' lat='{lat:.11f}' lon='{lon:.11f}'>{tags}</node>"
            )
        return self.known[point]

    def way(self, *points: Point, kind: str = "line_thin", number: int = 0) -> int:
        number = number or next(self.numbers)
        refs = "".join(f"<nd ref='{self.node(point)}' />" for point in points)
        self.lines.append(f"<way id='{number}' action='modify'>{refs}<tag k='type' v='{kind}' /></way>")
        return number

    def relation(self, members: list[tuple[str, int, str]], tags: dict[str, str], action: str = "modify") -> int:
        number = next(self.numbers)
        inside = [f"<member type='{kind}' ref='{ref}' role='{role}' />" for kind, ref, role in members]
        inside += [f"<tag k='{name}' v='{value}' />" for name, value in tags.items()]
        self.lines.append(f"<relation id='{number}' action='{action}'>{''.join(inside)}</relation>")
        return number

    def lanelet(self, left: list[int], right: list[int], action: str = "modify", **tags: str) -> str:
        members = [("way", way, "left") for way in left] + [("way", way, "right") for way in right]
        random.Random(len(self.lines)).shuffle(members)
        members.insert(1, ("relation", -1, ""))
        return str(self.relation(members, {"location": "urban", **tags, "type": "lanelet"}, action))

    def write(self, file: Path) -> Path:
        head = ["<?xml version='1.0' encoding='UTF-8'?>", "<osm version='0.6' upload='never' generator='JOSM'>"]
        bounds = "<bounds minlat='50.7' minlon='6.0' maxlat='50.8' maxlon='6.1' origin='x' />"
        file.write_bytes("\r\n".join([*head, bounds, *self.lines, "</osm>", ""]).encode())
        return file

    def lanes(self, folder: Path) -> dict[str, Lane]:
        return {lane.id: lane for lane in lanelet_lanes(self.write(folder / "0_place.osm"), UTM)[0]}


def row(y: float, *x: float) -> list[Point]:
    return [(float(at), y) for at in x]


def test_borders_of_several_ways_in_any_order_and_direction(tmp_path: Path) -> None:
    """A border is three ways, listed as they come, one of them turned; the lane beside it shares all of them."""
    drawn = Drawing()
    low = [drawn.way(*row(0.0, 0.0, 120.0), kind="road_border")]
    middle = [
        drawn.way(*row(3.5, 40.0, 80.0), kind="virtual"),
        drawn.way(*row(3.5, 120.0, 80.0), kind="line_thin"),
        drawn.way(*row(3.5, 0.0, 40.0), kind="line_thick"),
    ]
    high = [drawn.way(*row(7.0, 120.0, 0.0), kind="curbstone")]
    right, left = drawn.lanelet(middle, low, subtype="road"), drawn.lanelet(high, middle[::-1], subtype="road")
    onward = drawn.lanelet(
        [drawn.way(*row(3.5, 200.0, 120.0))], [drawn.way(*row(0.0, 120.0, 200.0))], subtype="highway"
    )
    lanes = drawn.lanes(tmp_path)
    assert (lanes[right].edge, lanes[right].index, lanes[left].index) == (lanes[left].edge, 0, 1)
    assert lanes[right].successors == (onward,)
    assert [lanes[name].width_m for name in (right, left)] == pytest.approx([3.5, 3.5], abs=1e-3)
    np.testing.assert_allclose(lanes[left].shape[[0, -1]], [[0.0, 5.25], [120.0, 5.25]], atol=1e-3)
    np.testing.assert_allclose(lanes[right].shape[[0, -1]], [[0.0, 1.75], [120.0, 1.75]], atol=1e-3)


def test_a_border_in_pieces_that_do_not_meet_is_refused(tmp_path: Path) -> None:
    drawn = Drawing()
    low = [drawn.way(*row(0.0, 0.0, 120.0))]
    drawn.lanelet([drawn.way(*row(3.5, 0.0, 40.0)), drawn.way(*row(3.5, 60.0, 120.0))], low)
    with pytest.raises(
        InputError, match=r"lanelet -\d+: the ways of its left border, .*, do not follow each other; fix"
    ):
        drawn.lanes(tmp_path)


def test_lanelets_beside_each_other_over_a_part_are_told(tmp_path: Path) -> None:
    """A ramp begins halfway along the lane beside it, which was not split there."""
    drawn = Drawing()
    near, far = drawn.way(*row(0.0, 0.0, 60.0)), drawn.way(*row(0.0, 60.0, 120.0))
    main = drawn.lanelet([drawn.way(*row(3.5, 0.0, 120.0))], [near, far])
    ramp = drawn.lanelet([far], [drawn.way(*row(-3.5, 60.0, 120.0))])
    lanes, remarks = lanelet_lanes(drawn.write(tmp_path / "map.osm"), UTM)
    assert len({lane.edge for lane in lanes}) == 2
    (remark,) = remarks
    assert remark.startswith(f"map.osm: 1 pair(s) of lanelets share a part of a border, such as {main} and {ramp}: ")


def test_a_lanelet_may_be_driven_both_ways(tmp_path: Path) -> None:
    """A narrow street of two lanelets, which goes on as a street with a lane in each direction."""
    drawn = Drawing()
    narrow = [
        drawn.lanelet([drawn.way(*row(3.0, x, x + 50.0))], [drawn.way(*row(0.0, x, x + 50.0))], **tags)
        for x, tags in ((0.0, {"one_way": "no"}), (50.0, {"one_way": "yes", "one_way:vehicle": "no"}))
    ]
    middle = [drawn.way((100.0, 3.0), (150.0, 3.0))]
    east = drawn.lanelet(middle, [drawn.way((100.0, 0.0), (150.0, -1.0))], one_way="yes")
    lanes = drawn.lanes(tmp_path)
    assert set(lanes) == {*narrow, *(f"-{name}" for name in narrow), east}
    first, second = narrow
    assert (lanes[first].successors, lanes[second].successors) == ((second,), (east,))
    assert (lanes[f"-{second}"].successors, lanes[f"-{first}"].successors) == ((f"-{first}",), ())
    np.testing.assert_allclose(lanes[f"-{first}"].shape, lanes[first].shape[::-1], atol=1e-9)
    assert len({lanes[name].edge for name in lanes}) == 5
    assert {lane.index for lane in lanes.values()} == {0}
    np.testing.assert_allclose(lanes[f"-{second}"].shape[0], [100.0, 1.5], atol=1e-3)


def test_who_may_drive_where(tmp_path: Path) -> None:
    drawn = Drawing()
    ways = [drawn.way(*row(3.0 * k, 0.0, 50.0)) for k in range(9)]
    tags: list[dict[str, str]] = [
        {}, {"subtype": "exit", "one_way": "yes"}, {"subtype": "walkway"}, {"subtype": "bicycle_lane"},
        {"subtype": "walkway", "participant:vehicle:car": "yes"}, {"subtype": "road", "participant:bicycle": "yes"},
        {"subtype": "emergency_lane"}, {"subtype": "crosswalk"},
    ]  # fmt: skip
    names = [drawn.lanelet([ways[k + 1]], [ways[k]], **own) for k, own in enumerate(tags)]
    assert [*drawn.lanes(tmp_path)] == [names[k] for k in (0, 1, 4, 6)]


def test_what_is_no_lane_is_passed_over(tmp_path: Path) -> None:
    """Rules and areas, what an editor has deleted, and a way that has the id of a node."""
    drawn = Drawing()
    low = drawn.way(*row(0.0, 0.0, 50.0))
    high = drawn.way(*row(3.0, 0.0, 50.0), number=drawn.known[0.0, 0.0])
    lane = drawn.lanelet([high], [low], subtype="road")
    drawn.lanelet([high], [low, -99], subtype="road", action="delete")
    drawn.lines.append("<node id='-7' action='delete' />")
    drawn.lines.append("<way id='-8' action='delete'><nd ref='-7' /></way>")
    drawn.relation([("way", low, "ref_line"), ("relation", int(lane), "yield")],
                   {"subtype": "right_of_way", "type": "regulatory_element"})  # fmt: skip
    drawn.relation([("way", low, "outer"), ("way", high, "outer")], {"subtype": "parking", "type": "multipolygon"})
    drawn.relation([("way", low, "left"), ("way", high, "right"), ("way", low, "right")],
                   {"subtype": "walkway", "type": "lanelet"})  # fmt: skip
    assert [*drawn.lanes(tmp_path)] == [lane]


def test_coordinates_that_a_map_leaves_empty_are_refused(tmp_path: Path) -> None:
    """Maps in a plane of their own have `local_x` and `local_y` instead."""
    drawn = Drawing()
    drawn.lanelet([drawn.way(*row(3.0, 0.0, 50.0))], [drawn.way(*row(0.0, 0.0, 50.0))])
    drawn.lines = [line.replace("lat='50", "lat='' old='50") for line in drawn.lines]
    with pytest.raises(InputError, match=r"node -25\d+: has no lon and lat that UTM covers, degrees; fix them"):
        drawn.lanes(tmp_path)


def test_a_border_of_many_lanelets_is_refused(tmp_path: Path) -> None:
    drawn = Drawing()
    low = drawn.way(*row(0.0, 0.0, 50.0))
    for _ in range(33):
        drawn.lanelet([drawn.way(*row(3.0, 0.0, 50.0))], [low])
    with pytest.raises(InputError, match=rf"way {low} is a border of more than 32 lanelets; fix the map"):
        drawn.lanes(tmp_path)
