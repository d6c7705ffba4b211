"""Scores by hand, and the assignment against all assignments."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isac_cosim.isacsim.scene.scores import CUTOFF_M, SETTLED_S, SceneScores, Scoring, assign, pooled

PLACES = st.lists(st.tuples(st.floats(-4, 4), st.floats(-4, 4)), min_size=0, max_size=4)


def gospa_by_force(true: np.ndarray, tracked: np.ndarray) -> float:
    """The square of GOSPA (p = 2, alpha = 2) over all assignments, from its definition."""
    few, many = sorted((true, tracked), key=len)
    best = np.inf
    for chosen in permutations(range(len(many)), len(few)):
        apart = [np.hypot(*(one - many[k])) for one, k in zip(few, chosen, strict=True)]
        cost = sum(min(d, CUTOFF_M) ** 2 for d in apart) + CUTOFF_M**2 / 2 * (len(many) - len(few))
        best = min(best, cost)
    return best


@given(PLACES, PLACES)
def test_the_assignment_is_that_of_gospa(true: list[tuple[float, float]], tracked: list[tuple[float, float]]) -> None:
    vehicles, tracks = np.array(true).reshape(-1, 2), np.array(tracked).reshape(-1, 2)
    one, other = assign(vehicles, tracks)
    square = (np.hypot(*(vehicles[one] - tracks[other]).T) ** 2).sum() if len(one) else 0.0
    unassigned = len(vehicles) + len(tracks) - 2 * len(one)
    assert square + CUTOFF_M**2 / 2 * unassigned == pytest.approx(gospa_by_force(vehicles, tracks), abs=1e-9)


def add(scoring: Scoring, true: dict[str, float], tracked: dict[int, float], speed: float = 20.0) -> None:
    """One instant of vehicles and tracks along the x axis, each track with a variance of 0.25 m2."""
    states = np.array([[x, 0.0, speed, 0.0] for x in true.values()]).reshape(-1, 4)
    positions = np.array([[x, 0.0] for x in tracked.values()]).reshape(-1, 2)
    scoring.add(
        list(true), states, np.ones(len(true), bool), np.array(list(tracked), np.int64), positions,
        np.tile(0.25 * np.eye(2), (len(tracked), 1, 1)), np.ones(len(tracked), bool),
    )  # fmt: skip


def settled(step_s: float = 0.5) -> Scoring:
    scoring = Scoring(step_s)
    for _ in range(round(SETTLED_S / step_s)):
        add(scoring, {"a": 0.0}, {})
    return scoring


def test_scores_of_four_instants_by_hand() -> None:
    scoring = settled()
    add(scoring, {"a": 0.0, "b": 50.0}, {1: 0.5, 2: 50.0})
    add(scoring, {"a": 10.0, "b": 60.0}, {1: 10.5, 2: 60.0})
    add(scoring, {"a": 20.0, "b": 70.0}, {1: 20.5, 2: 90.0})  # b is missed, and track 2 is of nothing
    add(scoring, {"a": 30.0, "b": 80.0}, {1: 30.5, 3: 80.0})  # b has a new track
    scores = scoring.scores()
    assert (scores.instants, scores.vehicle_fixes, scores.track_fixes, scores.matched_fixes) == (4, 8, 8, 7)
    assert scores.driven_km == pytest.approx(8 * 20 * 0.5 / 1000)
    assert scores.rms_m == pytest.approx(np.sqrt(4 * 0.25 / 7), abs=1e-6)
    assert (scores.missed, scores.false, scores.missed_slow) == (0.125, 0.125, None)
    assert (scores.switches, scores.switches_per_km) == (1, pytest.approx(12.5))
    # a keeps track 1 for four instants, b track 2 for two of its four.
    assert scores.idf1 == pytest.approx(2 * (4 + 2) / 16)
    assert scores.nees == pytest.approx(4 * (0.25 / 0.25) / 7 / 2, abs=1e-6)
    assert scores.gospa_parts_m2 == (0.25, 0.5, 0.5)
    assert scores.gospa_m == pytest.approx(np.sqrt(1.25), abs=1e-6)


def test_nothing_is_scored_before_the_network_has_settled() -> None:
    late = Scoring(0.5, settled_s=10.0)
    for _ in range(20):
        add(late, {"a": 0.0, "b": 50.0}, {})  # who stood there at the beginning, and was not found
    add(late, {"b": 50.0}, {1: 50.0})
    scores = late.scores()
    assert (scores.instants, scores.vehicle_fixes, scores.missed, scores.idf1) == (1, 1, 0.0, 1.0)


def test_slow_vehicles_are_missed_by_themselves() -> None:
    scoring = settled()
    add(scoring, {"a": 0.0}, {}, speed=5.0)
    add(scoring, {"a": 0.0}, {}, speed=20.0)  # slow until five seconds later
    add(scoring, {"b": 0.0}, {1: 0.0}, speed=20.0)
    scores = scoring.scores()
    assert (scores.slow_fixes, scores.missed_slow, scores.missed) == (2, 1.0, 0.0)


def test_pooled_scores_are_those_of_all_instants() -> None:
    halves = [settled(), settled()]
    both = settled()
    for place, half in enumerate(halves):
        for turn in range(4):
            names = {f"a{place}": 0.0, f"b{place}": 50.0}
            tracks = {10 * place + 1: 0.1 * turn, 10 * place + 2: 50.0 + 3.0 * (turn == 2)}
            add(half, names, tracks)
            add(both, names, tracks)
    together, expected = pooled([half.scores() for half in halves]), both.scores()
    left_out = {"p95_m", "gospa_parts_m2"}
    assert together.model_dump(exclude=left_out) == pytest.approx(expected.model_dump(exclude=left_out), abs=2e-6)
    assert together.gospa_parts_m2 == pytest.approx(expected.gospa_parts_m2, abs=2e-6)


def test_nothing_to_score() -> None:
    empty = Scoring(0.04).scores()
    assert empty == SceneScores() == pooled([empty])
