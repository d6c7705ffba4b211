"""Which detection is of which track, against all assignments that there are."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.scene.association import EACH, FURTHER, GATE, UNSURE, Pairs, associate, associate_truly
from isac_cosim.isacsim.scene.detection import Detections

RANGES = st.lists(st.floats(90.0, 130.0), min_size=1, max_size=4)
UNAMBIGUOUS_MPS = 1000.0


def paired(found_m: list[float], tracks_m: list[float], points: int, counts: list[bool] | None = None) -> Pairs:
    """Pairs of one panel; detections and tracks differ in range alone, and the variance is 1 m2."""
    measured = np.array([[0.0, of, 0.0] for of in found_m])
    detections = Detections(measured, np.full_like(measured, 0.1), np.full(len(measured), 100.0))
    predicted = np.zeros((len(tracks_m), 1, points, 3))
    predicted[..., 1] = np.array(tracks_m)[:, None, None]
    shape = len(tracks_m), 1
    certain = np.array(counts if counts is not None else [True] * len(tracks_m))
    return associate([detections], predicted, np.ones((*shape, 3)), np.ones(shape, bool), certain, UNAMBIGUOUS_MPS)


def least(squared: Array, each: int) -> tuple[int, float]:
    """The most detections that tracks can have, up to `each`, and what they cost at least, by trying all."""
    best = 0, 0.0
    count = squared.shape[1]
    for chosen in product([*range(count), None], repeat=len(squared)):
        pairs = [(row, column) for row, column in enumerate(chosen) if column is not None]
        of_each = [sum(column == track for _, column in pairs) for track in range(count)]
        if max(of_each) > each or any(squared[pair] >= GATE for pair in pairs):
            continue
        cost = sum(squared[pair] for pair in pairs) + sum(FURTHER * k * (k - 1) / 2 for k in of_each)
        best = min(best, (-len(pairs), cost))
    return -best[0], best[1]


@given(RANGES, RANGES, st.sampled_from([1, 5]))
@example([90.0, 92.0, 100.0], [96.25, 103.75], 5)  # the first is nobody's, and must not push the others together
def test_it_is_the_cheapest_of_all_assignments(found_m: list[float], tracks_m: list[float], points: int) -> None:
    pairs = paired(found_m, tracks_m, points)
    squared = (np.array(found_m)[:, None] - np.array(tracks_m)) ** 2
    each = EACH if points > 1 else 1
    count, cost = least(squared, each)
    of_each = np.bincount(pairs.track, minlength=len(tracks_m))
    if points > 1 and of_each.max(initial=0) > each:  # what is left goes to the nearest
        assert len(pairs.track) > count
        return
    assert len(pairs.track) == count
    total = squared[pairs.detection, pairs.track].sum() + (FURTHER * of_each * (of_each - 1) / 2).sum()
    assert total == pytest.approx(cost, abs=1e-6)
    assert len(pairs.free) == len(found_m) - count


def test_a_cars_second_detection_does_not_go_to_the_hidden_one_behind_it() -> None:
    """Front and back of the car in front are found; of the one behind, at 107 m, nothing is."""
    assert paired([100.0, 104.0], [102.0, 107.0], points=5).track.tolist() == [0, 0]
    assert sorted(paired([100.0, 104.0], [102.0, 107.0], points=1).track.tolist()) == [0, 1]


def test_the_truth_gives_both_detections_of_a_car_to_it_though_a_hidden_one_is_near() -> None:
    """Front and back of one car are found, and nothing of another one whose front is within the gate of that back."""
    lengths = np.array([0.0, 4.0, 2.0, 2.0, 2.0])
    true = np.zeros((2, 1, 5, 3))
    true[..., 0, :, 1] = np.array([[100.0], [105.2]]) + lengths
    found = Detections(np.array([[0.0, 100.1, 0.0], [0.0, 103.9, 0.0]]), np.full((2, 3), 0.1), np.full(2, 100.0))
    pairs = associate_truly([found], true, np.ones((2, 1), bool), np.ones(3), UNAMBIGUOUS_MPS)
    assert (pairs.track.tolist(), pairs.detection.tolist()) == ([0, 0], [0, 1])


@pytest.mark.parametrize("points", [1, 5])
def test_a_body_that_does_not_count_yet_comes_second(points: int) -> None:
    near_both = 100.0 + 0.9 * np.sqrt(UNSURE)
    pairs = paired([near_both], [100.0, near_both], points, counts=[True, False])
    assert pairs.track.tolist() == [0 if points > 1 else 1]
    far_from_one = 100.0 + 1.1 * np.sqrt(UNSURE)
    assert paired([far_from_one], [100.0, far_from_one], points, counts=[True, False]).track.tolist() == [1]
