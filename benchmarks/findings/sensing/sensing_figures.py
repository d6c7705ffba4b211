"""The two figures of docs/sensing.md. Run: python -m isac_cosim.benchmarks.findings.sensing.sensing_figures [FOLDER]"""

from __future__ import annotations

import sys
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.report.figures import figure
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.bounds import cell_bound, measured_bound
from isac_cosim.isacsim.radio.estimators import ESTIMATORS
from isac_cosim.isacsim.radio.waveform import Waveform
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.isacsim.tracking.fusion import position_bound
from isac_cosim.isacsim.tracking.fusion_methods import FUSION_METHODS, FusionSettings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WAVEFORM = Waveform()
COLOURS = ("#1b6ca8", "#c8553d", "#5b8c5a", "#7d5ba6")
FUSIONS = {
    "information": FusionSettings(),
    "eq5, weights by covariance": FusionSettings(method="eq5", eq5_weights="covariance"),
    "eq5, the paper's weights": FusionSettings(method="eq5"),
}
MASTS = (
    Site("a", -100, 20, 25, 135),
    Site("b", 100, -20, 25, 315),
    Site("c", -100, -20, 10, 45),
    Site("d", 100, 20, 25, 225),
)


def over_bound(estimator: str, snr_db: float, count: int = 6000) -> float:
    """RMSE over the bound: root mean square over angle, delay and Doppler, outliers included."""
    rng = np.random.default_rng(1)
    cells = rng.uniform([-3.4, -10.0, -1.5], [3.4, -1.0, 1.5], (count, 3))
    snr = np.full(count, 10 ** (snr_db / 10))
    error = ESTIMATORS[estimator].observe(cells, snr, WAVEFORM, rng).cells - cells
    return float(np.sqrt(np.mean((error / cell_bound(snr[0], WAVEFORM)) ** 2)))


def position_errors(name: str, sites: int, snr_db: float, count: int = 4000) -> tuple[Array, Array]:
    """Position errors of a fusion, m, (count,), and the bound of each, m."""
    rng = np.random.default_rng(2)
    state = rng.uniform([-60, -10, -35, -2], [60, 10, 35, 2], (count, 4))
    panels = Panels.of(MASTS, 0.8).take(np.tile(np.arange(sites), (count, 1)))
    snr = np.full((count, sites), 10 ** (snr_db / 10))
    deviation = measured_bound(snr, WAVEFORM)
    measured = panels.measured(state) + deviation * rng.standard_normal(deviation.shape)
    settings = FUSIONS[name]
    used = np.ones((count, sites), dtype=bool)
    fixes = FUSION_METHODS[settings.method](measured, deviation, used, panels, settings)
    bound = position_bound(state, measured_bound(snr, WAVEFORM), panels)
    return np.hypot(*(fixes.state - state)[:, :2].T), np.sqrt(bound[:, 0, 0] + bound[:, 1, 1])


def draw_estimators(drawn: Figure) -> None:
    """Draw RMSE over bound against SNR for every estimator."""
    axes = drawn.subplots()
    levels = np.arange(-34, 21, 2.0)
    for (name, estimator), colour in zip(ESTIMATORS.items(), cycle(COLOURS), strict=False):
        axes.semilogy(levels, [over_bound(name, snr) for snr in levels], color=colour, label=estimator.label)
    axes.axhline(1, color="0.6", linewidth=0.8)
    axes.set(xlabel="per-element SNR, dB", ylabel="RMSE / Cramér-Rao bound", xlim=(-34, 20), ylim=(0.8, 3000))
    axes.legend(frameon=False)
    plain(axes)


def draw_fusions(drawn: Figure) -> None:
    """Draw the position error against the number of sites for every fusion: root mean square and median."""
    counts = (2, 3, 4)
    for axes, snr_db in zip(drawn.subplots(1, 2, sharey=True), (0.0, 10.0), strict=True):
        for colour, name in zip(COLOURS, FUSIONS, strict=False):
            errors = [position_errors(name, n, snr_db)[0] for n in counts]
            axes.semilogy(counts, [np.sqrt(np.mean(e**2)) for e in errors], "o-", color=colour, label=f"{name}")
            axes.semilogy(counts, [np.median(e) for e in errors], "o:", color=colour, markerfacecolor="white")
        bound = [np.sqrt(np.mean(position_errors("information", n, snr_db)[1] ** 2)) for n in counts]
        axes.semilogy(counts, bound, "_", color="black", markersize=22, label="bound")
        axes.set(xlabel="sites", xticks=counts, title=f"{snr_db:g} dB")
        plain(axes)
    drawn.axes[0].set_ylabel("position error, m")
    drawn.axes[0].legend(frameon=False, fontsize=8, title="solid: RMS, dotted: median", title_fontsize=8)


def plain(axes: Axes) -> None:
    """Leave out what of a frame says nothing."""
    axes.grid(visible=True, which="major", color="0.9")
    axes.spines[["top", "right"]].set_visible(False)


def main(folder: Path) -> None:
    """Write both figures into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    with figure(folder / "sensing_estimators.png", 7, 4.2, style={}, dpi=130) as drawn:
        draw_estimators(drawn)
    with figure(folder / "sensing_fusion.png", 8, 4.2, style={}, dpi=130) as drawn:
        draw_fusions(drawn)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/figures"))
