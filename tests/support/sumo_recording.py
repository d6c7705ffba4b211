"""A recording of the bundled motorway, made once a process."""

from functools import lru_cache

from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.generation.settings import DatasetStudy

SCENARIO = "motorway"


@lru_cache(maxsize=1)
def motorway_recording() -> Recording:
    """45 s of the bundled motorway, with reactions and commanded maneuvers."""
    study = DatasetStudy.model_validate({"traffic": {"run_in_s": 30.0, "duration_s": 45.0}})
    return motion_source(study).record(load(SCENARIO), 1)
