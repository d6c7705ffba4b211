"""Metrics against scikit-learn and against plain loops."""

import numpy as np
import pytest
from sklearn.metrics import confusion_matrix, f1_score

from isac_cosim.evaluation.on_windows import metrics
from isac_cosim.evaluation.on_windows.score_results import Difference, Spread

CLASSES = ("a", "b", "c", "d")


def drawn(n: int = 300, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    label = rng.integers(0, 4, n)
    return label, np.where(rng.random(n) < 0.6, label, rng.integers(0, 4, n))


def test_summary_is_scikit_learn_s() -> None:
    label, predicted = drawn()
    result = metrics.summary(label, predicted, CLASSES)
    assert result.accuracy == pytest.approx(np.mean(label == predicted))
    assert result.macro_f1 == pytest.approx(f1_score(label, predicted, average="macro"))
    np.testing.assert_allclose(list(result.per_class_f1.values()), f1_score(label, predicted, average=None))
    np.testing.assert_array_equal(result.confusion, confusion_matrix(label, predicted))


def test_a_class_without_a_true_sample_is_left_out() -> None:
    result = metrics.summary(np.array([0, 0, 1]), np.array([0, 2, 1]), CLASSES)
    assert result.per_class_f1 == {"a": pytest.approx(2 / 3), "b": 1.0, "c": None, "d": None}
    assert result.macro_f1 == pytest.approx((2 / 3 + 1) / 2)
    assert result.macro_f1_over == ["a", "b"]


def test_bins_of_lead_time() -> None:
    lead = np.array([-0.21, -0.2, -0.01, 0.0, 0.19, 0.6])
    label = np.array([0, 1, 1, 0, 1, 1])
    rows = metrics.by_lead_time(lead, label, np.array([0, 1, 0, 0, 0, 1]), "ab")
    assert [(r.from_s, r.to_s, r.n, r.accuracy) for r in rows] == [
        (-0.4, -0.2, 1, 1.0), (-0.2, 0.0, 2, 0.5), (0.0, 0.2, 2, 0.5), (0.6, 0.8, 1, 1.0),
    ]  # fmt: skip


def test_a_class_that_is_rare_in_a_bin_stays_out_of_its_macro_f1() -> None:
    label = np.array([0] * 6 + [1] * 5 + [2] * 4)
    predicted = np.array([0] * 6 + [1] * 5 + [0] * 4)
    row = metrics.by_lead_time(np.full(15, 0.1), label, predicted, "abc")[0]
    assert row.macro_f1 == pytest.approx((12 / 16 + 1) / 2)
    assert row.macro_f1_over == ["a", "b"]
    assert metrics.by_lead_time(np.full(4, 0.1), label[-4:], predicted[-4:], "abc")[0].macro_f1 is None


def test_multiples_of_the_bin_open_their_own_bin() -> None:
    lead = np.arange(-5, 6) * 0.2
    rows = metrics.by_lead_time(lead, np.zeros(11, int), np.zeros(11, int), "ab")
    assert [r.n for r in rows] == [1] * 11


def test_records_without_snr_are_in_no_bin() -> None:
    rows = metrics.by_snr(np.array([np.nan, 1.0, 3.0]), np.array([0, 0, 1]), np.array([0, 0, 1]), "ab")
    assert [(r.from_db, r.n) for r in rows] == [(0.0, 1), (2.0, 1)]


def test_the_paired_difference_of_a_predictor_with_itself_is_nothing() -> None:
    label, predicted = drawn()
    result = metrics.paired_difference(label, predicted, predicted, np.arange(300) % 7, CLASSES)
    assert result.macro_f1 == Difference(difference=0.0, low=0.0, high=0.0)


def test_the_interval_is_the_jackknife_over_groups() -> None:
    label, first = drawn(400)
    second = np.random.default_rng(9).integers(0, 4, 400)
    groups = np.arange(400) % 8
    result = metrics.paired_difference(label, first, second, groups, CLASSES)

    def difference(rows: np.ndarray, **options: object) -> float:
        scores = [f1_score(label[rows], p[rows], **options) for p in (first, second)]
        return float(scores[0] - scores[1])

    by_class = {"average": "macro", "labels": [2]}
    for interval, options in ((result.macro_f1, {"average": "macro"}), (result.per_class_f1["c"], by_class)):
        without = np.array([difference(groups != g, **options) for g in range(8)])
        error = np.sqrt(7 / 8 * ((without - without.mean()) ** 2).sum())
        expected = difference(groups < 8, **options)
        assert interval.difference == pytest.approx(expected)
        assert interval.low == pytest.approx(expected - 2.364624 * error, abs=1e-6)
        assert interval.high == pytest.approx(expected + 2.364624 * error, abs=1e-6)


def test_groups_without_a_class_do_not_narrow_its_interval() -> None:
    label, first = drawn(400)
    second = np.random.default_rng(9).integers(0, 4, 400)
    groups = np.arange(400) % 4
    alone = metrics.paired_difference(label, first, second, groups, CLASSES)
    # Ten more groups that hold the last class alone, and in which all of it is recognised by both.
    more = np.full(10, 3)
    padded = [np.concatenate([x, more]) for x in (label, first, second)]
    result = metrics.paired_difference(*padded, np.concatenate([groups, 10 + np.arange(10)]), CLASSES)
    assert result.groups == 14
    assert result.per_class_f1["a"] == alone.per_class_f1["a"]


def test_too_few_groups_for_an_interval_or_a_verdict() -> None:
    label, first = drawn(200)
    second = np.random.default_rng(9).integers(0, 4, 200)
    results = [metrics.paired_difference(label, first, second, np.arange(200) % g, CLASSES) for g in (1, 2, 3)]
    assert [result.groups for result in results] == [1, 2, 3]
    assert [result.macro_f1.low is None for result in results] == [True, False, False]
    assert [result.has_interval for result in results] == [False, True, True]
    assert [result.allows_verdict for result in results] == [False, False, True]


def test_the_difference_leaves_rare_classes_out_of_its_mean() -> None:
    label = np.array([0] * 20 + [1] * 20 + [2] * 2)
    first, second = label.copy(), np.where(label == 2, 0, label)
    groups = np.arange(42) % 3
    assert metrics.paired_difference(label, first, second, groups, CLASSES).macro_f1.difference > 0.3
    gap = metrics.paired_difference(label, first, second, groups, CLASSES, least=5).macro_f1.difference
    assert gap == pytest.approx((1 - 40 / 42) / 2)


def test_several_trainings_are_compared_by_their_mean_scores() -> None:
    label, first = drawn(400)
    rng = np.random.default_rng(2)
    second = rng.integers(0, 4, (3, 400))
    groups = np.arange(400) % 8
    result = metrics.paired_difference(label, first, second, groups, CLASSES)
    singles = [metrics.paired_difference(label, first, predicted, groups, CLASSES) for predicted in second]
    mean = np.mean([single.macro_f1.difference for single in singles])
    assert result.macro_f1.difference == pytest.approx(mean)
    name = CLASSES[1]
    expected = np.mean([single.per_class_f1[name].difference for single in singles])
    assert result.per_class_f1[name].difference == pytest.approx(expected)
    # The mean of three answers varies less from group to group than one.
    widths = [paired.macro_f1.high - paired.macro_f1.low for paired in (result, *singles)]
    assert widths[0] < max(widths[1:])


def test_spread_is_mean_and_sample_deviation() -> None:
    result = metrics.spread([0.8, None, 0.9, 0.85])
    assert (result.mean, result.sd, result.n) == (pytest.approx(0.85), pytest.approx(0.05), 3)
    assert metrics.spread([0.5]) == Spread(mean=0.5, sd=None, n=1)
    assert metrics.spread([None]) == Spread(mean=None, sd=None, n=0)


def test_a_pair_is_scored_on_its_own_windows_alone() -> None:
    label = np.array([1, 1, 1, 3, 3, 0, 2])
    logits = np.array([[9, 2, 0, 1], [9, 0, 0, 1], [0, 5, 0, 1], [0, 3, 9, 4], [0, 1, 0, 0.5], [0, 0, 0, 9], [0] * 4])
    result = metrics.pair_confusion(logits.astype(float), label, CLASSES, (1, 3))
    assert result.intentions == [CLASSES[1], CLASSES[3]]
    assert result.confusion == [[2, 1], [1, 1]]
    assert result.accuracy == pytest.approx(3 / 5)
    # Margins 3 over 1: -1, 1, -4 of the first, 1 and -0.5 of the second: 4.5 of 6 pairs in order.
    assert result.auroc == pytest.approx(4.5 / 6)
    alone = metrics.pair_confusion(logits[:3].astype(float), label[:3], CLASSES, (1, 3))
    assert alone.auroc is None
