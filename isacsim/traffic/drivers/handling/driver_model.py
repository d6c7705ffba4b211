"""A person at the controls: pursues a goal late, unevenly, and in corrections.

A maneuver says what is wanted now (a deceleration, a lateral acceleration) from what the driver sees now. The person
looks and decides only every few tenths of a second, keeps the decision until the next one, moves foot and hands with a
lag, and never holds exactly what was meant. Overshoot and correction follow from that; no profile is written down.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from isac_cosim.base.setting_fields import LARGEST_MPS3, Range, range_within, sourced
from isac_cosim.base.settings import Settings

BRAKING_LIMIT_MPS2 = 8.5
"""Largest acceleration that a driver asks of the tyres, along and across together: a dry road, m/s2."""


class DriverSettings(Settings):
    """How people differ at the controls. Each is drawn anew for every maneuver."""

    reaction_s: Annotated[Range, range_within(0.0, 5.0)] = sourced(
        (0.6, 1.6), "time from the cause to the first motion of foot or hand, s",
        "published: Olson and Sivak 1986, median 1.1 s, 95th percentile 1.6 s",
    )  # fmt: skip
    look_away_s: Annotated[Range, range_within(0.0, 10.0)] = sourced(
        (0.3, 1.8), "time for which an inattentive driver does not look ahead, s",
        "published: Klauer et al. 2006 (100-car study), glances of up to about 2 s",
    )  # fmt: skip
    correction_s: Annotated[Range, range_within(0.05, 2.0)] = sourced(
        (0.1, 0.3), "time between two decisions, s",
        "published: Markkula et al. 2018, control as a series of discrete adjustments",
    )  # fmt: skip
    pedal_lag_s: Annotated[Range, range_within(0.02, 1.0)] = sourced(
        (0.1, 0.25), "lag of the foot, and again of the vehicle's brakes or engine, s", "chosen: 0.3 to 0.8 s to a peak"
    )
    steering_lag_s: Annotated[Range, range_within(0.02, 1.0)] = sourced(
        (0.06, 0.12), "lag of the arms, and again of the vehicle, s",
        "published: Macadam 2003, neuromuscular lag of about 0.1 s",
    )  # fmt: skip
    noise_share: Annotated[Range, range_within(0.0, 0.5)] = sourced(
        (0.04, 0.14), "standard deviation of what is done, as a share of what is meant",
        "published: Harris and Wolpert 1998, motor noise grows with the signal",
    )  # fmt: skip
    noise_s: Annotated[Range, range_within(0.05, 10.0)] = sourced(
        (0.3, 1.0), "correlation time of that noise, s", "chosen: uneven, but not trembling"
    )
    effort_gain: Annotated[Range, range_within(0.5, 4.0)] = sourced(
        (1.0, 2.2), "how much harder than necessary a driver brakes or steers, as a factor",
        "published: Markkula et al. 2016, braking grows with urgency and exceeds the need",
    )  # fmt: skip


@dataclass(frozen=True)
class Driver:
    """One person's draw from `DriverSettings`; the fields mean the same."""

    reaction_s: float
    look_away_s: float
    correction_s: float
    pedal_lag_s: float
    steering_lag_s: float
    noise_share: float
    noise_s: float
    effort_gain: float


def draw_driver(settings: DriverSettings, rng: np.random.Generator) -> Driver:
    """Return a driver, each property drawn evenly from its range in the order of the settings."""
    return Driver(**{name: float(rng.uniform(*getattr(settings, name))) for name in DriverSettings.model_fields})


class Limb:
    """A foot or a pair of arms with the vehicle's response: an acceleration that follows a demand.

    The demand is looked at every `correction_s`, give or take a third, and held in between. Noise in proportion to the
    held demand (an Ornstein-Uhlenbeck process) and two equal first-order lags turn it into the acceleration, whose jerk
    stays within `LARGEST_MPS3`.

    present_mps2: acceleration at the start, m/s2. lag_s: of each of the two lags, s.
    """

    def __init__(
        self, driver: Driver, lag_s: float, present_mps2: float, step_s: float, rng: np.random.Generator
    ) -> None:
        self._driver, self._rng, self._step_s = driver, rng, step_s
        self._share = 1.0 - float(np.exp(-step_s / lag_s))
        self._keep = float(np.exp(-step_s / driver.noise_s))
        self._spread = math.sqrt(1.0 - self._keep**2)
        self._noise = float(rng.standard_normal())
        self._held = self._lagged = present_mps2
        self._until_next_s = 0.0
        self.acceleration = present_mps2

    def follow(self, demand: Callable[[], float]) -> float:
        """Advance by one step and return the new acceleration, m/s2. demand: what the driver wants now, m/s2."""
        if self._until_next_s <= 0.0:
            self._held = demand()
            self._until_next_s = self._driver.correction_s * float(self._rng.uniform(0.67, 1.33))
        self._until_next_s -= self._step_s
        self._noise = self._keep * self._noise + self._spread * float(self._rng.standard_normal())
        meant = self._held * (1.0 + self._driver.noise_share * self._noise)
        meant = min(max(meant, -BRAKING_LIMIT_MPS2), BRAKING_LIMIT_MPS2)
        self._lagged += self._share * (meant - self._lagged)
        largest = LARGEST_MPS3 * self._step_s
        self.acceleration += min(max(self._share * (self._lagged - self.acceleration), -largest), largest)
        return self.acceleration

    def decide_now(self) -> None:
        """Look again at the next step: something has changed."""
        self._until_next_s = 0.0


def approach_mps2(error: float, rate: float, limit_mps2: float, ease_mps2: float, eagerness_per_s: float) -> float:
    """Return the acceleration by which a driver closes an error in position, m/s2.

    The driver moves no faster than it can still stop at the goal with ease_mps2, and corrects the difference between
    that rate and the present one.

    error: distance still to go, m, signed. rate: its present speed, m/s, positive where it closes a positive error.
    limit_mps2: largest acceleration. eagerness_per_s: acceleration per difference in rate, 1/s.
    """
    # Linear near the goal, so that the motion settles instead of switching sides.
    soft = ease_mps2 / eagerness_per_s
    wanted = math.copysign(math.sqrt(soft**2 + 2.0 * ease_mps2 * abs(error)) - soft, error) if error else 0.0
    return min(max(eagerness_per_s * (wanted - rate), -limit_mps2), limit_mps2)


def braking_mps2(gap_m: float, speed: float, hazard_speed: float, hazard_mps2: float, standstill_m: float) -> float:
    """Return the deceleration that just avoids reaching a hazard ahead, m/s2, zero or more.

    With closing speed c and gap g, c^2 / 2g beside what the hazard itself decelerates; where the hazard will stop
    first, v^2 / 2(g + its stopping distance).

    gap_m: to the hazard, m; standstill_m of it are kept. speed, hazard_speed: m/s. hazard_mps2: its acceleration.
    """
    room = max(gap_m - standstill_m, 0.5)
    closing = speed - hazard_speed
    slowing = max(0.0, -hazard_mps2)
    if slowing > 0.5:
        stopping_m = hazard_speed**2 / (2.0 * slowing)
        to_stop = speed**2 / (2.0 * (room + stopping_m))
        if closing <= 0.0 or hazard_speed / slowing < speed / max(to_stop, 1e-6):
            return float(to_stop)
    return float(closing**2 / (2.0 * room) + slowing) if closing > 0.0 else 0.0
