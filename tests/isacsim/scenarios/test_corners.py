"""Corners that are too sharp for the speed limit are reported, and the worst edge is named."""

import numpy as np

from isac_cosim.isacsim.scenarios.corners import sharp_corners
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.reference_line import RoundingSettings


def road(name: str, turn_deg: float) -> Lane:
    end = 200.0 + 200.0 * np.exp(1j * np.radians(turn_deg))
    shape = np.array([[0.0, 0.0], [200.0, 0.0], [end.real, end.imag]])
    return Lane(f"{name}_0", name, 0, 3.2, 400.0, shape, ())


def test_the_worst_edge_is_named_and_gentle_ones_are_not_counted() -> None:
    lanes = (road("gentle", 2.0), road("sharp", 9.0), road("worst", 20.0), road("unused", 40.0))
    limits = dict.fromkeys((lane.id for lane in lanes), 30.0)
    corners = sharp_corners(lanes, {"gentle", "sharp", "worst"}, limits, RoundingSettings())
    assert corners is not None
    assert (corners.edges, corners.worst_edge, corners.speed_mps) == (2, "worst", 30.0)
    assert 0.5 < corners.shift_m <= 1.0
    assert str(corners).startswith("2 of 3 edges bend too sharply")
    assert "worst" in str(corners)


def test_a_lower_limit_or_a_gentler_road_gives_no_warning() -> None:
    assert sharp_corners((road("a", 20.0),), {"a"}, {"a_0": 5.0}, RoundingSettings()) is None
    assert sharp_corners((road("a", 2.0),), {"a"}, {"a_0": 30.0}, RoundingSettings()) is None


def test_lanes_and_junctions_do_not_count_as_edges() -> None:
    """Two lanes turn on two lanes inside a junction, into an edge that was not asked for and turns sharply itself."""

    def piece(edge: str, index: int, points: list[complex], successor: str = "") -> Lane:
        shape = np.array([[point.real, point.imag + 3.2 * index] for point in points])
        following = (f"{successor}_{index}",) if successor else ()
        return Lane(f"{edge}_{index}", edge, index, 3.2, float(abs(points[-1] - points[0])), shape, following)

    turn, away = np.exp(0.35j), np.exp(1.0j)
    lanes = tuple(
        lane
        for k in range(2)
        for lane in (
            piece("in", k, [0j, 200 + 0j], ":J"),
            piece(":J", k, [200 + 0j, 205 + 0j, 205 + 10 * turn], "out"),
            piece("out", k, [205 + 10 * turn, 205 + 20 * turn, 205 + 20 * turn + 200 * away]),
        )
    )
    limits = dict.fromkeys((lane.id for lane in lanes), 30.0)
    corners = sharp_corners(lanes, {"in"}, limits, RoundingSettings())
    assert corners is not None
    assert (corners.edges, corners.of, corners.worst_edge) == (1, 1, ":J")
