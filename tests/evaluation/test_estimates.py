"""Scores and intervals, against scikit-learn and against a computation written out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t as student_t
from sklearn.metrics import f1_score

from isac_cosim.evaluation.on_windows.maneuvers import maneuver_statistic
from isac_cosim.evaluation.on_windows.metrics import accuracy, class_f1, lead_of_others, mean_f1
from isac_cosim.evaluation.statistics import Counts, difference, estimate, pooled, relative_gain, score, span

RNG = np.random.default_rng(7)


def random_windows(n: int, right: float) -> tuple[np.ndarray, np.ndarray]:
    label = np.concatenate([np.arange(3), RNG.integers(3, size=n)])
    return label, np.where(RNG.random(len(label)) < right, label, RNG.integers(3, size=len(label)))


def counts_of(label: np.ndarray, predicted: np.ndarray) -> Counts:
    counts = np.zeros((3, 3), int)
    np.add.at(counts, (label, predicted), 1)
    return counts.tolist()


def condition(trainings: int, right: float, groups: str = "abcde") -> tuple[list[dict[str, Counts]], list]:
    windows = [{group: random_windows(20, right) for group in groups} for _ in range(trainings)]
    return [{group: counts_of(*pair) for group, pair in training.items()} for training in windows], windows


def sklearn_f1(training: dict, groups: list[str]) -> float:
    label, predicted = (np.concatenate([training[group][k] for group in groups]) for k in (0, 1))
    return f1_score(label, predicted, average="macro", labels=[0, 1, 2], zero_division=0)


def test_a_difference_of_two_conditions_with_its_interval() -> None:
    first, first_windows = condition(3, 0.9)
    second, second_windows = condition(3, 0.5, "bcdef")
    shared = ["b", "c", "d", "e"]

    def differences(groups: list[str]) -> np.ndarray:
        pairs = zip(first_windows, second_windows, strict=True)
        return np.array([sklearn_f1(a, groups) - sklearn_f1(b, groups) for a, b in pairs])

    values = differences(shared)
    left_out = np.array([differences([g for g in shared if g != without]).mean() for without in shared])
    of_seeds = 3 / 4 * ((left_out - left_out.mean()) ** 2).sum()
    of_trainings = np.var(values, ddof=1) / 3
    freedom = (of_seeds + of_trainings) ** 2 / (of_seeds**2 / 3 + of_trainings**2 / 2)
    half_width = student_t.ppf(0.975, freedom) * np.sqrt(of_seeds + of_trainings)

    measured = estimate(difference(mean_f1), first, second)
    assert measured.value == pytest.approx(values.mean())
    assert measured.sd == pytest.approx(values.std(ddof=1))
    assert (measured.low, measured.high) == pytest.approx((values.mean() - half_width, values.mean() + half_width))


def test_one_training_has_the_interval_of_the_test_seeds_alone() -> None:
    counts, windows = condition(1, 0.7)
    left_out = np.array([sklearn_f1(windows[0], [g for g in "abcde" if g != without]) for without in "abcde"])
    half_width = student_t.ppf(0.975, 4) * np.sqrt(4 / 5 * ((left_out - left_out.mean()) ** 2).sum())
    measured = estimate(mean_f1, counts)
    assert measured.sd is None
    assert measured.high - measured.value == pytest.approx(half_width)


def test_a_single_test_seed_gives_no_interval() -> None:
    measured = estimate(accuracy, [{"a": [[3, 1], [0, 4]]}])
    assert (measured.value, measured.low, measured.high) == (7 / 8, None, None)


def test_conditions_without_a_common_seed_cannot_be_compared() -> None:
    measured = estimate(difference(accuracy), [{"a": [[3, 1], [0, 4]]}], [{"b": [[3, 1], [0, 4]]}])
    assert measured.value is None


def test_the_interval_of_a_score_stays_between_0_and_1() -> None:
    counts = [{"a": [[9, 0], [0, 9]], "b": [[9, 0], [5, 0]], "c": [[9, 0], [0, 9]]}]
    unclipped = estimate(accuracy, counts)
    assert unclipped.high > 1
    clipped = score(accuracy, counts)
    assert (clipped.low, clipped.high) == (max(unclipped.low, 0.0), 1.0)


def test_statistics_of_one_matrix() -> None:
    counts = np.array([[8, 2, 0], [1, 6, 3], [0, 0, 10]], dtype=float)
    f1 = [2 * 8 / (10 + 9), 2 * 6 / (10 + 8), 2 * 10 / (10 + 13)]
    assert mean_f1(counts) == pytest.approx(np.mean(f1))
    assert class_f1(1)(counts) == pytest.approx(f1[1])
    assert lead_of_others(1)(counts) == pytest.approx(min(f1[0], f1[2]) - f1[1])
    precision, recall = np.mean([8 / 9, 6 / 8, 10 / 13]), np.mean([0.8, 0.6, 1.0])
    assert maneuver_statistic()(counts) == pytest.approx(2 * precision * recall / (precision + recall))


def test_statistics_of_several_matrices() -> None:
    low, high = np.array([[2, 2], [2, 2]], dtype=float), np.array([[4, 0], [1, 3]], dtype=float)
    assert relative_gain(accuracy)(high, low) == pytest.approx((7 / 8 - 1 / 2) / (1 / 2))
    assert span(accuracy)(low, high, low) == pytest.approx(3 / 8)


def test_pooled_counts_are_of_all_seeds_and_trainings() -> None:
    trainings = [{"a": [[1, 2], [3, 4]], "b": [[1, 0], [0, 1]]}, {"a": [[0, 0], [0, 5]]}]
    assert pooled(trainings).tolist() == [[2, 2], [3, 10]]
