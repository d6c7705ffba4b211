"""Places in lanes: each position is at the segment that is nearest to it, whichever others are compared with it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.trajectory_files import lane_places
from isac_cosim.isacsim.traffic.trajectory_files.lane_places import LanePlaces


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**31), st.integers(2, 60), st.sampled_from([1.0, 30.0, 3000.0]), st.sampled_from([1, 7, 256]))
def test_the_nearest_segment_is_found(seed: int, corners: int, apart_m: float, at_once: int) -> None:
    rng = np.random.default_rng(seed)
    shape = np.cumsum(rng.normal(0.0, 20.0, (corners, 2)), axis=0)
    length = float(np.hypot(*np.diff(shape, axis=0).T).sum())
    lane = Lane("e_0", "e", 0, 3.2, length, shape, ())
    start = shape[rng.integers(0, corners)]
    position = start + np.cumsum(rng.normal(0.0, apart_m / 30.0, (300, 2)), axis=0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lane_places, "AT_ONCE_NEAR", at_once)
        found = LanePlaces([lane]).places(0, position @ np.array([1.0, 1.0j]))
    ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(shape, axis=0).T))])
    place = np.column_stack([np.interp(found.along, ends, shape[:, k]) for k in range(2)])
    np.testing.assert_allclose(np.hypot(*(position - place).T), nearest_m(shape, position), rtol=1e-6, atol=1e-6)


def nearest_m(shape: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distances of points from a line, m."""
    side = np.diff(shape, axis=0)
    from_start = points[:, None] - shape[:-1]
    share = np.clip((from_start * side).sum(axis=2) / (side**2).sum(axis=1), 0.0, 1.0)
    return np.linalg.norm(from_start - share[..., None] * side, axis=2).min(axis=1)
