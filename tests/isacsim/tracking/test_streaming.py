"""The filter on filterpy, one fix at a time, against the batched one."""

import numpy as np
import pytest

from isac_cosim.isacsim.tracking.kalman import TrackingSettings, track
from tests.support.streaming_filter import StreamingFilter

STEP_S = 1 / 400


def fixes_of(snapshots: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fixes of a braking vehicle, each with a covariance of its own, one in twenty missing."""
    rng = np.random.default_rng(seed)
    time = np.arange(snapshots) * STEP_S
    truth = np.stack([30 * time - 2 * time**2, 0.5 * time, 30 - 4 * time, np.full(snapshots, 0.5)], axis=-1)
    factor = rng.normal(size=(snapshots, 4, 4)) * 0.1
    covariance = factor @ factor.transpose(0, 2, 1) + 1e-4 * np.eye(4)
    noise = np.einsum("sab,sb->sa", np.linalg.cholesky(covariance), rng.normal(size=(snapshots, 4)))
    valid = rng.random(snapshots) > 0.05
    valid[0] = True
    return truth + noise, covariance, valid


@pytest.mark.parametrize("seed", [1, 2])
def test_equals_the_batched_filter_outliers_and_a_new_start_included(seed: int) -> None:
    settings = TrackingSettings()
    fixes, covariance, valid = fixes_of(1200, seed)
    fixes[100:500:30, :2] += 300.0
    fixes[700:, :2] += 300.0
    batched = track(fixes[None], covariance[None], valid[None], STEP_S, settings)
    one = StreamingFilter(STEP_S, settings)
    for k in range(len(fixes)):
        state = one.step(fixes[k], covariance[k]) if valid[k] else one.step(None)
        assert state is not None
        assert np.abs(state - batched.state[0, k]).max() < 1e-6
    assert one.covariance is not None
    assert np.abs(one.covariance - batched.covariance[0]).max() < 1e-6
    # It did start anew: the jump of 300 m was taken in the end, and not at once.
    assert abs(batched.state[0, 705, 0] - fixes[705, 0]) > 200
    assert abs(batched.state[0, -1, 0] - fixes[-1, 0]) < 5


def test_says_nothing_before_the_first_fix() -> None:
    one = StreamingFilter(STEP_S)
    assert one.step(None) is None
    assert one.covariance is None
    first = one.step(np.array([1.0, 2.0, 3.0, 4.0]), np.eye(4))
    assert first == pytest.approx([1, 2, 3, 4, 0, 0])
    coasted = one.step(None)
    assert coasted is not None
    assert coasted[:2] == pytest.approx([1 + 3 * STEP_S, 2 + 4 * STEP_S])


def test_what_was_handed_out_does_not_change_afterwards() -> None:
    fixes, covariance, _ = fixes_of(5, 3)
    one = StreamingFilter(STEP_S)
    states = [one.step(fix, spread) for fix, spread in zip(fixes, covariance, strict=True)]
    assert len(np.unique(np.array(states), axis=0)) == 5
