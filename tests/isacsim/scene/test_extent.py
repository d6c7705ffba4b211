"""What is not known of a body's detection: which part of it answers, and whether it is that vehicle's alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.stats import multivariate_t

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.scene.bodies import BEHIND, look
from isac_cosim.isacsim.scene.extent import (
    ASTRAY,
    HEAVY_TAILS,
    OFF_ACROSS_M,
    OFF_ALONG_M,
    between_points,
    expected,
    off_its_point,
    robust_weight,
    rows_at,
)
from tests.support.scene_road import SITES

PANELS = Panels.of([replace(SITES[0], x=100.0, y=30.0, height_m=0.0, azimuth_deg=180.0)], 0.8)
"""One that looks at the road from 30 m beside it, and does not stand above it."""


def covariance(x: float, speed: float) -> tuple[Array, Array, Array]:
    """Of a detection of a vehicle's front: because its point is off, the state, and the line of sight."""
    state, ahead = np.array([[x, 0.0, speed, 0.0, 0.0, 0.0, 4.6]]), np.array([[1.0, 0.0]])
    of, first = expected(state, ahead, PANELS, True), np.zeros(1, dtype=np.int64)
    rows = rows_at(of.measured[0, 0, :1], BEHIND[:1], first, first, state, of, PANELS)
    sight = np.array([x - 100.0, -30.0])
    return off_its_point(rows)[0], state, sight / np.hypot(*sight)


@pytest.mark.parametrize("x", [60.0, 98.0, 130.0, 300.0])
@pytest.mark.parametrize("speed", [0.0, 35.0])
def test_where_a_point_is_off_all_that_is_measured_of_it_errs_together(x: float, speed: float) -> None:
    found, state, sight = covariance(x, speed)
    rng = np.random.default_rng(1)
    off = np.outer(rng.normal(0.0, OFF_ALONG_M, 20_000), sight)
    off += np.outer(rng.normal(0.0, OFF_ACROSS_M, 20_000), [-sight[1], sight[0]])
    moved = np.tile(state[0, :4], (len(off), 1))
    moved[:, :2] += off
    measured = look(moved, np.tile([1.0, 0.0], (len(off), 1)), None, PANELS).measured[:, 0, 0]
    sampled = np.cov(measured.T)
    scale = np.sqrt(np.diag(found) + 1e-9)
    assert sampled / np.outer(scale, scale) == pytest.approx(found / np.outer(scale, scale), abs=0.05)


def test_abreast_the_radial_velocity_tells_least_and_far_off_it_is_sharp() -> None:
    abreast, far = covariance(100.0, 35.0)[0], covariance(350.0, 35.0)[0]
    assert np.sqrt(abreast[2, 2]) == pytest.approx(35.0 / 30.0 * OFF_ACROSS_M, rel=0.05)
    assert np.sqrt(far[2, 2]) < 0.005
    assert covariance(100.0, 0.0)[0][2, 2] == 0.0


@given(st.integers(0, 1000))
def test_detections_are_weighed_as_those_of_students_t(seed: int) -> None:
    """The weighted mean with these weights is the likeliest place of the distribution, found by search."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3))
    spread = root @ root.T + np.eye(3)
    seen = rng.multivariate_normal(np.zeros(3), spread, 12) * np.where(rng.random(12) < 0.3, 6.0, 1.0)[:, None]

    def likeliness(mean: Array) -> float:
        return -float(multivariate_t(mean, spread, HEAVY_TAILS).logpdf(seen).sum())

    best = minimize(likeliness, np.median(seen, axis=0), tol=1e-10).x
    capped = robust_weight(seen - best, np.tile(spread, (12, 1, 1)))
    distance = ((seen - best) * np.linalg.solve(spread, (seen - best).T).T).sum(axis=1)
    weights = (HEAVY_TAILS + 3) / (HEAVY_TAILS + distance)
    assert capped == pytest.approx(np.minimum(weights, 1.0))
    assert (weights[:, None] * (seen - best)).sum(axis=0) == pytest.approx(0.0, abs=1e-3)


def test_whose_a_detection_is_may_be_open_in_velocity_where_its_point_is() -> None:
    middle = np.array([[[0.0, 30.0, 0.0], [0.0, 300.0, -35.0]]])
    abreast, ahead = np.sqrt(between_points(middle, np.array([35.0])))[0]
    across_m, along_m, radial_mps = ASTRAY
    assert abreast == pytest.approx([across_m / 30.0, along_m, np.hypot(radial_mps, 35.0 * across_m / 30.0)])
    assert ahead == pytest.approx([across_m / 300.0, along_m, radial_mps])
