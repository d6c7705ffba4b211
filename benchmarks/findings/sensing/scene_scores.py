"""How well the network knows who is where when it senses all vehicles at once.

Seeds of the bundled motorway are recorded and sensed as scenes. The tables are those of docs/scene.md. With
`road=city`, it is the traffic of that scenario; with `sites=motorway_sparse`, the sites of that one sense the same
traffic; with `after=60`, the first 60 s are not scored, in which the network finds who stood there already.

Run: python -m isac_cosim.benchmarks.findings.sensing.scene_scores [FIRST:LAST] [SECONDS] [road=NAME] [sites=NAME]
    [after=SECONDS] [SETTING=VALUE]
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping

from isac_cosim.base.parsing import number_range
from isac_cosim.isacsim.scene.episode import follow
from isac_cosim.isacsim.scene.scores import SETTLED_S, SceneScores, pooled
from isac_cosim.isacsim.sensing.chain import SensingSettings
from isac_cosim.isacsim.sensing.sensors.scene import setup_of
from isac_cosim.isacsim.traffic.sources.protocol import recorded
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.generation.settings import DatasetStudy

ROAD = "motorway"
"""The scenario whose traffic is sensed, unless another is named."""


def scored(
    seed: int,
    seconds: float,
    scene: Mapping[str, str],
    sites_of: str = ROAD,
    road: str = ROAD,
    after_s: float = SETTLED_S,
) -> tuple[SceneScores, float]:
    """Return the scores of one seed, and the processor time that sensing took, s.

    sites_of: the scenario whose sites sense the traffic of `road`. after_s: nothing is scored before.
    """
    study = DatasetStudy.model_validate({"scenarios": (road,), "traffic": {"duration_s": seconds}})
    source = motion_source(study)
    recording = recorded(source, source.load(road), seed)
    sensing, began = SensingSettings.model_validate({"scene": scene}), time.process_time()
    tracks = follow(recording, source.load(sites_of).sites, setup_of(sensing, study.motion), after_s)
    return tracks.scores, time.process_time() - began


def main() -> None:
    first, last = number_range(sys.argv[1] if len(sys.argv) > 1 else "1:3", "seeds", int, "1:3")
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 120.0
    scene = dict(argument.split("=", 1) for argument in sys.argv[3:])
    road = scene.pop("road", ROAD)
    sites_of, after_s = scene.pop("sites", road), float(scene.pop("after", SETTLED_S))
    scores = []
    for seed in range(first, last + 1):
        of_seed, cpu_s = scored(seed, seconds, scene, sites_of, road, after_s)
        scores.append(of_seed)
        print(f"seed {seed}, {cpu_s:.0f} s of processor time: {of_seed.model_dump_json()}", flush=True)
    print(f"seeds {first}:{last}, {seconds:g} s each, {scene}: {pooled(scores).model_dump_json(indent=1)}")


if __name__ == "__main__":
    main()
