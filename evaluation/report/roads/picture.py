"""A picture of the road of a file of trajectories, its sites and its first tracks: wrong axes are seen at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from isac_cosim.evaluation.report.figures import BLUE, GREY, ORANGE, RED, figure
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.trajectory_files.observed import FileStates

TRACKS = 40
"""So many vehicles are drawn, those that come first."""
WIDTH_IN, LEAST_IN, MOST_IN = 12.0, 3.0, 12.0
ARROW_M = 25.0
"""How far the arrow of a panel is drawn, m."""


def draw_road(scenario: Scenario, observed: FileStates, path: Path) -> None:
    """Draw lanes with an arrow where each begins, sites with where they face, and the first tracks, and write a PNG.

    Raises OutputError where it cannot be written.
    """
    points = np.concatenate([lane.shape for lane in scenario.lanes])
    across, along = sorted(np.ptp(points, axis=0) + 2 * ARROW_M)
    stretched = along > 4.0 * across  # a straight road is drawn wider than it is
    height = (
        LEAST_IN + 1.5
        if stretched
        else float(np.clip(WIDTH_IN * np.ptp(points[:, 1]) / max(np.ptp(points[:, 0]), 1.0), LEAST_IN, MOST_IN))
    )
    with figure(path, WIDTH_IN, height) as drawn:
        axes = drawn.subplots()
        _draw_lanes(axes, scenario)
        starts = observed.step[observed.starts[:-1]]
        for vehicle in np.argsort(starts, kind="stable")[:TRACKS].tolist():
            span = slice(int(observed.starts[vehicle]), int(observed.starts[vehicle + 1]))
            axes.plot(observed.x[span], observed.y[span], color=BLUE, linewidth=0.8, alpha=0.7)
            axes.plot(observed.x[span.start], observed.y[span.start], "o", color=BLUE, markersize=2.5)
        for site in scenario.sites:
            facing = np.radians(90.0 - site.azimuth_deg)
            axes.plot(site.x, site.y, "^", color=RED, markersize=6)
            axes.annotate(
                "", (site.x + ARROW_M * np.cos(facing), site.y + ARROW_M * np.sin(facing)), (site.x, site.y),
                arrowprops={"arrowstyle": "->", "color": RED},
            )  # fmt: skip
        if not stretched:
            axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("x, m")
        axes.set_ylabel("y, m" + (" (stretched)" if stretched else ""))
        count = min(TRACKS, len(observed.vehicles))
        panels = f"{len(scenario.sites)} panels"
        axes.set_title(f"{scenario.name}: lanes, {panels}, and the first {count} vehicles (dots: first seen)")


def _draw_lanes(axes: Axes, scenario: Scenario) -> None:
    for lane in scenario.lanes:
        axes.plot(lane.shape[:, 0], lane.shape[:, 1], color=GREY, linewidth=1.0, alpha=0.6)
        if not lane.edge.startswith(":"):
            first, second = lane.shape[0], lane.shape[1]
            step = (second - first) / max(float(np.hypot(*(second - first))), 1e-9)
            axes.annotate("", first + step * ARROW_M, first, arrowprops={"arrowstyle": "->", "color": ORANGE})
