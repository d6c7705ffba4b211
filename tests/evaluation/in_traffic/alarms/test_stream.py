"""Alarms as they come are the alarms of the whole episode."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.evaluation.in_traffic.alarms.alarms import NEVER, Levels, alarms, is_pause
from isac_cosim.evaluation.in_traffic.alarms.stream import AlarmStream
from isac_cosim.evaluation.in_traffic.settings import AlarmSettings
from isac_cosim.evaluation.in_traffic.streams.predictions import Answers
from isac_cosim.labeling.intentions import KNOWN

OF_INTENTIONS = {"hard_brake": 0.4, "right_lane_change": -1.0, "evasive_swerve": 2.0}
DECISION_S = 0.1


def both(settings: AlarmSettings, level: np.ndarray, answered: np.ndarray) -> tuple[list[tuple], list[tuple]]:
    """Time, vehicle and intention of the alarms of a whole episode, and of the same answers one after the other.

    level: of V vehicles over D decisions, (V, D, 6). answered: (V, D).
    """
    vehicle, decision = np.nonzero(answered)
    time_s = np.round(decision * DECISION_S, 9)
    begins = np.ones(len(vehicle), bool)
    begins[1:] = (np.diff(vehicle) != 0) | is_pause(np.diff(time_s), DECISION_S)
    whole = alarms(Levels(level[answered], vehicle, time_s, begins), settings)
    expected = sorted(zip(whole.time_s.tolist(), whole.vehicle.tolist(), whole.intention.tolist(), strict=True))

    stream, raised = AlarmStream(settings, lambda answers: answers.score, DECISION_S), []
    for number in range(answered.shape[1]):
        present = np.flatnonzero(answered[:, number])
        answers = Answers(np.empty((len(present), 6), np.float32), level[present, number], np.empty((0, 0), np.float32))
        for alarm in stream.raised([str(v) for v in present], answers, round(number * DECISION_S, 9)):
            intention = [known.text for known in KNOWN].index(alarm.intention)
            raised.append((alarm.time_s, int(alarm.tv), intention))
    return expected, sorted(raised)


@pytest.mark.parametrize(("k", "n", "threshold"), [(1, 1, 0.4), (2, 3, OF_INTENTIONS), (4, 5, 0.4)])
def test_one_answer_at_a_time_raises_the_alarms_of_the_episode(
    k: int, n: int, threshold: float | dict[str, float]
) -> None:
    """Three vehicles over 400 decisions; each is answered most of the time, with levels that wander."""
    rng = np.random.default_rng(k)
    chosen = AlarmSettings(method="reject", threshold=threshold, k=k, n=n, refractory_s=0.8)
    level = np.cumsum(rng.normal(0.0, 0.3, (3, 400, len(KNOWN))), axis=1).astype(np.float32)
    expected, raised = both(chosen, level, rng.random((3, 400)) > 0.08)
    assert len(expected) > 20
    assert raised == expected


@settings(max_examples=60, deadline=None)
@given(
    n=st.integers(1, 5),
    more=st.integers(0, 4),
    refractory_s=st.sampled_from([0.0, 0.1, 0.3, 0.5, 2.0]),
    rise=st.sampled_from([None, 1.0, 2.0]),
    missing=st.floats(0.0, 0.6),
    seed=st.integers(0, 2**16),
)
def test_whatever_comes_both_agree(
    n: int, more: int, refractory_s: float, rise: float | None, missing: float, seed: int
) -> None:
    """Levels that jump between a few values, NEVER among them, at thresholds that they meet exactly."""
    rng = np.random.default_rng(seed)
    chosen = AlarmSettings(
        method="reject",
        threshold={"hard_brake": 1.0, "overtake": 0.0},
        k=max(1, n - more),
        n=n,
        refractory_s=refractory_s,
        rise=rise,
    )
    level = rng.choice([NEVER, -1.0, 0.0, 1.0, 2.0], (2, 60, len(KNOWN))).astype(np.float32)
    expected, raised = both(chosen, level, rng.random((2, 60)) >= missing)
    assert raised == expected
