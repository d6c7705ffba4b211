import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.distributions import _peaks, too_few_seeds


@settings(max_examples=25, deadline=None)
@given(angle=st.floats(0, 2 * np.pi), peak=st.floats(-9, 9), across=st.floats(-6, 6), onset=st.integers(0, 90))
def test_peaks_are_along_and_across_the_driving_direction(angle: float, peak: float, across: float, onset: int) -> None:
    """A vehicle that drives one way, accelerating at one instant after onset, and harder before it."""
    along, left = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    truth = np.zeros((1, 6, 100), np.float32)
    truth[0, 2:4] = 30.0 * along[:, None]
    truth[0, 4:6, 95] = peak * along + across * left
    if onset > 0:
        truth[0, 4:6, onset - 1] = 50.0 * along + 50.0 * left
    found = _peaks(truth, np.array([onset]))
    np.testing.assert_allclose(np.concatenate(found), [peak, across], atol=1e-4)


def test_a_class_on_few_seeds_is_told_and_an_absent_one_is_not() -> None:
    found = {"hard_brake": {"seeds": 12}, "overtake": {"seeds": 3}, "following": {"seeds": 0}}
    assert too_few_seeds(found) == ["overtake"]
