"""Curves that a page draws itself, from the same rows that it offers as CSV: values under the pointer, in its theme."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

from isac_cosim.evaluation.statistics import Estimate

AnyRow = Mapping[str, Any]


@dataclass(frozen=True)
class Chart:
    """How rows are drawn as curves.

    x: column along the x axis. panels: a column for each chart, one above the other, on the same x axis. line: column
    with the name of the line that a row belongs to. x_title: by
    default, the column. y_title: of all panels; by default, their columns. ranges: of the x and the y axis. log:
    whether the x axis is logarithmic. backwards: whether x falls to the right. stairs: whether a value holds until the
    next. guide: where a vertical line stands, and what it says. diagonal: what a line through equal values says.
    least: least number in the column "windows" of rows that are drawn. whole: column of a count, and the count from
    which on marks are filled. single: column and the entry in it of rows that are marks apart from their line.
    """

    x: str
    panels: Sequence[str]
    line: str = "predictor"
    x_title: str = ""
    y_title: str = ""
    ranges: tuple[tuple[float, float] | None, tuple[float, float] | None] = (None, (0.0, 1.02))
    log: bool = False
    backwards: bool = False
    stairs: bool = False
    guide: tuple[float, str] | None = None
    diagonal: str = ""
    least: int = 0
    whole: tuple[str, int] | None = None
    single: tuple[str, str] | None = None

    def content(self, rows: Sequence[AnyRow]) -> dict[str, Any]:
        """Return the curves of rows as plain values for `charts.js`; no lines where nothing can be drawn."""
        drawn = self.drawn(rows)
        lines = [line for panel in range(len(self.panels)) for line in self._lines(panel, drawn)]
        return {
            "lines": lines,
            "x": self.x_title or self.x,
            "y": [self.y_title or panel for panel in self.panels],
            "ranges": self.ranges,
            "log": self.log,
            "backwards": self.backwards,
            "stairs": self.stairs,
            "guide": self.guide,
            "diagonal": self.diagonal,
        }

    def drawn(self, rows: Sequence[AnyRow]) -> list[AnyRow]:
        """Return the rows that are drawn, as far as they have values."""
        return [row for row in rows if not self.least or (row.get("windows") or 0) >= self.least]

    def hollow(self, row: AnyRow) -> bool:
        """Return whether a row's mark is hollow: it is known not to be over everything that it should be over."""
        over = None if self.whole is None else row.get(self.whole[0])
        return self.whole is not None and over is not None and over < self.whole[1]

    def _lines(self, panel: int, rows: Sequence[AnyRow]) -> list[dict[str, Any]]:
        column, found = self.panels[panel], dict[tuple[str, bool], dict[str, Any]]()
        for row in rows:
            x, y = _number(row.get(self.x)), _number(row.get(column))
            if x is None or y is None:
                continue
            name = str(row.get(self.line))
            single = self.single is not None and row.get(self.single[0]) == self.single[1]
            new: dict[str, Any] = {"name": name, "panel": panel, "single": single, "x": [], "y": [], "hollow": []}
            line = found.setdefault((name, single), new)
            line["x"].append(x)
            line["y"].append(y)
            line["hollow"].append(self.hollow(row))
        return [*found.values()]


def _number(value: Any) -> float | None:
    """Return a finite number, shortened; None of anything else."""
    if isinstance(value, Estimate):
        value = value.value
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        return None
    return float(f"{value:.6g}")
