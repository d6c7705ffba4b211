"""Alarms as they come are the alarms of the whole episode."""

from __future__ import annotations

import numpy as np
import pytest

from isac_cosim.evaluation.in_traffic.alarms.alarms import Levels, alarms
from isac_cosim.evaluation.in_traffic.alarms.stream import AlarmStream
from isac_cosim.evaluation.in_traffic.settings import AlarmSettings
from isac_cosim.evaluation.in_traffic.streams.predictions import Answers
from isac_cosim.labeling.intentions import KNOWN

OF_INTENTIONS = {"hard_brake": 0.4, "right_lane_change": -1.0, "evasive_swerve": 2.0}


@pytest.mark.parametrize(("k", "n", "threshold"), [(1, 1, 0.4), (2, 3, OF_INTENTIONS), (4, 5, 0.4)])
def test_one_answer_at_a_time_raises_the_alarms_of_the_episode(
    k: int, n: int, threshold: float | dict[str, float]
) -> None:
    rng = np.random.default_rng(k)
    settings = AlarmSettings(method="reject", threshold=threshold, k=k, n=n, refractory_s=0.8)
    # Three vehicles over 400 decisions; each is answered most of the time, with levels that wander.
    level = np.cumsum(rng.normal(0.0, 0.3, (3, 400, len(KNOWN))), axis=1).astype(np.float32)
    answered = rng.random((3, 400)) > 0.08
    vehicle, decision = np.nonzero(answered)
    time_s = np.round(decision * 0.1, 9)
    begins = np.ones(len(vehicle), bool)
    begins[1:] = (np.diff(vehicle) != 0) | (np.diff(time_s) > 0.15)
    whole = alarms(Levels(level[answered], vehicle, time_s, begins), settings)
    expected = sorted(zip(whole.time_s.tolist(), whole.vehicle.tolist(), whole.intention.tolist(), strict=True))

    stream = AlarmStream(settings, lambda answers: answers.score, 0.1)
    raised = []
    for number in range(400):
        present = np.flatnonzero(answered[:, number])
        answers = Answers(np.empty((len(present), 6), np.float32), level[present, number], np.empty((0, 0), np.float32))
        for alarm in stream.raised([str(v) for v in present], answers, round(number * 0.1, 9)):
            intention = [known.text for known in KNOWN].index(alarm.intention)
            raised.append((alarm.time_s, int(alarm.tv), intention))
    assert len(expected) > 20
    assert sorted(raised) == expected
