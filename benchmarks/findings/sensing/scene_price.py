"""What knowing who is where costs the network: the scores of scenes against what is spent on them.

The same seeds of the bundled motorway are sensed as points and as bodies, with true association and with the network's
own tracks, and with fewer instants, less power and masts every 500 m. Each case and seed is a stage, whose
scores are kept in a file of JSON: the same command goes on where it was interrupted. Differences are paired by seed.

With the name of a PNG file, GOSPA is drawn against what is spent. With a `split.json` of `loss_split`, so are the right
answers that trees give just after onset.

Run: python -m isac_cosim.benchmarks.findings.sensing.scene_price FILE [FIRST:LAST] [SECONDS] [PNG] [JSON] [CASE ...]
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import write_json
from isac_cosim.base.parsing import number_range
from isac_cosim.benchmarks.findings.sensing.loss_split import ENDS, SCENES, TRUTH, Counts, accuracy
from isac_cosim.benchmarks.findings.sensing.scene_scores import ROAD, scored
from isac_cosim.benchmarks.findings.sensing.sensing_figures import COLOURS, plain
from isac_cosim.evaluation.report.figures import figure
from isac_cosim.evaluation.report.parts import markdown
from isac_cosim.isacsim.scene.episode import detections_kept
from isac_cosim.isacsim.scene.scores import SceneScores
from isac_cosim.isacsim.scene.settings import SceneSettings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BASE = "bodies"
"""The case that the others are compared with."""
SYMBOLS_PER_S = 28_000
"""Symbols of a second at 30 kHz."""


@dataclass(frozen=True)
class Case:
    """One way to sense. scene: settings. sites_of: the scenario whose sites sense."""

    scene: Mapping[str, str] = field(default_factory=dict)
    sites_of: str = ROAD

    @property
    def settings(self) -> SceneSettings:
        """The settings, checked."""
        return SceneSettings.model_validate(self.scene)

    @property
    def share(self) -> float:
        """Share of all symbols that sensing takes."""
        return self.settings.fixes_hz * self.settings.sent.waveform.symbols / SYMBOLS_PER_S


FEWER = ("bodies, 5 Hz", "bodies, 12.5 Hz")
"""The cases with fewer instants a second, the fewest first."""
POINTS, BODIES = {"bodies": "points"}, {"bodies": "bodies"}
CASES = {
    "points, truth": Case({**POINTS, "association": "truth"}),
    "points": Case(POINTS),
    "bodies, truth": Case({**BODIES, "association": "truth"}),
    "bodies": Case(BODIES),
    **{name: Case(SCENES[name]) for name in reversed(FEWER)},
    **{f"bodies, {dbm} dBm": Case({**BODIES, "power_dbm": dbm}) for dbm in ("36", "26")},
    "bodies, masts every 500 m": Case(BODIES, "motorway_sparse"),
}


HEAD = (
    "case", "share of symbols", "Mbit/s that they would carry", "rms, m", "missed, %", "false, %", "switches a km",
    "IDF1", "GOSPA a vehicle, m", "less than bodies by, m",
)  # fmt: skip
SHARE, JUST_AFTER = "share of symbols, %", "0 to 0.5 s"
SPENT: Mapping[str, Mapping[str, float]] = {
    SHARE: {name: 100 * CASES[name].share for name in (*FEWER, BASE)},
    "power, dBm": {name: CASES[name].settings.sent.power_dbm for name in ("bodies, 26 dBm", "bodies, 36 dBm", BASE)},
    "distance of masts, m": {BASE: 150.0, "bodies, masts every 500 m": 500.0},
}
"""What is spent on sensing along each axis of the figure, by case."""


def carried_mbps(share: float) -> float:
    """Return what a share of the symbols would carry at most on one layer of a panel, Mbit/s.

    By 3GPP TS 38.306, 4.1.2: 256-QAM, a code rate of 948/1024, and 14 % of overhead, in 3,276 subcarriers.
    """
    return share * SYMBOLS_PER_S * 3276 * 8 * 948 / 1024 * (1 - 0.14) / 1e6


def of_a_vehicle_m(scores: SceneScores) -> float:
    """Return the root mean square GOSPA as if each vehicle had its own, m: it does not grow with their number."""
    if scores.gospa_m is None or not scores.vehicle_fixes:
        return float("nan")
    return float(scores.gospa_m * np.sqrt(scores.instants / scores.vehicle_fixes))


def rows(scores_of: Mapping[str, Sequence[SceneScores]]) -> list[list[str]]:
    """Return the rows of the table, one for each case: means over the seeds, and the paired difference to `BASE`."""
    result = []
    base = [of_a_vehicle_m(one) for one in scores_of.get(BASE, ())]
    for name, of_case in scores_of.items():

        def mean(column: str, of_case: Sequence[SceneScores] = of_case) -> float:
            return float(np.mean([getattr(one, column) for one in of_case]))

        gospa = [of_a_vehicle_m(one) for one in of_case]
        less = [of - other for of, other in zip(base, gospa, strict=True)] if base and name != BASE else []
        result.append(
            [
                name,
                f"{CASES[name].share:.3f}",
                f"{carried_mbps(CASES[name].share):.1f}",
                f"{mean('rms_m'):.2f}",
                *(f"{100 * mean(column):.2g}" for column in ("missed", "false")),
                f"{mean('switches_per_km'):.2g}",
                f"{mean('idf1'):.3f}",
                f"{np.mean(gospa):.3f}",
                f"{np.mean(less):.3f} ({min(less):.3f} to {max(less):.3f})" if less else "",
            ]
        )
    return result


def answered(answers: Mapping[str, Mapping[str, Any]]) -> dict[str, tuple[float, float]]:
    """Return the right answers of trees in the half second after onset, % and half the interval, by case.

    answers: those of `loss_split`. The case "" is the truth, without an interval; the others' are of what they lose.
    """
    counts: dict[str, Counts] = {
        name: answers[f"trees; {way}"]["counts"]
        for name, way in {"": TRUTH, BASE: "bodies, tracks", **{name: name for name in FEWER}}.items()
        if f"trees; {way}" in answers
    }
    if lacking := sorted({"", BASE, *FEWER} - set(counts)):
        raise InputError(f"no answers by {', '.join(name or TRUTH for name in lacking)}; give them to loss_split")
    just_after = np.isin([row[1] for row in counts[""]], ENDS[JUST_AFTER])
    result = {"": (100 * accuracy(counts[""], just_after)[0], 0.0)}
    for name in (BASE, *FEWER):
        lost, half = accuracy(counts[name], just_after, counts[""])
        result[name] = result[""][0] + 100 * lost, 100 * half
    return result


def draw(
    scores_of: Mapping[str, Sequence[SceneScores]],
    drawn: Figure,
    answers: Mapping[str, tuple[float, float]] | None = None,
) -> None:
    """Draw the price of knowing: GOSPA a vehicle against what is spent, a point for each seed, a line for means.

    answers: as `answered` gives them; drawn against the share of symbols.
    """
    reference = {"bodies, truth": "true association", "points": "points"}
    panels = drawn.subplots(1, len(SPENT) + bool(answers))
    if answers:
        share = [100 * CASES[name].share for name in (*FEWER, BASE)]
        right, half = np.transpose([answers[name] for name in (*FEWER, BASE)])
        panels[-1].errorbar(share, right, half, color=COLOURS[0], marker="o", markersize=4, capsize=3, label="bodies")
        panels[-1].axhline(answers[""][0], color=COLOURS[3], linestyle="--", linewidth=1, label="true motion")
        panels[-1].set_xlabel(SHARE)
        panels[-1].set_ylabel("right in the half second after onset, %")
        panels[-1].legend(frameon=False, fontsize=8, loc="upper right", bbox_to_anchor=(1.0, 0.9))
        plain(panels[-1])
    for axes in panels[1 : len(SPENT)]:
        axes.sharey(panels[0])
        axes.tick_params(labelleft=False)
    for axes, (label, spent) in zip(panels[: len(SPENT)], SPENT.items(), strict=True):
        for colour, (name, title) in zip(COLOURS[1:], reference.items(), strict=False):
            level = np.mean([of_a_vehicle_m(one) for one in scores_of[name]])
            axes.axhline(level, color=colour, linestyle="--", linewidth=1, label=title)
        of_each = {place: [of_a_vehicle_m(one) for one in scores_of[name]] for name, place in spent.items()}
        for place, values in of_each.items():
            axes.plot([place] * len(values), values, "o", color=COLOURS[0], markersize=4, markerfacecolor="white")
        axes.plot(list(of_each), [np.mean(values) for values in of_each.values()], color=COLOURS[0], label="bodies")
        axes.set_xlabel(label)
        plain(axes)
    first = drawn.axes[0]
    first.set_ylabel("GOSPA a vehicle, m")
    first.set_ylim(bottom=0)  # last, because it ends the scaling of the shared axis
    first.legend(frameon=False, fontsize=8)
    whole = carried_mbps(0.01)
    carried = first.secondary_xaxis(
        "top",
        functions=(lambda percent: np.asarray(percent, float) * whole, lambda mbps: np.asarray(mbps, float) / whole),
    )
    carried.set_xlabel("Mbit/s that they would carry")


def main() -> None:
    path = Path(sys.argv[1])
    first, last = number_range(sys.argv[2] if len(sys.argv) > 2 else "1:3", "seeds", int, "1:3")
    seconds = float(sys.argv[3]) if len(sys.argv) > 3 else 40.0
    rest = sys.argv[4:]
    pictures = [Path(name) for name in rest if name.endswith(".png")]
    answers = [Path(name) for name in rest if name.endswith(".json")]
    names = [name for name in rest if not name.endswith((".png", ".json"))] or list(CASES)
    if pictures and (lacking := sorted(set(CASES) - set(names))):
        raise InputError(
            f"{pictures[0]}: the figure shows all cases; add {', '.join(lacking)}, or leave out the others"
        )
    known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    for seed in range(first, last + 1):
        with detections_kept():
            for name in names:
                stage = f"{name}; seed {seed}; {seconds:g} s"
                if stage not in known:
                    case = CASES[name]
                    scores, cpu_s = scored(seed, seconds, case.scene, case.sites_of)
                    known[stage] = {"scores": scores.model_dump(mode="json"), "cpu_s": round(cpu_s)}
                    write_json(path, known)
    scores_of = {
        name: [
            SceneScores.model_validate(known[f"{name}; seed {seed}; {seconds:g} s"]["scores"])
            for seed in range(first, last + 1)
        ]
        for name in names
    }
    print(markdown(HEAD, rows(scores_of)))
    right = answered(json.loads(answers[0].read_text(encoding="utf-8"))) if answers else None
    for picture in pictures:
        with figure(picture, 12 if right else 9, 3.4, style={}, dpi=130) as drawn:
            draw(scores_of, drawn, right)


if __name__ == "__main__":
    main()
