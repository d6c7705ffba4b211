"""The road as the network knows it, as an image: all of it, and the surroundings of the vehicle in the first slot.

It is drawn without pyplot, and whatever the user has configured of matplotlib.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.closed_loop.mobile_network import Knowledge
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.isacsim.traffic.road_coordinates import lane_headings

WIDTH, HEIGHT, DPI = 960, 540, 100
"""Of an image, pixels, and pixels an inch."""
CLOSE_UP_M = 160.0
"""Width of the surroundings that are shown to scale, m."""
TV_COLOUR, UV_COLOUR, OTHER_COLOUR, SITE_COLOUR, ADVICE_COLOUR = "#E69F00", "#0072B2", "#4b5563", "#009E73", "#D55E00"
MAP_COLOUR, ROAD_COLOUR, MARKING_COLOUR, LINE_COLOUR = "#c3c7cf", "#e5e7eb", "#ffffff", "#374151"
ROLES = {"TV": TV_COLOUR, "UV": UV_COLOUR, "other vehicle": OTHER_COLOUR}
SITE_M = 8.0
"""How far a panel's direction is drawn, m."""


class RoadPicture:
    """Draws images of one scenario."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._lanes = [outline for lane in scenario.lanes if len(outline := _lane_outline(lane))]
        points = np.concatenate([*self._lanes, np.array([(site.x, site.y) for site in scenario.sites]).reshape(-1, 2)])
        self._least, self._most = points.min(axis=0), points.max(axis=0)

    def drawn(self, knowledge: Knowledge, slots: Sequence[str], advised: Mapping[str, str]) -> npt.NDArray[np.uint8]:
        """Return an image, (HEIGHT, WIDTH, 3).

        slots: the vehicles that can be advised, in their order. advised: the instruction that each vehicle has or gets.
        """
        with mpl.rc_context():
            mpl.rcdefaults()
            figure = Figure(figsize=(WIDTH / DPI, HEIGHT / DPI), dpi=DPI)
            canvas = FigureCanvasAgg(figure)
            whole, near = self._axes(figure)
            recording = knowledge.surroundings.recording
            tracks = {track.vehicle: track for track in knowledge.surroundings.present(knowledge.time_s)}
            colours = _colours(tracks, knowledge.uv_of)
            outlines = {vehicle: _vehicle_outline(track, recording) for vehicle, track in tracks.items()}
            self._draw_whole(whole, outlines, colours)
            self._draw_near(near, outlines, colours, slots, advised)
            figure.suptitle(
                f"{recording.scenario}, seed {recording.seed}, {knowledge.time_s:.1f} s", x=0.01, ha="left", fontsize=11
            )
            _legend(figure)
            canvas.draw()  # type: ignore[no-untyped-call]
            return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()  # type: ignore[no-untyped-call]

    def _axes(self, figure: Figure) -> tuple[Axes, Axes]:
        """Return the axes of the whole network and of the close-up: the one above the other, or left of it."""
        width_m, height_m = np.maximum(self._most - self._least, 1.0)
        if height_m < 0.5 * width_m:
            share = float(np.clip(height_m / width_m * WIDTH / HEIGHT, 0.12, 0.45))
            places = (0.01, 0.92 - share, 0.98, share), (0.01, 0.08, 0.98, 0.82 - share)
        else:
            places = (0.01, 0.08, 0.42, 0.84), (0.45, 0.08, 0.54, 0.84)
        whole, near = (figure.add_axes(place) for place in places)
        for axes in (whole, near):
            axes.set(xticks=[], yticks=[], facecolor="white")
            axes.spines[:].set_color(MAP_COLOUR)
        return whole, near

    def _draw_whole(self, axes: Axes, outlines: Mapping[str, Array], colours: Mapping[str, str]) -> None:
        """Draw the network with a dot for each vehicle."""
        axes.add_collection(PolyCollection(self._lanes, facecolors=MAP_COLOUR, edgecolors=MAP_COLOUR, linewidths=0.6))
        sites = self._scenario.sites
        axes.plot([s.x for s in sites], [s.y for s in sites], "^", color=SITE_COLOUR, ms=5, mew=0)
        for vehicle, outline in outlines.items():
            axes.plot(*outline.mean(axis=0), "o", color=colours[vehicle], ms=3.5, mec="white", mew=0.3)
        size = self._most - self._least
        _show(axes, (self._least + self._most) / 2.0, 1.04 * size + 2.0)

    def _draw_near(
        self,
        axes: Axes,
        outlines: Mapping[str, Array],
        colours: Mapping[str, str],
        slots: Sequence[str],
        advised: Mapping[str, str],
    ) -> None:
        """Draw what is around the vehicle in the first slot, to scale."""
        shown = [vehicle for vehicle in (*slots, *advised, *outlines) if vehicle in outlines]
        middle = outlines[shown[0]].mean(axis=0) if shown else (self._least + self._most) / 2.0
        _show(axes, middle, np.array([CLOSE_UP_M, 0.0]))
        axes.add_collection(
            PolyCollection(self._lanes, facecolors=ROAD_COLOUR, edgecolors=MARKING_COLOUR, linewidths=1.5)
        )
        for site in self._scenario.sites:
            facing = SITE_M * np.array([np.sin(np.radians(site.azimuth_deg)), np.cos(np.radians(site.azimuth_deg))])
            axes.plot([site.x, site.x + facing[0]], [site.y, site.y + facing[1]], color=SITE_COLOUR, lw=2)
            axes.plot(site.x, site.y, "^", color=SITE_COLOUR, ms=9, mew=0)
        bodies = list(outlines.values())
        edges = [ADVICE_COLOUR if vehicle in advised else LINE_COLOUR for vehicle in outlines]
        widths = [2.0 if vehicle in advised else 0.6 for vehicle in outlines]
        axes.add_collection(
            PolyCollection(bodies, facecolors=[*colours.values()], edgecolors=edges, linewidths=widths, zorder=3)
        )
        for vehicle in dict.fromkeys((*slots, *advised)):
            if vehicle in outlines:
                number = f"{slots.index(vehicle) + 1} " if vehicle in slots else ""
                text = number + advised.get(vehicle, "").replace("_", " ")
                colour = ADVICE_COLOUR if vehicle in advised else LINE_COLOUR
                x, y = outlines[vehicle].mean(axis=0)
                axes.annotate(
                    text.strip(), (x, y), (0, 9), textcoords="offset points", ha="center", color=colour, fontsize=9,
                    clip_on=True, annotation_clip=True, zorder=4,
                )  # fmt: skip


def _show(axes: Axes, middle: Array, size: Array) -> None:
    """Show an area at the same scale both ways, and more where the axes have another shape. middle, size: m, (2,)."""
    box = axes.get_window_extent()
    pixel_m = max(size[0] / box.width, size[1] / box.height)
    reach = np.array([box.width, box.height]) * pixel_m / 2.0
    axes.set(xlim=(middle[0] - reach[0], middle[0] + reach[0]), ylim=(middle[1] - reach[1], middle[1] + reach[1]))


def _colours(tracks: Mapping[str, Track], uv_of: Mapping[str, str]) -> dict[str, str]:
    """Return the colour of each vehicle by its role. Most UVs are TVs of the vehicle ahead; those are shown as TVs."""
    uvs = set(uv_of.values())
    return {
        vehicle: TV_COLOUR if vehicle in uv_of else UV_COLOUR if vehicle in uvs else OTHER_COLOUR for vehicle in tracks
    }


def _legend(figure: Figure) -> None:
    """Say what the colours mean, at the bottom of the image."""
    marks = [Line2D([], [], ls="", marker="s", color=colour, ms=8, label=role) for role, colour in ROLES.items()]
    marks.append(Line2D([], [], ls="", marker="^", color=SITE_COLOUR, ms=8, label="site"))
    marks.append(Rectangle((0, 0), 1, 1, fc="none", ec=ADVICE_COLOUR, lw=2, label="advised"))  # type: ignore[arg-type]
    figure.legend(handles=marks, loc="lower left", ncols=len(marks), frameon=False, fontsize=9, borderaxespad=0.3)


def _lane_outline(lane: Lane) -> Array:
    """Return the outline of a lane, m, (2 n, 2); empty where the lane has no extent."""
    line = lane.shape @ np.array([1.0, 1.0j])
    line = line[np.concatenate([[True], np.abs(np.diff(line)) > 0.0])]
    if len(line) < 2:
        return np.empty((0, 2))
    steps = np.diff(line) / np.abs(np.diff(line))
    directions = np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    lengths = np.abs(directions)
    # Where a line turns back on itself, its two directions cancel.
    sideways = 1j * np.where(lengths > 1e-6, directions, 1.0) / np.where(lengths > 1e-6, lengths, 1.0)
    sideways *= lane.width_m / 2.0
    outline = np.concatenate([line + sideways, (line - sideways)[::-1]])
    return np.stack([outline.real, outline.imag], axis=1)


def _vehicle_outline(track: Track, recording: Recording) -> Array:
    """Return the corners of a vehicle in the one step of its track, m, (4, 2). Its reference point is the front."""
    front = track.x[0] + 1j * track.y[0]
    heading = lane_headings(recording.lanes, np.asarray(track.lane[:1]), track.lane_pos[:1])[0]
    aside = 1j * heading * track.width_m / 2.0
    rear = front - heading * track.length_m
    corners = np.array([front + aside, front - aside, rear - aside, rear + aside])
    return np.stack([corners.real, corners.imag], axis=1)
