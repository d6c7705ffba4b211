"""The bench of the filter's density measures the noise that the dataset was made with."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from isac_cosim.base.settings import checked
from isac_cosim.benchmarks.findings.sensing.process_noise import sensed
from isac_cosim.isacsim.tracking.kalman import track
from isac_cosim.labeling.dataset.record_point import relative
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.resense import own_sensing
from isac_cosim.labeling.generation.settings import DatasetStudy
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
    states = tracks.state[:, given.count :].transpose(0, 2, 1)
    rows = {row.intention: row for row in dataset.frame().itertuples()}
    assert sorted(given.intention) == sorted(rows)
    for name, state in zip(given.intention, states, strict=True):
        row = rows[name]
        np.testing.assert_array_equal(relative(state, (row.x0, row.y0)), dataset.record("tv", row.Index))
