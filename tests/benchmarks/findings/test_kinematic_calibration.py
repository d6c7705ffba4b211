"""The calibration of the kinematic source: its fast states are the true ones, and it scores what it says."""

from __future__ import annotations

import numpy as np

from isac_cosim.base.settings import checked
from isac_cosim.benchmarks.findings.kinematic_calibration import FIRST_SEED, run, true_records, true_states
from isac_cosim.isacsim.traffic import motion
from isac_cosim.isacsim.traffic.sources.kinematic import SCENARIO, KinematicSource
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.models.runs.settings import TrainSettings

CONTENT = {
    "source": "kinematic",
    "kinematics": {"per_class": 2, "following_scenes": 1},
    "record": {"tv_rate_hz": 40.0, "uv_rate_hz": 20.0},
}
STUDY = checked(DatasetStudy, CONTENT, "test")


def test_the_fast_states_are_those_of_the_dataset() -> None:
    source = KinematicSource(STUDY.kinematics)
    recording = source.record(source.load(SCENARIO), 5)
    for maneuver in recording.maneuvers:
        for vehicle in (maneuver.tv, maneuver.uv):
            start = round(maneuver.onset - 2.597, 3)
            times = start + np.arange(round(5.0 * 40.0)) / 40.0
            states = motion.states(recording, recording.tracks[vehicle], times, STUDY.motion)
            fast = true_states(recording, vehicle, start, STUDY, 40.0)
            np.testing.assert_allclose(fast, states, atol=2e-3)


def test_it_trains_on_true_records_and_scores_other_seeds() -> None:
    records = true_records(STUDY, [FIRST_SEED])
    assert len(records) == 13
    training = checked(
        TrainSettings,
        {"model": "trees", "trees": {"rounds": 3}, "pre_onset": {"rounds": 3}, "optimiser": {"threads": 1}},
        "test",
    )
    result = run(STUDY, training, 5, test_episodes=2)
    assert result["share"] == STUDY.kinematics.response.share
    assert (result["training_records"], result["windows"]) == (36, 12 + 24)
    assert 1 / 6 < result["accuracy"]["low"] < result["accuracy"]["value"] <= 1.0
    assert set(result["f1"]) == {"hard_brake", "left_lane_change", "right_lane_change", "overtake", "hard_accel",
                                 "evasive_swerve"}  # fmt: skip
