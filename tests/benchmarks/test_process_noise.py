"""The bench of the filter's density measures the noise that the dataset was made with."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.process_noise import sensed
from isacsim.settings import checked
from isacsim.tracking.kalman import track
from labeling.generation.generate import generate
from labeling.generation.resense import own_sensing
from labeling.generation.settings import DatasetStudy
from tests.support.scripted import InlineEngine

STUDY = {
    "scenarios": ["straight_road"],
    "source": "kinematic",
    "seeds": {"first": 1, "last": 1},
    "kinematics": {"per_class": 1, "following_scenes": 0},
    "record": {"tv_rate_hz": 40.0, "uv_rate_hz": 20.0},
}


def test_its_fixes_give_the_stored_states(tmp_path: Path) -> None:
    dataset = generate(checked(DatasetStudy, STUDY, "test"), tmp_path / "data", InlineEngine())
    given = sensed(dataset, 1, 1)
    tracks = track(
        given.state, given.covariance, given.valid, 1 / dataset.meta.tv_rate_hz, own_sensing(dataset).tracking
    )
    states = tracks.state[:, given.count :].transpose(0, 2, 1).astype(np.float32)
    stored = {name: dataset.record("tv", k) for k, name in enumerate(dataset.frame()["intention"])}
    assert sorted(given.intention) == sorted(stored)
    for name, state in zip(given.intention, states, strict=True):
        np.testing.assert_array_equal(state, stored[name])
