"""What knowing who is where costs the network: the scores of scenes against what is spent on them.

The same seeds of the bundled motorway are sensed as points and as bodies, with true association and with the network's
own tracks, and with fewer instants, less power and masts every 500 m. Each case and seed is a stage, whose
scores are kept in a file of JSON: the same command goes on where it was interrupted. Differences are paired by seed.

Run: python -m isac_cosim.benchmarks.findings.sensing.scene_price FILE [FIRST:LAST] [SECONDS] [CASE ...]
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from isac_cosim.base.files import write_json
from isac_cosim.base.parsing import number_range
from isac_cosim.benchmarks.findings.sensing.scene_scores import ROAD, scored
from isac_cosim.evaluation.report.parts import markdown
from isac_cosim.isacsim.scene.episode import detections_kept
from isac_cosim.isacsim.scene.scores import SceneScores
from isac_cosim.isacsim.scene.settings import NUMEROLOGIES, SceneSettings

BASE = "bodies"
"""The case that the others are compared with."""
SYMBOLS_PER_S = 28_000
"""Symbols of a second at 30 kHz."""


@dataclass(frozen=True)
class Case:
    """One way to sense. scene: settings. sites_of: the scenario whose sites sense."""

    scene: dict[str, str] = field(default_factory=dict)
    sites_of: str = ROAD

    @property
    def share(self) -> float:
        """Share of all symbols that sensing takes."""
        settings = SceneSettings.model_validate(self.scene)
        return settings.fixes_hz * NUMEROLOGIES[settings.numerology].waveform.symbols / SYMBOLS_PER_S


POINTS, BODIES = {"bodies": "points"}, {"bodies": "bodies"}
CASES = {
    "points, truth": Case({**POINTS, "association": "truth"}),
    "points": Case(POINTS),
    "bodies, truth": Case({**BODIES, "association": "truth"}),
    "bodies": Case(BODIES),
    **{f"bodies, {hz} Hz": Case({**BODIES, "fixes_hz": hz}) for hz in ("12.5", "5")},
    **{f"bodies, {dbm} dBm": Case({**BODIES, "power_dbm": dbm}) for dbm in ("36", "26")},
    "bodies, masts every 500 m": Case(BODIES, "motorway_sparse"),
}


HEAD = (
    "case", "share of symbols", "rms, m", "missed", "false", "switches a km", "IDF1", "GOSPA, m",
    "less than bodies by, m",
)  # fmt: skip


def main() -> None:
    path = Path(sys.argv[1])
    first, last = number_range(sys.argv[2] if len(sys.argv) > 2 else "1:3", "seeds", int, "1:3")
    seconds = float(sys.argv[3]) if len(sys.argv) > 3 else 60.0
    names = sys.argv[4:] or list(CASES)
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
    rows = []
    for name, of_case in scores_of.items():
        columns = ("rms_m", "missed", "false", "switches_per_km", "idf1", "gospa_m")
        means = [np.mean([getattr(one, column) for one in of_case]) for column in columns]
        apart = ""
        if BASE in scores_of and name != BASE:
            pairs = zip(scores_of[BASE], of_case, strict=True)
            less = [(base.gospa_m or 0.0) - (other.gospa_m or 0.0) for base, other in pairs]
            apart = f"{np.mean(less):.2f} ({min(less):.2f} to {max(less):.2f})"
        rows.append([name, f"{CASES[name].share:.3f}", *(f"{mean:.3g}" for mean in means), apart])
    print(markdown(HEAD, rows))


if __name__ == "__main__":
    main()
