"""The figure of a closed loop: what each arm changed."""

from __future__ import annotations

from pathlib import Path

from models.closed_loop.results import ClosedLoopResult
from models.closed_loop.scoring import REFERENCE
from models.report.figures import BLUE, GREY, figure

SHOWN = {
    "ttc_below_3_s": "time to collision\nbelow 3 s",
    "ttc_below_1_5_s": "time to collision\nbelow 1.5 s",
    "drac_above_3_4_s": "DRAC\nabove 3.4 m/s²",
    "travel_s_per_km": "travel time",
}
"""The figures that are drawn, and their titles."""


def arms(result: ClosedLoopResult, path: Path) -> None:
    """Draw by how much each arm differs from `none`, percent, with the intervals over seeds."""
    names = [arm for arm in result.arms if arm != REFERENCE]
    with figure(path, 11, 1.6 + 0.42 * len(names)) as drawn:
        for axes, (name, title) in zip(drawn.subplots(1, len(SHOWN), sharey=True), SHOWN.items(), strict=True):
            axes.axvline(0.0, color=GREY, lw=1, ls="--")
            for row, arm in enumerate(names):
                difference = result.arms[arm].difference[name]
                if difference.relative is None:
                    axes.text(0.0, row, " undefined", va="center", fontsize=8, color=GREY)
                    continue
                interval = difference.relative_interval
                if interval is not None:
                    axes.plot([100 * interval.low, 100 * interval.high], [row, row], color=BLUE, lw=2)
                axes.plot(100 * difference.relative, row, "D", color=BLUE, ms=6)
            axes.set_yticks(range(len(names)), names)
            axes.set(xlabel="against none, %", ylim=(len(names) - 0.5, -0.5))
            axes.set_title(title)
