"""Sites along the roads of a network: poles on alternating sides, each with panels that face up and down the road."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from xml.sax.saxutils import quoteattr

import numpy as np
from pydantic import Field
from scipy.spatial import cKDTree

from isac_cosim.base.arrays import Array
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.scenario import SITE_TYPE, Site
from isac_cosim.isacsim.scenarios.sumo_schemas import in_full

STATION_STEP_M = 5.0
"""Distance between the points of a lane at which a pole may stand, m."""


class PlacementSettings(Settings):
    """Where poles stand, and where their panels look."""

    spacing_m: float = Field(150.0, ge=20.0, le=2000.0, description="distance between poles along the road, m")
    set_back_m: float = Field(12.0, ge=1.0, le=100.0, description="distance of a pole from the edge of the road, m")
    height_m: float = Field(15.0, ge=2.0, le=100.0, description="height of the antennas above the road, m")
    off_road_axis_deg: float = Field(
        45.0, ge=0.0, le=90.0, description="angle between a panel and the axis of the road, degrees"
    )


def place(
    lanes: Sequence[Lane], edges: Collection[str], settings: PlacementSettings, lefthand: bool = False
) -> list[Site]:
    """Return sites for the given edges: a pole wherever the road has none within the spacing.

    lefthand: whether traffic keeps left; the poles of a mirrored network are the mirror image.
    A pole stands set back from the outermost lane, beyond the opposite carriageway if necessary, and no lane is closer
    than the set-back. Poles alternate between the sides of the road where there is room.
    """
    surface = _Surface(lanes)
    nearside = 1.0 if lefthand else -1.0
    borders: dict[str, tuple[Lane, Lane]] = {}
    for lane in lanes:
        if lane.edge in edges:
            outermost, innermost = borders.get(lane.edge, (lane, lane))
            borders[lane.edge] = (min(outermost, lane, key=_index), max(innermost, lane, key=_index))
    stations = np.empty((0, 2))
    sites: list[Site] = []
    for outermost, innermost in sorted(borders.values(), key=lambda pair: (-pair[0].length_m, pair[0].edge)):
        for point, heading in _stations(outermost):
            if len(stations) and np.hypot(*(stations - point).T).min() < settings.spacing_m:
                continue
            first = -nearside if len(stations) % 2 else nearside
            for side in (first, -first):
                lanes_between = 0 if side == nearside else innermost.index - outermost.index
                edge_of_road = (lanes_between + 0.5) * (outermost if side == nearside else innermost).width_m
                pole = surface.clear_point(point, heading, side, edge_of_road, settings.set_back_m)
                if pole is not None:
                    sites += panels(f"pole{len(stations)}", pole, heading, side, settings)
                    stations = np.vstack([stations, point])
                    break
    return sites


def panels(name: str, pole: Array, heading: float, side: float, settings: PlacementSettings) -> list[Site]:
    """Return the two panels of a pole. heading: of the road, rad. side: +1 for a pole on its left, -1 on its right."""
    compass = 90.0 - np.degrees(heading)
    turns = (settings.off_road_axis_deg, 180.0 - settings.off_road_axis_deg)
    return [
        # Clockwise from the driving direction is towards the road for a pole on its left.
        Site(f"{name}_{end}", float(pole[0]), float(pole[1]), settings.height_m, float((compass + side * turn) % 360.0))
        for end, turn in zip(("up", "down"), turns, strict=True)
    ]


def sites_file(sites: Iterable[Site], origin: tuple[float, float] = (0.0, 0.0)) -> str:
    """Return an additional file with the sites as POIs, which sumo-gui and netedit show. origin: of their plane, m."""
    lines = [
        f'<poi id={quoteattr(site.id)} x="{site.x + origin[0]:.2f}" y="{site.y + origin[1]:.2f}" type="{SITE_TYPE}" '
        f'color="red" layer="100">\n    <param key="height" value="{in_full(site.height_m)}"/>\n'
        f'    <param key="azimuth" value="{site.azimuth_deg:.1f}"/>\n  </poi>'
        for site in sites
    ]
    return "<additional>\n  " + "\n  ".join(lines) + "\n</additional>\n"


def _index(lane: Lane) -> int:
    return lane.index


def _stations(lane: Lane) -> Iterable[tuple[Array, float]]:
    """Points every few metres along a lane, with its heading there, rad."""
    steps = np.diff(lane.shape, axis=0)
    lengths = np.hypot(*steps.T)
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    for at in np.arange(min(STATION_STEP_M, ends[-1] / 2.0), ends[-1], STATION_STEP_M):
        k = min(int(np.searchsorted(ends, at, side="right")) - 1, len(steps) - 1)
        yield lane.shape[k] + steps[k] * (at - ends[k]) / lengths[k], float(np.arctan2(steps[k, 1], steps[k, 0]))


class _Surface:
    """The area of the roads, as points along all lanes and the largest half-width."""

    def __init__(self, lanes: Sequence[Lane]) -> None:
        points, widths = [], []
        for lane in lanes:
            along = [point for point, _ in _stations(lane)]
            points += [*along, lane.shape[0], lane.shape[-1]]
            widths += [lane.width_m / 2.0] * (len(along) + 2)
        self._tree = cKDTree(np.array(points))
        self._widest = max(widths)

    def clear_point(self, point: Array, heading: float, side: float, edge_m: float, set_back_m: float) -> Array | None:
        """The closest point on a side of the road that is set back from every lane; None if none is within 60 m."""
        outward = side * np.array([-np.sin(heading), np.cos(heading)])
        for further in np.arange(0.0, 60.0, 3.0):
            pole = point + outward * (edge_m + set_back_m + further)
            if self._tree.query(pole)[0] >= self._widest + set_back_m - STATION_STEP_M / 2.0:
                return np.asarray(pole)
        return None
