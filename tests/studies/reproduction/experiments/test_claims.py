"""A verdict is a function of the interval alone."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import ttest_1samp

from isac_cosim.evaluation.statistics import Estimate, estimate, of_left_out, over_trainings
from isac_cosim.studies.reproduction.experiments.verdicts import (
    Claim,
    Rule,
    Verdict,
    above,
    all_of,
    at_most,
    corrected,
    is_above,
    is_at_most,
    is_within,
    judged,
    within,
)


def interval(low: float | None, high: float | None) -> Estimate:
    return Estimate(value=0.0 if low is None else (low + high) / 2, low=low, high=high)


NO_INTERVAL = [None, interval(None, None), Estimate(value=None)]


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [(0.12, 0.2, "holds"), (0.114, 0.2, "undecided"), (0.1, 0.2, "undecided"), (0.05, 0.114, "does not hold"),
     (-0.2, -0.1, "does not hold")],
)  # fmt: skip
def test_above(low: float, high: float, verdict: Verdict) -> None:
    assert above(interval(low, high), 0.114) == verdict


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [(0.0, 0.02, "holds"), (0.01, 0.03, "undecided"), (0.021, 0.03, "does not hold"), (0.0, 0.0, "holds")],
)
def test_at_most(low: float, high: float, verdict: Verdict) -> None:
    assert at_most(interval(low, high), 0.02) == verdict


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [(-0.02, 0.02, "holds"), (-0.03, 0.01, "undecided"), (0.01, 0.03, "undecided"), (0.021, 0.05, "does not hold"),
     (-0.05, -0.021, "does not hold"), (-0.5, 0.5, "undecided")],
)  # fmt: skip
def test_within(low: float, high: float, verdict: Verdict) -> None:
    assert within(interval(low, high), 0.02) == verdict


@pytest.mark.parametrize("measured", NO_INTERVAL)
def test_without_an_interval_nothing_is_told(measured: Estimate | None) -> None:
    assert [above(measured), at_most(measured, 1.0), within(measured, 1.0)] == ["undecided"] * 3


def test_a_claim_of_several_parts_holds_where_all_parts_hold() -> None:
    assert all_of(["holds", "holds"]) == "holds"
    assert all_of(["holds", "undecided"]) == "undecided"
    assert all_of(["undecided", "does not hold"]) == "does not hold"
    assert all_of([]) == "undecided"


def made(p_value: float | None, family: str = "table", verdict: Verdict = "holds") -> Claim:
    return Claim(claim="", paper="", rule="", measured=None, verdict=verdict, family=family, p_value=p_value)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=6))
def test_the_correction_is_the_closed_test_of_bonferroni(p_values: list[float]) -> None:
    """A claim is decided if every set of claims that it is in has one with p at most 0.05 over the size of the set."""
    kept = [c.verdict == "holds" for c in corrected([made(p_value) for p_value in p_values])]
    numbers = range(len(p_values))
    for k in numbers:
        sets = [s for size in range(1, len(p_values) + 1) for s in combinations(numbers, size) if k in s]
        alpha = 1 - 0.95
        assert kept[k] == all(min(p_values[j] for j in s) <= alpha / len(s) for s in sets)


def test_only_claims_of_one_family_are_corrected_together() -> None:
    alone, *others = corrected([made(0.04, "a"), made(0.04, "b"), made(0.03, "b"), made(None, "b", "undecided")])
    assert alone.verdict == "holds"
    assert [c.verdict for c in others] == ["undecided"] * 3


@given(
    st.lists(st.floats(-0.1, 0.1), min_size=4, max_size=8),
    st.sampled_from([is_above("", 0.02), is_at_most("", 0.02), is_within("", 0.03), is_within("", 0.02, 0.01)]),
)
def test_the_p_value_decides_as_the_interval_does(values: list[float], rule: Rule) -> None:
    measured = over_trainings(np.array(values))
    p_value = rule.p_value(measured)
    assert p_value is not None
    if abs(p_value - 0.05) > 1e-6 and measured.standard_error:
        assert (p_value < 0.05) == (rule.verdict(measured) != "undecided")


def test_the_p_value_is_that_of_students_t() -> None:
    values = np.array([0.03, 0.05, 0.01, 0.06])
    assert is_above("", 0.01).p_value(over_trainings(values)) == pytest.approx(ttest_1samp(values, 0.01).pvalue)
    means = np.array([(values.sum() - value) / 3 for value in values])
    jackknife = of_left_out(np.array([values.mean()]), means[None])
    assert is_above("").p_value(jackknife) == pytest.approx(ttest_1samp(values, 0).pvalue)


def test_one_training_decides_nothing() -> None:
    counts = {f"road-{k}": [[9, 1 + k % 2], [0, 10]] for k in range(5)}
    measured = estimate(lambda matrix: float(np.trace(matrix) / matrix.sum()), [counts])
    assert judged("", "", "", is_above(""), measured).verdict == "holds"
    assert judged("", "", "", is_above(""), measured, 2).verdict == "holds"
    once = judged("", "", "", is_above(""), measured, 1)
    assert (once.verdict, once.p_value, once.measured) == ("undecided", None, measured)
