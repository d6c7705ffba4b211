"""The driver model alone: late, uneven, in corrections, and still at its goal in the end."""

import numpy as np
import pytest

from isac_cosim.base.setting_fields import LARGEST_MPS3
from isac_cosim.isacsim.traffic.drivers.handling.driver_model import (
    BRAKING_LIMIT_MPS2,
    Driver,
    DriverSettings,
    Limb,
    approach_mps2,
    braking_mps2,
    draw_driver,
)

STEP = 0.01
EXACT = Driver(
    reaction_s=1.0, look_away_s=1.0, correction_s=0.2, pedal_lag_s=0.15, steering_lag_s=0.1, noise_share=0.0,
    noise_s=0.5, effort_gain=1.0,
)  # fmt: skip


def followed(driver: Driver, demands: list[float], seed: int = 1, present: float = 0.0) -> np.ndarray:
    limb = Limb(driver, driver.pedal_lag_s, present, STEP, np.random.default_rng(seed))
    return np.array([limb.follow(lambda demand=demand: demand) for demand in demands])


def test_a_driver_is_drawn_within_the_ranges_and_reproducibly() -> None:
    settings = DriverSettings()
    drivers = [draw_driver(settings, np.random.default_rng(seed)) for seed in range(50)]
    assert drivers[0] == draw_driver(settings, np.random.default_rng(0)) != drivers[1]
    for name in DriverSettings.model_fields:
        values = [getattr(driver, name) for driver in drivers]
        low, high = getattr(settings, name)
        assert low <= min(values) < max(values) <= high


def test_a_limb_reaches_what_is_meant_late_and_smoothly() -> None:
    """The analytic answer of two lags T = 0.15 s to a step: 1 - (1 + t/T) e^(-t/T)."""
    acceleration = followed(EXACT, [-4.0] * 300)
    t = STEP * np.arange(1, 301)
    expected = -4.0 * (1.0 - (1.0 + t / 0.15) * np.exp(-t / 0.15))
    np.testing.assert_allclose(acceleration, expected, atol=0.2)
    assert acceleration[-1] == pytest.approx(-4.0, abs=0.01)
    assert np.abs(np.diff(acceleration)).max() / STEP <= LARGEST_MPS3 + 1e-9


def test_decisions_are_held_until_the_next_one() -> None:
    """A demand that changes within a correction interval is only answered at its end."""
    looks = []
    limb = Limb(EXACT, 0.15, 0.0, STEP, np.random.default_rng(3))
    for step in range(300):
        limb.follow(lambda step=step: looks.append(step) or 0.0)  # type: ignore[func-returns-value]
    intervals = np.diff(looks) * STEP
    assert 0.67 * 0.2 - STEP <= intervals.min() < intervals.max() <= 1.33 * 0.2 + STEP
    limb.decide_now()
    limb.follow(lambda: looks.append(-1) or 0.0)  # type: ignore[func-returns-value]
    assert looks[-1] == -1


def test_noise_grows_with_what_is_meant_and_has_its_share() -> None:
    noisy = Driver(**{**EXACT.__dict__, "noise_share": 0.1, "noise_s": 1.0})
    for demand in (-2.0, -6.0):
        settled = np.concatenate([followed(noisy, [demand] * 1500, seed)[200:] for seed in range(30)])
        assert settled.mean() == pytest.approx(demand, rel=0.03)
        # The lags take away some of the noise, never add any.
        assert 0.06 < settled.std() / abs(demand) < 0.1
    assert followed(noisy, [0.0] * 300).std() == 0.0
    assert np.abs(followed(noisy, [-8.5] * 3000)).max() <= BRAKING_LIMIT_MPS2


def test_a_goal_is_passed_by_centimetres_at_most() -> None:
    """Integrated without any lag, from rest and from moving the wrong way."""
    for start, speed in ((1.5, 0.0), (-3.6, 0.0), (1.0, 1.0)):
        position, rate, extreme = -start, -speed, 0.0
        for _ in range(2000):
            rate += approach_mps2(-position, rate, 4.0, 3.0, 4.5) * STEP
            position += rate * STEP
            extreme = max(extreme, position * np.sign(start))
        assert abs(position) < 1e-3
        assert extreme < 0.1
    assert approach_mps2(100.0, 0.0, 4.0, 3.0, 4.5) == 4.0


@pytest.mark.parametrize(
    ("gap", "speed", "hazard_speed", "hazard_mps2"),
    [(40.0, 25.0, 15.0, 0.0), (60.0, 30.0, 0.0, 0.0), (30.0, 25.0, 20.0, -4.0), (20.0, 20.0, 20.0, -6.0)],
)
def test_the_needed_deceleration_just_avoids_the_hazard(
    gap: float, speed: float, hazard_speed: float, hazard_mps2: float
) -> None:
    """By integrating both motions: with it the standstill gap is kept, with 10 % less it is not."""
    needed = braking_mps2(gap, speed, hazard_speed, hazard_mps2, 3.0)

    def least_gap(deceleration: float) -> float:
        left, v, h, least = gap, speed, hazard_speed, gap
        for _ in range(4000):
            v, h = max(0.0, v - deceleration * STEP), max(0.0, h + hazard_mps2 * STEP)
            left += (h - v) * STEP
            least = min(least, left)
        return least

    assert least_gap(needed) == pytest.approx(3.0, abs=0.6)
    assert least_gap(0.9 * needed) < 2.0


def test_nothing_is_needed_behind_a_faster_vehicle() -> None:
    assert braking_mps2(20.0, 20.0, 25.0, 0.0, 3.0) == 0.0
