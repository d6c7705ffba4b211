"""Intervals over few scenario seeds: how often they cover the true score, against the bootstrap they replaced."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t as student_t

from isac_cosim.benchmarks.findings.interval_coverage import coverage, coverage_of_bootstrap, coverage_of_difference
from isac_cosim.evaluation.on_windows import metrics
from isac_cosim.evaluation.statistics import jackknife_half_width


@pytest.mark.parametrize("groups", [8, 20])
def test_the_interval_of_a_macro_f1_covers_it(groups: int) -> None:
    covered = coverage(groups)
    assert covered >= 0.93
    assert coverage_of_bootstrap(groups, 200, 200) < covered


@pytest.mark.parametrize("groups", [8, 20])
def test_the_interval_of_a_difference_covers_it(groups: int) -> None:
    """Of two predictors that are equally good, neither is called better too often."""
    assert coverage_of_difference(groups) >= 0.93


def test_of_a_mean_the_interval_is_student_s() -> None:
    values = np.random.default_rng(3).normal(size=(7, 2))
    left_out = np.stack([np.delete(values, g, axis=0).mean(axis=0) for g in range(7)])
    expected = student_t.interval(0.95, 6, loc=0.0, scale=values.std(axis=0, ddof=1) / np.sqrt(7))[1]
    np.testing.assert_allclose(jackknife_half_width(left_out), expected)


def test_one_group_has_no_interval() -> None:
    assert np.isnan(jackknife_half_width(np.ones((1, 3)))).all()
    assert np.isnan(jackknife_half_width(np.ones((0, 3)))).all()
    value, low, high = metrics.macro_f1_interval(np.eye(3)[None] * 5)
    assert (value, low, high) == (1.0, None, None)
