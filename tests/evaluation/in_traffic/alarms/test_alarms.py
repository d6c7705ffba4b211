"""When answers become alarms: threshold, k of n, refractory time, and pauses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from isac_cosim.evaluation.in_traffic.alarms.alarms import (
    NEVER,
    Levels,
    alarms,
    confirmed,
    duty_cycle,
    peaks,
    raised,
    reject_levels,
)
from isac_cosim.evaluation.in_traffic.settings import AlarmSettings
from isac_cosim.evaluation.in_traffic.streams.predictions import Answers
from isac_cosim.labeling.intentions import KNOWN


def levels(*values: float, begins: tuple[int, ...] = (0,), vehicle: list[int] | None = None) -> Levels:
    """Levels of the first intention, every 0.1 s; the other intentions stay at 0."""
    level = np.zeros((len(values), len(KNOWN)), np.float32)
    level[:, 0] = values
    start = np.zeros(len(values), dtype=bool)
    start[list(begins)] = True
    vehicles = np.zeros(len(values), np.int64) if vehicle is None else np.array(vehicle)
    return Levels(level, vehicles, np.arange(len(values)) * 0.1, start)


def rows(of: Levels, threshold: float = 0.5, refractory_s: float = 0.0) -> list[int]:
    return raised(of, threshold, refractory_s).row.tolist()


def test_an_alarm_is_raised_when_the_level_rises_to_the_threshold() -> None:
    assert rows(levels(0, 0.4, 0.5, 0.9, 0.9, 0.2, 0.6)) == [2, 6]


def test_the_first_prediction_can_raise_an_alarm() -> None:
    assert rows(levels(0.9, 0.9)) == [0]


def test_nothing_is_raised_within_the_refractory_time() -> None:
    on_and_off = levels(1, 0, 1, 0, 1, 0, 1)
    assert rows(on_and_off) == [0, 2, 4, 6]
    assert rows(on_and_off, refractory_s=0.4) == [0, 4]


def test_the_refractory_time_is_of_one_vehicle_and_intention() -> None:
    of = levels(1, 0, 1, 0, begins=(0, 2), vehicle=[0, 0, 1, 1])
    assert rows(of, refractory_s=9.0) == [0, 2]
    of.level[1, 3] = 1.0
    raised_too = raised(replace(of), 0.5, 9.0)
    assert list(zip(raised_too.intention.tolist(), raised_too.row.tolist(), strict=True)) == [(0, 0), (0, 2), (3, 1)]


@pytest.mark.parametrize(("k", "n"), [(1, 1), (2, 3), (3, 3), (4, 5)])
def test_confirmation_counts_the_last_n_levels(k: int, n: int) -> None:
    rng = np.random.default_rng(k)
    of = levels(*rng.random(60), begins=(0, 17, 18, 40))
    steady = confirmed(of, k, n).level[:, 0]
    for row in range(60):
        begin = max(b for b in (0, 17, 18, 40) if b <= row)
        recent = sorted(of.level[max(begin, row - n + 1) : row + 1, 0], reverse=True)
        assert steady[row] == (recent[k - 1] if len(recent) >= k else -np.inf)


def test_settings_apply_confirmation_threshold_and_refractory_time() -> None:
    of = levels(1, 0, 1, 1, 0, 0, 1, 1)
    settings = AlarmSettings(method="reject", threshold=0.5, k=2, n=2, refractory_s=0.0)
    assert alarms(of, settings).row.tolist() == [3, 7]
    assert duty_cycle(of, settings) == pytest.approx(2 / 8)


def test_the_paper_s_level_is_the_unknown_score_of_the_likeliest_intention() -> None:
    probabilities = np.array([[0.6, 0.3, 0.1, 0, 0, 0], [0.4, 0.45, 0.15, 0, 0, 0]], np.float32)
    answers = Answers(probabilities, np.array([2.5, -1.0], np.float32), np.empty((2, 0), np.float32))
    free = reject_levels(answers, 0.0)
    assert (free[0, 0], free[1, 1]) == (2.5, -1.0)
    assert np.isneginf(free).sum() == 10
    assert np.isneginf(reject_levels(answers, 0.5)[1]).all()


def test_a_peak_is_the_highest_level_between_two_pauses() -> None:
    of = levels(0.1, 0.7, 0.3, 0.2, 0.9, begins=(0, 3))
    of.level[:, 1:] = -np.inf
    assert sorted(peaks(of).tolist()) == pytest.approx([0.7, 0.9])


@pytest.mark.parametrize(
    ("rise", "times"), [(None, [0.1]), (2.0, [0.1, 0.7]), (4.0, [0.1])], ids=["never", "by 2", "by too much"]
)
def test_a_level_that_stays_on_raises_another_alarm_on_a_new_rise(rise: float | None, times: list[float]) -> None:
    """From 1.0 at 0.1 s up to 5 and down to 2.5, all above the threshold of 1; the new rise reaches 4.5 at 0.7 s."""
    level = np.array([0.0, 1.0, 4.0, 5.0, 3.5, 2.5, 3.0, 4.5, 4.6, 4.4, 4.5, 0.0], np.float32)
    assert raised_at(level, threshold=1.0, rise=rise) == times


def test_a_rise_that_begins_below_the_threshold_is_one_alarm() -> None:
    level = np.array([0.0, 5.0, 0.5, 1.5, 2.6, 5.0, 5.0], np.float32)
    assert raised_at(level, threshold=1.0, rise=2.0) == [0.1, 0.3]


def test_a_slow_rise_to_a_peak_is_one_alarm() -> None:
    level = np.array([1.0, 2.0, 3.0, 5.0, 8.0, 7.9, 8.0, 9.0], np.float32)
    assert raised_at(level, threshold=1.0, rise=2.0) == [0.0]


def raised_at(level: np.ndarray, threshold: float, rise: float | None) -> list[float]:
    """Return when the first intention of one vehicle raises alarms, s, at ten predictions a second."""
    levels = np.full((len(level), len(KNOWN)), NEVER, np.float32)
    levels[:, 0] = level
    time_s = np.round(np.arange(len(level)) * 0.1, 9)
    begins = time_s == 0.0
    return raised(Levels(levels, np.zeros(len(level), np.int64), time_s, begins), threshold, 0.0, rise).time_s.tolist()
