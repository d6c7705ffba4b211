"""Draws one record: the road from above, the sensed state over the true one, and the predictor's probabilities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.evaluation.on_windows.predictions import Predictions
from isac_cosim.evaluation.report.figures import BLUE, CYCLE, GREEN, GREY, ORANGE, RED, despine, figure
from isac_cosim.evaluation.report.parts import counted
from isac_cosim.labeling.intentions import KNOWN, Intention, spoken

ROAD, MARKING, GROUND, DARK, PALE = "#d1d5db", "white", "#f8fafc", "#111827", "#f3f4f6"
BEFORE_ONSET = "before onset: nothing has happened yet"
COMPONENTS = (
    ("x", "position along, m"), ("y", "position across, m"), ("u", "velocity along, m/s"),
    ("v", "velocity across, m/s"), ("a", "acceleration along, m/s²"), ("b", "acceleration across, m/s²"),
)  # fmt: skip
"""The six state components, each with the cell of the figure in which it is drawn."""


class DrawnLane(Protocol):
    """A lane to draw: centre line (n, 2), m, in the scenario's plane."""

    @property
    def shape(self) -> npt.NDArray[Any]: ...
    @property
    def width_m(self) -> float: ...


class DrawnSite(Protocol):
    """A site to draw, m, in the scenario's plane."""

    @property
    def id(self) -> str: ...
    @property
    def x(self) -> float: ...
    @property
    def y(self) -> float: ...


@dataclass(frozen=True)
class RecordView:
    """What is drawn of one record. Times are in s after onset, states in m, m/s and m/s2.

    tv, truth: sensed and true states of the TV, (6, S). uv: reported states of the UV, (6, C).
    t_tv, t_uv: times of their samples, (S,) and (C,).
    commit_s: time of the commit.
    classes: names of the G intentions.
    t_end, probabilities: ends of windows, (n,), and the predictor's probabilities for those windows, (n, G).
    """

    title: str
    tv: Array
    truth: Array
    uv: Array
    t_tv: Array
    t_uv: Array
    commit_s: float
    classes: Sequence[str] = ()
    t_end: Array | None = None
    probabilities: Array | None = None


def draw_record(view: RecordView, lanes: Sequence[DrawnLane], sites: Sequence[DrawnSite], path: Path) -> None:
    """Draw a record as a PNG: the road around it, the whole network, the six state components, the probabilities.

    lanes, sites: of the scenario. path: file to write.
    """
    rows = ["RRM", "xua", "yvb"] + (["SSS"] if view.probabilities is not None else [])
    heights = [1.9, 1, 1] + ([1.15] if view.probabilities is not None else [])
    with figure(path, 13, 2.3 * sum(heights) * 0.92) as drawn:
        axes = drawn.subplot_mosaic("\n".join(rows), height_ratios=heights)
        _road(axes["R"], view, lanes)
        _map(axes["M"], view, lanes, sites)
        turned = [_turned(states, view) for states in (view.truth, view.tv)]
        for k, (cell, label) in enumerate(COMPONENTS):
            _component(axes[cell], view, turned[0][k], turned[1][k], label)
        for cell in "yvb":
            axes[cell].set_xlabel("time after onset, s")
        axes["x"].legend(loc="upper left", fontsize=9)
        if view.probabilities is not None:
            _probabilities(axes["S"], view)
        drawn.suptitle(view.title, x=0.01, ha="left", fontweight="bold", fontsize=13)


def _frame(view: RecordView) -> tuple[Array, Array]:
    """Return origin (2,) and rotation (2, 2) of the drawing: the TV's true start, x along its true heading there."""
    heading = view.truth[2:4, 0]
    c, s = heading / max(float(np.hypot(*heading)), 1e-9)
    return view.truth[:2, 0].astype(float), np.array([[c, s], [-s, c]])


def _turned(states: Array, view: RecordView) -> Array:
    """Return states (6, n) in the frame of the drawing."""
    origin, rotation = _frame(view)
    shift = np.array([[*origin], [0, 0], [0, 0]])[:, :, None]
    return np.asarray(np.einsum("ij,pjt->pit", rotation, states.reshape(3, 2, -1) - shift).reshape(6, -1))


