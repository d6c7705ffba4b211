"""Observations: what is seen of a pair, worked out by hand, and always within the bounds that the space states."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.closed_loop.environment.observation import FEATURES, Observation, bounds, features_of
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.labeling.samples.uv_choice import PairSettings

SURE = np.eye(len(KNOWN))[2]
PAIRS = PairSettings()


def seen(reported: tuple[float, ...], tv: tuple[float, ...]) -> dict[str, float]:
    return dict(zip(FEATURES, features_of(np.array(reported), np.array(tv), SURE), strict=True))


def test_the_features_of_a_pair_are_along_the_way_of_the_vehicle() -> None:
    """Both drive north-east; the TV brakes, and is 30 m ahead and slower by 2 m/s."""
    half = math.sqrt(0.5)
    reported = (10.0, 20.0, 20.0 * half, 20.0 * half, 0.0, 0.0)
    tv = (10.0 + 30.0 * half, 20.0 + 30.0 * half, 18.0 * half, 18.0 * half, -3.0 * half, -3.0 * half)
    features = seen(reported, tv)
    expected = {
        "present": 1.0,
        "speed": 20.0,
        "distance": 30.0,
        "closing": 2.0,
        "tv_speed": 18.0,
        "tv_acceleration": -3.0,
    }
    assert {name: features[name] for name in expected} == pytest.approx(expected)
    assert [features[known.text] for known in KNOWN] == SURE.tolist()


def test_a_vehicle_that_stands_sees_its_leader_drive_away() -> None:
    features = seen((0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 10.0, 0.0, 5.0, 0.0, 1.0))
    assert features["closing"] == pytest.approx(-5.0)
    assert features["tv_acceleration"] == pytest.approx(1.0)


@given(arrays(np.float64, 6, elements=st.floats(-1e4, 1e4)), arrays(np.float64, 6, elements=st.floats(-1e4, 1e4)))
def test_features_are_finite_and_do_not_depend_on_the_axes(reported: Array, tv: Array) -> None:
    """A turn of the plane changes nothing that a vehicle sees."""
    here = features_of(reported, tv, SURE)
    assert np.isfinite(here).all()
    turned = features_of(*(np.array([-s[1], s[0], -s[3], s[2], -s[5], s[4]]) for s in (reported, tv)), SURE)
    np.testing.assert_allclose(turned, here, atol=1e-6)


def test_without_a_vehicle_all_slots_are_free_and_within_the_bounds() -> None:
    least, most = bounds(3, PAIRS)
    observation = Observation.of(None, 3, PAIRS)
    assert observation.vehicles == ()
    assert observation.features.shape == least.shape == most.shape == (3, len(FEATURES))
    assert observation.features.dtype == np.float32
    assert not observation.features.any()
    assert (least <= 0.0).all()
    assert (most >= 1.0).all()
