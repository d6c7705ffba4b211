"""Figures of a reproduction: every curve is told apart without its colour."""

from __future__ import annotations

from pathlib import Path

import matplotlib.axes
import pytest

from isac_cosim.studies.reproduction.experiments import drawings


def test_each_variant_has_its_own_mark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    marks: list[str] = []
    plot = matplotlib.axes.Axes.plot

    def noted(axes: matplotlib.axes.Axes, *points: object, **style: object) -> object:
        if "marker" in style:
            marks.append(str(style["marker"]))
        return plot(axes, *points, **style)

    monkeypatch.setattr(matplotlib.axes.Axes, "plot", noted)
    curves = {f"variant {k}": [0.5, 0.4] for k in range(8)}
    drawings.lines(curves, [0, 1], tmp_path / "figure.png", ("title", "x", "y"))
    assert len(set(marks)) == 8