def _road(axes: Axes, view: RecordView, lanes: Sequence[DrawnLane]) -> None:
    """Draw the road around the record, on different scales along and across."""
    truth, sensed, uv = (_turned(states, view) for states in (view.truth, view.tv, view.uv))
    origin, rotation = _frame(view)
    x = np.concatenate([truth[0], uv[0]])
    y = np.concatenate([truth[1], uv[1]])
    span = (x.min() - 15, x.max() + 15, y.min() - 6, y.max() + 6)
    middle, reach = (
        np.array([span[0] + span[1], span[2] + span[3]]) / 2,
        np.array([span[1] - span[0], span[3] - span[2]]) / 2 + 35,
    )
    for lane in lanes:
        line = dense((lane.shape - origin) @ rotation.T)
        near = (np.abs(line - middle) < reach).all(axis=1)
        if near.sum() < 2:
            continue
        left, right = edges(line, lane.width_m)
        axes.fill(*np.concatenate([left[near], right[near][::-1]]).T, color=ROAD, lw=0, zorder=1)
        for edge in (left, right):
            axes.plot(*edge[near].T, color=MARKING, lw=1.2, zorder=2)
    axes.plot(*truth[:2], color=DARK, lw=1, label="TV, true", zorder=5)
    axes.plot(*sensed[:2], color=RED, lw=2.2, label="TV, sensed", zorder=4)
    axes.plot(*uv[:2], color=GREEN, lw=2.2, label="UV", zorder=3)
    _instants(axes, view, truth, uv)
    axes.set(
        xlim=span[:2], ylim=span[2:], xlabel="along the road, m", ylabel="across (not to scale), m", facecolor=GROUND
    )
    axes.set_title("From above")
    axes.grid(visible=False)
    axes.legend(loc="upper left", ncols=3, frameon=True, framealpha=0.9, edgecolor="none", fontsize=9)


def _instants(axes: Axes, view: RecordView, truth: Array, uv: Array) -> None:
    """Mark where both vehicles were at the record's start, at onset and at commit."""
    for time, mark in ((view.t_tv[0], "start"), (0.0, "onset"), (view.commit_s, "commit")):
        if not view.t_tv[0] <= time <= view.t_tv[-1]:
            continue
        place = truth[:2, int(np.abs(view.t_tv - time).argmin())]
        axes.plot(*place, "o", color=DARK, mec="white", ms=7, zorder=6)
        axes.annotate(
            mark,
            (place[0], place[1]),
            (0, -9),
            textcoords="offset points",
            color=DARK,
            fontsize=9,
            ha="center",
            va="top",
            zorder=7,
        )
        axes.plot(*uv[:2, int(np.abs(view.t_uv - time).argmin())], "o", color=GREEN, mec="white", ms=7, zorder=6)


def _map(axes: Axes, view: RecordView, lanes: Sequence[DrawnLane], sites: Sequence[DrawnSite]) -> None:
    """Draw the whole network with its sites, north up, and where the record is."""
    axes.add_collection(LineCollection([lane.shape for lane in lanes], colors="#9ca3af", linewidths=0.8))
    if sites:
        axes.plot([s.x for s in sites], [s.y for s in sites], "^", color=ORANGE, mec="white", ms=9, label="site", ls="")
    axes.plot(*view.truth[:2], color=BLUE, lw=4, solid_capstyle="round", label="this record")
    axes.set_aspect("equal", adjustable="datalim")
    axes.autoscale_view()
    axes.margins(0.06)
    axes.set(xlabel="x, m", ylabel="y, m")
    axes.set_title("Network and sites")
    despine(axes)
    axes.legend(loc="best", fontsize=9)


def _component(axes: Axes, view: RecordView, true: Array, sensed: Array, label: str) -> None:
    """Draw one state component, true and sensed, each (S,), against time."""
    axes.plot(view.t_tv, true, color=DARK, lw=1, label="true", zorder=3)
    axes.plot(view.t_tv, sensed, color=RED, lw=2, label="sensed")
    _event_lines(axes, view)
    axes.set(xlim=(view.t_tv[0], view.t_tv[-1]))
    axes.set_title(label, fontsize=10, fontweight="normal")
    axes.locator_params(axis="y", nbins=5)


def _event_lines(axes: Axes, view: RecordView) -> None:
    """Mark onset and commit, and shade the time before onset."""
    axes.axvspan(view.t_tv[0], 0, color=PALE, lw=0, zorder=0)
    axes.axvline(0, color=GREY, lw=1, ls="--")
    if view.commit_s <= view.t_tv[-1]:
        axes.axvline(view.commit_s, color=GREY, lw=1, ls=":")


