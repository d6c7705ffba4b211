"""Records in motion as one animated picture: the road from above, and what a predictor says as the record goes on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, cast

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from PIL import Image

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError
from isac_cosim.base.files import replace_file
from isac_cosim.evaluation.report.figures import BACKEND, BLUE, CYCLE, GREEN, GREY, ORANGE, RED, STYLE
from isac_cosim.evaluation.report.record_view import dense, edges
from isac_cosim.evaluation.report.replay.content import RATE_HZ, Moving, Replay, VehicleNear

EVERY = 2
"""Of so many places of a record one is a frame."""
HOLD_MS = 1_500
"""How long the last frame of a record stays."""
SIZE_IN, DPI = (9.0, 4.9), 100
AHEAD_M, ASIDE_M = 62.0, 19.0
"""Half of what is seen of the road, along it and across it, m."""
ENDINGS = (".webp", ".gif")
DARK, PALE, MARKING = "#111827", "#d1d5db", "#ffffff"


def animate(replay: Replay, records: Sequence[Moving], path: Path) -> int:
    """Write records of a replay, one after the other in real time, as an animated picture that repeats.

    path: ends in .webp or .gif, and is replaced. Returns how many frames it has. Raises InputError for another ending
    or without a record, OutputError where it cannot be written.
    """
    if path.suffix not in ENDINGS:
        raise InputError(f"{path}: is not the name of an animation; let it end in {' or '.join(ENDINGS)}")
    if not records:
        raise InputError(f"{replay.title}: has no record to animate")
    frames, durations = list[Image.Image](), list[int]()
    for record in records:
        frames += _frames(replay, record)
        durations += [round(1000 * EVERY / RATE_HZ)] * (len(frames) - len(durations))
        durations[-1] = HOLD_MS
    options: dict[str, Any] = {"save_all": True, "append_images": frames[1:], "duration": durations, "loop": 0}
    if path.suffix == ".webp":
        options |= {"quality": 70, "method": 4}
    replace_file(path, lambda partial: frames[0].save(partial, **options))
    return len(frames)


def _frames(replay: Replay, record: Moving) -> Iterator[Image.Image]:
    defaults = {key: value for key, value in mpl.rcParamsDefault.items() if key not in BACKEND}
    with mpl.rc_context(cast(Any, {**defaults, **STYLE})):
        drawn = Figure(figsize=SIZE_IN, dpi=DPI, layout="constrained")
        canvas = FigureCanvasAgg(drawn)
        road, answers = drawn.subplots(2, 1, height_ratios=(2.0, 1.5))
        for row in range(0, record.truth.shape[1], EVERY):
            road.clear()
            answers.clear()
            _road(road, replay, record, row)
            _answers(answers, replay, record, row / RATE_HZ)
            canvas.draw()  # type: ignore[no-untyped-call]
            pixels = canvas.buffer_rgba()  # type: ignore[no-untyped-call]
            yield Image.fromarray(np.asarray(pixels)).convert("RGB")


def _road(axes: Axes, replay: Replay, record: Moving, row: int) -> None:
    """Draw the road around the TV at a row of the record, turned so that the TV drives to the right."""
    way = record.truth[:, -1] - record.truth[:, 0]
    heading, middle = float(np.arctan2(way[1], way[0])), record.truth[:, row]

    def turned(places: Array) -> Array:
        cos, sin = np.cos(heading), np.sin(heading)
        return np.asarray(np.array([[cos, sin], [-sin, cos]]) @ (places - middle[:, None]))

    for width, centre in replay.lanes:
        line = dense(centre)
        near = np.hypot(*(line - middle).T) < 2 * AHEAD_M
        if near.sum() > 1:
            left, right = (turned(edge.T) for edge in edges(line[near], width))
            axes.fill(*np.concatenate([left, right[:, ::-1]], axis=1), color=PALE, linewidth=0.0)
            for edge in (left, right):
                axes.plot(*edge, color=MARKING, linewidth=1.4, dashes=(6, 6))
    named = list[tuple[str, float, float, float]]()
    for name, x_m, y_m, azimuth in replay.sites:
        x, y = turned(np.array([[x_m], [y_m]]))[:, 0]
        if abs(x) < AHEAD_M and abs(y) < ASIDE_M:
            turn = -azimuth - float(np.degrees(heading))
            axes.plot(x, y, marker=(3, 0, turn), color=GREEN, markersize=10)
            if not any(np.hypot(x_m - other[1], y_m - other[2]) < 3.0 for other in named):
                axes.annotate(name, (x, y), (0, 8), textcoords="offset points", ha="center", fontsize=8, color=DARK)
                named.append((name, x_m, y_m, azimuth))
    time_s = row / RATE_HZ
    for other in record.others:
        places = _place(other, time_s)
        if places is not None:
            _vehicle(axes, turned(places), (other.length_m, other.width_m), GREY)
    for path, color, width in ((record.sensed, BLUE, 3.0), (record.truth, DARK, 1.0)):
        axes.plot(*turned(path[:, : row + 1]), color=color, linewidth=width)
    for name, path, size, color in (
        ("UV", record.uv, record.sizes[1], ORANGE), ("TV", record.truth, record.sizes[0], BLUE),
    ):  # fmt: skip
        if row < path.shape[1]:
            around = path[:, [max(row - 3, 0), min(row + 3, path.shape[1] - 1), row]]
            _vehicle(axes, turned(around), size, color, name)
    maneuver = record.maneuvers[0]
    phase = "before onset" if time_s < maneuver.onset_s else "begun" if time_s < maneuver.commit_s else "committed"
    axes.set_title(f"{record.intention.replace('_', ' ').capitalize()}: {phase}", color=DARK)
    axes.set_xlim(-AHEAD_M, AHEAD_M)
    axes.set_ylim(-ASIDE_M, ASIDE_M)
    axes.set_aspect("equal")
    axes.set_axis_off()


def _place(vehicle: VehicleNear, time_s: float) -> Array | None:
    """Return where a vehicle comes from, goes to and is at an instant, (2, 3), m; None while it is not there."""
    row, last = (time_s - vehicle.from_s) / vehicle.step_s, vehicle.places.shape[1] - 1
    if not 0 <= row <= last:
        return None
    rows = np.clip([row - 1, row + 1, row], 0, last)
    return np.stack([np.interp(rows, np.arange(last + 1), axis) for axis in vehicle.places])


def _vehicle(axes: Axes, places: Array, size: tuple[float, float], color: str, name: str = "") -> None:
    """Draw a vehicle. places: where it comes from, goes to and has its front bumper, (2, 3), m."""
    (length, width), way = size, places[:, 1] - places[:, 0]
    ahead = way / np.hypot(*way) if np.hypot(*way) > 0.05 else np.array([1.0, 0.0])
    left, front = np.array([-ahead[1], ahead[0]]) * width / 2, places[:, 2]
    back = front - length * ahead
    axes.add_patch(Polygon([front + left, back + left, back - left, front - left], color=color, zorder=3))
    if name:
        x, y = (front + back) / 2
        axes.annotate(name, (x, y), (0, 9), textcoords="offset points", ha="center", fontsize=9, weight="bold")


def _answers(axes: Axes, replay: Replay, record: Moving, time_s: float) -> None:
    """Draw the probabilities that are known at an instant, and when the maneuver begins and commits."""
    end_s = (record.truth.shape[1] - 1) / RATE_HZ
    maneuver = record.maneuvers[0]
    for at_s, name in ((maneuver.onset_s, "onset"), (maneuver.commit_s, "commit")):
        if at_s <= min(time_s, end_s):
            axes.axvline(at_s, color=RED, linestyle=":", linewidth=1.2)
            axes.annotate(name, (at_s, 1.02), (3, 0), textcoords="offset points", fontsize=8, color=RED)
    if (told := record.answers) is not None:
        ends = told.from_s + told.step_s * np.arange(len(told.probabilities))
        for k, name in enumerate(replay.classes):
            known = ends <= time_s + 1e-9
            label, width = name.replace("_", " "), 3.0 if name == record.intention else 1.4
            axes.plot(ends[known], told.probabilities[known, k], color=CYCLE[k], linewidth=width, label=label)
        axes.legend(loc="center left", fontsize=8, handlelength=1.5)
    axes.axvline(time_s, color=GREY, linewidth=0.8)
    axes.set_xlim(0.0, end_s)
    axes.set_ylim(0.0, 1.12)
    axes.set_yticks([0.0, 0.5, 1.0])
    axes.set_xlabel("s of the record")
    axes.set_ylabel("probability")
