"""How a budget of false alarms is shared out between intentions; trying every combination is the witness."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isac_cosim.evaluation.in_traffic.measurement.choosing import SILENT, Allocation, combined, groups_of
from isac_cosim.evaluation.in_traffic.settings import AlarmSettings, shown_threshold

counts = st.lists(st.tuples(st.integers(0, 6), st.integers(0, 5)), min_size=1, max_size=4)


def spent(rows: np.ndarray, curves: list[list[tuple[int, int]]]) -> tuple[int, int]:
    """Predicted events and false alarms of the rows that the groups chose."""
    kept = [curve[row] for row, curve in zip(rows.tolist(), curves, strict=True) if row != SILENT]
    return sum(gain for gain, _ in kept), sum(cost for _, cost in kept)


@given(st.lists(counts, min_size=1, max_size=3), st.integers(0, 12))
def test_no_combination_of_thresholds_predicts_more_within_the_budget(
    curves: list[list[tuple[int, int]]], budget: int
) -> None:
    gains, costs = ([np.array([row[column] for row in curve], np.int64) for curve in curves] for column in (0, 1))
    allocation = Allocation.of(gains, costs, budget)
    every = [
        (sum(gain for gain, _ in rows), sum(cost for _, cost in rows))
        for rows in product(*[[(0, 0), *curve] for curve in curves])
    ]
    for limit in range(budget + 1):
        most = max(gain for gain, cost in every if cost <= limit)
        least = min(cost for gain, cost in every if gain == most)
        assert spent(allocation.rows(limit), curves) == (most, least)
        assert allocation.predicted[limit] == most
    assert [allocation.predicted[step] for step in allocation.steps()] == sorted(set(allocation.predicted) - {0})


def test_of_equal_thresholds_the_strictest_is_chosen() -> None:
    allocation = Allocation.of([np.array([2, 2, 3])], [np.array([1, 1, 4])], 3)
    assert allocation.rows(3).tolist() == [0]
    assert allocation.rows(0).tolist() == [SILENT]


def test_intentions_with_few_events_share_a_threshold() -> None:
    assert groups_of(np.array([30, 2, 20, 0, 19, 50]), 20) == [(0,), (2,), (5,), (1, 3, 4)]
    assert groups_of(np.zeros(6, np.int64), 1) == [(0, 1, 2, 3, 4, 5)]
    assert groups_of(np.ones(6, np.int64), 1) == [(k,) for k in range(6)]


def test_thresholds_of_groups_become_those_of_settings_and_back() -> None:
    groups = [(0,), (2,), (1, 3, 4, 5)]
    candidates = [np.array([0.9, 0.5]), np.array([0.8]), np.array([0.7, 0.6])]
    thresholds = combined(np.array([1, SILENT, 0]), groups, candidates)
    assert thresholds.tolist() == [0.5, 0.7, np.inf, 0.7, 0.7, 0.7]
    settings = AlarmSettings(method="reject", threshold=shown_threshold(thresholds))
    again = AlarmSettings.model_validate_json(settings.model_dump_json())
    assert again.thresholds.tolist() == thresholds.tolist()
    assert shown_threshold(np.full(6, 0.5)) == 0.5


def test_a_threshold_of_no_intention_is_refused() -> None:
    with pytest.raises(ValueError, match="u_turn: no such intention"):
        AlarmSettings(method="reject", threshold={"u_turn": 0.5})
