"""How well the network knows who is where when it senses all vehicles of the motorway at once.

Seeds of the bundled motorway are recorded and sensed as scenes. The table is that of docs/scene.md.

Run: python -m isac_cosim.benchmarks.findings.sensing.scene_scores [FIRST:LAST] [SECONDS] [SETTING=VALUE ...]
"""

from __future__ import annotations

import sys
import time

from isac_cosim.base.parsing import number_range
from isac_cosim.isacsim.scene.episode import follow
from isac_cosim.isacsim.scene.scores import SceneScores, pooled
from isac_cosim.isacsim.sensing.chain import SensingSettings
from isac_cosim.isacsim.sensing.sensors.scene import setup_of
from isac_cosim.isacsim.traffic.sources.protocol import recorded
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.generation.settings import DatasetStudy


def scored(seed: int, seconds: float, scene: dict[str, str], every_mast: int = 1) -> tuple[SceneScores, float]:
    """Return the scores of one seed, and the processor time that sensing took, s.

    every_mast: one in so many of the masts is there, from west to east.
    """
    study = DatasetStudy.model_validate({"scenarios": ("motorway",), "traffic": {"duration_s": seconds}})
    source = motion_source(study)
    scenario = source.load("motorway")
    recording = recorded(source, scenario, seed)
    sensing, began = SensingSettings.model_validate({"scene": scene}), time.process_time()
    masts = sorted({(site.x, site.y) for site in scenario.sites})[::every_mast]
    sites = [site for site in scenario.sites if (site.x, site.y) in masts]
    tracks = follow(recording, sites, setup_of(sensing, study.motion))
    return tracks.scores, time.process_time() - began


def main() -> None:
    first, last = number_range(sys.argv[1] if len(sys.argv) > 1 else "1:3", "seeds", int, "1:3")
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 120.0
    scene = dict(argument.split("=", 1) for argument in sys.argv[3:])
    scores = []
    for seed in range(first, last + 1):
        of_seed, cpu_s = scored(seed, seconds, scene)
        scores.append(of_seed)
        print(f"seed {seed}, {cpu_s:.0f} s of processor time: {of_seed.model_dump_json()}", flush=True)
    print(f"seeds {first}:{last}, {seconds:g} s each, {scene}: {pooled(scores).model_dump_json(indent=1)}")


if __name__ == "__main__":
    main()