def _probabilities(axes: Axes, view: RecordView) -> None:
    """Draw the probability of every intention against the end of the window."""
    assert view.probabilities is not None
    assert view.t_end is not None
    begun = view.t_end >= 0
    for k, name in enumerate(view.classes):
        colour, probability = CYCLE[k % len(CYCLE)], view.probabilities[:, k]
        axes.plot(view.t_end, probability, color=colour, alpha=0.3)
        axes.plot(view.t_end[begun], probability[begun], color=colour, label=spoken(name))
    _event_lines(axes, view)
    for time, mark in ((0.0, "onset"), (view.commit_s, "commit")):
        if time <= view.t_tv[-1]:
            # Near the right edge the text goes to the left of its line.
            shift, align = (-3, "right") if time > view.t_tv[-1] - 0.3 else (3, "left")
            axes.annotate(mark, (time, 1.0), (shift, 2), textcoords="offset points", ha=align, color=GREY, fontsize=9)
    axes.annotate(
        BEFORE_ONSET, (0.0, 1.0), (-6, 2), textcoords="offset points", ha="right", color=DARK, fontsize=9,
    )  # fmt: skip
    axes.set(
        xlim=(view.t_tv[0], view.t_tv[-1]),
        ylim=(0, 1.12),
        xlabel="end of window: time after onset, s",
        ylabel="probability",
    )
    axes.set_yticks([0, 0.5, 1])
    axes.set_title("Predicted probabilities, against the end of the window")
    axes.legend(loc="center left", fontsize=9)


def dense(line: Array, step: float = 5.0) -> Array:
    """Return a polyline (n, 2) with points added so that they are at most `step` metres apart."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    at = np.unique(np.concatenate([length, np.arange(0, length[-1], step)]))
    return np.stack([np.interp(at, length, line[:, k]) for k in (0, 1)], axis=1)


def edges(line: Array, width: float) -> tuple[Array, Array]:
    """Return the left and the right edge of a lane along its centre line, each (n, 2)."""
    along = np.gradient(line, axis=0)
    along = along / np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1) * width / 2
    return line + aside, line - aside


PREFERRED = (Intention.LEFT_LANE_CHANGE, Intention.RIGHT_LANE_CHANGE, Intention.OVERTAKE, Intention.EVASIVE_SWERVE)
"""Intentions that are seen best from above, in the order in which they are tried."""


@dataclass(frozen=True)
class RecordChoice:
    """A record to draw, by its sample_id, and a sentence that says how it was chosen."""

    sample_id: str
    rule: str


def choose_record(predictions: Predictions) -> RecordChoice:
    """Choose a typical record among those that were measured.

    Of the records of one intention that were recognised at their last measured window, it is the one with the median
    probability of that intention there; of an even number the less confident of the middle two. The intention is the
    first of PREFERRED, then of the others, of which any record was recognised.
    """
    last = _last_windows(predictions)
    known = last[predictions.known[last]]
    if not len(known):
        return RecordChoice(
            str(predictions.sample_id[0]), "It is the first test record; none is of an intention that was trained."
        )
    label = predictions.label[known]
    recognised = predictions.predicted[known] == label
    for intention in dict.fromkeys((*PREFERRED, *KNOWN)):
        of_intention = label == intention
        if (of_intention & recognised).any():
            name, count = intention.text.replace("_", " "), int((of_intention & recognised).sum())
            rule = (
                f"Of {counted(int(of_intention.sum()), 'test record')} of {name}, {count} "
                f"{'was' if count == 1 else 'were'} recognised at the last measured window; this is the one of them "
                f"with the median probability of {name} there."
            )
            return RecordChoice(_median_record(predictions, known[of_intention & recognised]), rule)
    rule = (
        f"None of the {len(known)} test records was recognised at its last measured window; this is the one with the "
        "median probability of its true intention there."
    )
    return RecordChoice(_median_record(predictions, known), rule)


def _last_windows(predictions: Predictions) -> IntArray:
    """Return the row of the window that ends last, of each record, in the order of the records."""
    last: dict[str, int] = {}
    for row, sample_id in enumerate(predictions.sample_id):
        if sample_id not in last or predictions.end_s[row] > predictions.end_s[last[sample_id]]:
            last[sample_id] = row
    return np.array(list(last.values()), dtype=np.int64)


def _median_record(predictions: Predictions, rows: IntArray) -> str:
    """Return the sample_id of the row, among some, with the (lower) median probability of its true intention."""
    probability = predictions.outputs.probabilities[rows, predictions.label[rows]]
    order = np.argsort(probability, kind="stable")
    return str(predictions.sample_id[rows[order[(len(rows) - 1) // 2]]])
