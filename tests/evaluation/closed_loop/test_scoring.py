"""What is scored of an arm, and the differences between arms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ttest_rel

from isac_cosim.evaluation.closed_loop.episode import DrivenArm, measured
from isac_cosim.evaluation.closed_loop.safety import Totals
from isac_cosim.evaluation.closed_loop.scoring import (
    arm_results,
    collided_advised,
    collisions,
    differences,
    rows_within,
    spans_of,
)
from isac_cosim.evaluation.closed_loop.settings import ClosedLoopSettings
from isac_cosim.evaluation.closed_loop.store import AdvisoryFacts, AlarmFacts, ArmEpisode
from isac_cosim.evaluation.statistics import jackknife_half_width
from isac_cosim.labeling.road.straight_road import ScriptedVehicle, straight_road

SETTINGS = ClosedLoopSettings(near_m=100.0, after_s=5.0)


def episode(gap_m: float, *alarms: AlarmFacts) -> ArmEpisode:
    """A follower that closes in on its leader at 10 m/s for 8 s, and a vehicle far away."""
    recording = straight_road(
        ScriptedVehicle("behind", 30.0, duration_s=8.0),
        ScriptedVehicle("ahead", 20.0, start_m=gap_m + 5.0, duration_s=8.0),
        ScriptedVehicle("far", 25.0, start_m=900.0, duration_s=8.0),
    )
    return measured(DrivenArm(recording, "placebo", list(alarms)))


ALARM = AlarmFacts(tv="ahead", intention="hard_brake", time_s=1.0, raised_s=1.6, x=115.0, y=0.0)


def test_the_vehicles_near_an_alarm_are_scored_for_some_time_after_it() -> None:
    placebo = episode(90.0, ALARM)
    spans = spans_of(placebo, SETTINGS)
    assert spans == {"behind": [(1.6, 6.6)], "ahead": [(1.6, 6.6)]}
    rows = rows_within(placebo, spans)
    assert {placebo.driving.names[k] for k in placebo.driving.vehicle[rows]} == {"behind", "ahead"}
    times = placebo.driving.time_s[rows]
    assert (times.min(), times.max()) == pytest.approx((1.7, 6.6))
    assert rows.sum() == 2 * 50


def test_two_alarms_at_once_score_a_vehicle_once() -> None:
    twice = episode(90.0, ALARM, ALARM.model_copy(update={"raised_s": 2.6}))
    assert rows_within(twice, spans_of(twice, SETTINGS)).sum() == 2 * 60


def test_arms_are_scored_by_the_placebos_alarms() -> None:
    none, placebo, arm = episode(90.0), episode(90.0, ALARM), episode(120.0, ALARM, ALARM)
    results, hours = arm_results({"none": [none] * 3, "placebo": [placebo] * 3, "isac": [arm] * 3}, SETTINGS)
    assert hours == pytest.approx(3 * 10.0 / 3600)
    assert results["placebo"].after_alarms == results["none"].after_alarms
    assert results["isac"].alarms == 6
    # The gap of 90 m gets below 30 m, 3 s at 10 m/s, after 6 s: 0.6 s of the 10 vehicle-seconds; that of 120 m never.
    below = results["none"].after_alarms["ttc_below_3_s"]
    assert below is not None
    assert below * 10.0 / 3600 == pytest.approx(0.6, abs=0.11)
    difference = results["isac"].difference["ttc_below_3_s"]
    assert (difference.value, difference.relative) == pytest.approx((-below, -1.0))
    assert difference.interval is not None
    assert difference.interval.low == pytest.approx(difference.interval.high)


def test_differences_have_the_interval_of_the_jackknife_over_seeds() -> None:
    rng = np.random.default_rng(3)
    base = Totals(1.0, 90.0, 100.0, 20.0, 10.0, 3, 1, 4.0, 6.0)
    reference = [replace(base, ttc_below_3_s=float(x)) for x in rng.uniform(50, 150, 6)]
    arm = [replace(base, ttc_below_3_s=float(x)) for x in rng.uniform(30, 120, 6)]
    # With equal hours in every seed, the difference is a mean of differences, whose jackknife is known.
    paired = np.array([a.ttc_below_3_s - b.ttc_below_3_s for a, b in zip(arm, reference, strict=True)])
    left_out = (paired.sum() - paired) / 5
    measured_difference = differences(arm, reference)["ttc_below_3_s"]
    assert measured_difference.value == pytest.approx(paired.mean())
    assert measured_difference.interval is not None
    half = (measured_difference.interval.high - measured_difference.interval.low) / 2
    assert half == pytest.approx(float(jackknife_half_width(left_out)))


def test_collisions_differ_as_in_a_paired_t_test() -> None:
    def collided(*counts: int) -> list[ArmEpisode]:
        base = episode(90.0)
        facts = (base.facts.model_copy(update={"collided": tuple(map(str, range(count)))}) for count in counts)
        return [replace(base, facts=part) for part in facts]

    arm, reference = (0, 4, 0, 0, 2), (6, 10, 2, 0, 6)
    difference = collisions(collided(*arm), collided(*reference))
    expected = ttest_rel(arm, reference).confidence_interval(0.95)
    assert difference.value == pytest.approx(np.mean(arm) - np.mean(reference))
    assert difference.relative == pytest.approx(6 / 24 - 1)
    assert difference.interval is not None
    assert (difference.interval.low, difference.interval.high) == pytest.approx((expected.low, expected.high))
    assert collisions(collided(1), collided(2)).interval is None
    assert collisions(collided(1, 0), collided(0, 0)).relative is None
    few = collisions(collided(0, 1, 0), collided(1, 0, 4)).relative_interval
    assert few is not None
    assert few.low == -1.0, "collisions do not fall by more than all of them"
    assert few.high > 0.0


def test_a_single_seed_has_no_interval_and_no_danger_no_relative_difference() -> None:
    base = Totals(1.0, 90.0, 0.0, 0.0, 0.0, 0, 0, 0.0, 2.0)
    single = differences([base], [base])
    assert single["ttc_below_3_s"].interval is None
    assert single["ttc_below_3_s"].relative is None
    assert single["travel_s_per_km"].relative == 0.0


def test_who_followed_an_advisory_is_told_apart_among_those_that_collided() -> None:
    def told(vehicle: str, fate: str, begun_s: float | None) -> AdvisoryFacts:
        return AdvisoryFacts(vehicle=vehicle, instruction="slow", time_s=1.0, fate=fate, begun_s=begun_s)

    advisories = (
        told("a", "followed", 2.0),
        told("b", "refused", None),
        told("c", "dropped", 2.0),
        told("a", "busy", None),
    )
    facts = episode(90.0).facts.model_copy(update={"collided": ("a", "b", "d"), "advisories": advisories})
    assert collided_advised(facts) == {"a"}
