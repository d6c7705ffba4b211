"""A verdict is a function of the interval alone."""

from __future__ import annotations

import pytest

from isac_cosim.evaluation.statistics import Estimate
from isac_cosim.studies.reproduction.experiments.stages import Verdict, above, all_of, at_most, within


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
