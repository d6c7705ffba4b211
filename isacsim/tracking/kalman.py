"""Six-state constant-acceleration Kalman filter over fused fixes, many records at a time (Step 4 of ASI-BIP).

States x, y, vx, vy, ax, ay; a fix is x, y, vx, vy with its own covariance at every step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.base.settings import Settings


class TrackingSettings(Settings):
    """The filter's model of how vehicles move, and how it starts."""

    jerk_density: float = Field(
        10.0, gt=0, le=1e6, description="Spectral density of the white jerk along either axis, m2/s5."
    )
    start_acceleration_mps2: float = Field(
        4.0,
        gt=0,
        le=1e3,
        description="Standard deviation of the acceleration along either axis before the first fix.",
    )
    gate: float = Field(
        1000.0,
        gt=0,
        le=1e15,
        description="A fix whose normalised innovation squared exceeds this is an outlier and is not used; far above "
        "chi-square, so that an unexpected maneuver is never mistaken for an outlier.",
    )
    reacquire_s: float = Field(
        0.1,
        gt=0,
        le=1e5,
        description="After this long with nothing but outliers the filter starts anew from the next fix.",
    )
    run_in_s: float = Field(
        0.5,
        ge=0,
        le=5,
        description="Run-in: time sensed before the record begins, in which the filter settles; the motion is the "
        "vehicle's true past, or the earliest known state carried back at constant acceleration.",
    )

    @model_validator(mode="before")
    @classmethod
    def _former_key(cls, content: Any) -> Any:
        """Accept files written before, which call the run-in `prelude_s`."""
        if isinstance(content, dict) and "prelude_s" in content and "run_in_s" not in content:
            return {("run_in_s" if key == "prelude_s" else key): value for key, value in content.items()}
        return content


@dataclass(frozen=True)
class FilteredStates:
    """Filtered states of B records.

    state: x, y, vx, vy, ax, ay, (B, S, 6). covariance: after the last step, (B, 6, 6). innovation: normalised
    innovation squared of each fix, (B, S); zero for the first fix and where there is none. refused: number of outliers
    in a row up to the last step, (B,).
    """

    state: Array
    covariance: Array
    innovation: Array
    refused: IntArray

    def first(self, count: int) -> FilteredStates:
        """Return the states of the first records."""
        return FilteredStates(
            self.state[:count], self.covariance[:count], self.innovation[:count], self.refused[:count]
        )


def transition(step_s: float) -> Array:
    """Transition matrix of constant acceleration over one step, (6, 6)."""
    pair = np.eye(2)
    zero = np.zeros((2, 2))
    return np.block([[pair, step_s * pair, step_s**2 / 2 * pair], [zero, pair, step_s * pair], [zero, zero, pair]])


def process_noise(step_s: float, jerk_density: float) -> Array:
    """Covariance that white jerk adds over one step, (6, 6).

    Source: Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and Navigation, 6.2.3.
    """
    t = step_s
    axis = np.array([[t**5 / 20, t**4 / 8, t**3 / 6], [t**4 / 8, t**3 / 3, t**2 / 2], [t**3 / 6, t**2 / 2, t]])
    return np.asarray(jerk_density * np.kron(axis, np.eye(2)))


def start(fix: Array, covariance: Array, settings: TrackingSettings) -> tuple[Array, Array]:
    """Start the filter with a first fix (B, 4) and its covariance (B, 4, 4): state (B, 6), covariance (B, 6, 6)."""
    state = np.zeros((len(fix), 6))
    state[:, :4] = fix
    spread = np.zeros((len(fix), 6, 6))
    spread[:, :4, :4] = covariance
    spread[:, 4, 4] = spread[:, 5, 5] = settings.start_acceleration_mps2**2
    return state, spread


def track(
    fixes: Array,
    covariances: Array,
    valid: BoolArray,
    step_s: float,
    settings: TrackingSettings,
    before: FilteredStates | None = None,
) -> FilteredStates:
    """Filter the fixes of B records.

    fixes: x, y, vx, vy, (B, S, 4). covariances: (B, S, 4, 4). valid: (B, S); where false, the filter only predicts. The
    first fix of every record must be valid, or have a covariance that says how uncertain it is.
    before: what came of the fixes before these, of the same records; the filter goes on from there. A record that is
    filtered piece by piece gives what it gives as a whole.
    """
    records, instants = valid.shape
    # One instant after the other in memory: a step reads and writes whole pieces of it.
    measured, uncertain, missing = (
        np.ascontiguousarray(of.swapaxes(0, 1)) for of in (fixes[..., None], covariances, ~valid)
    )
    states: Array = np.empty((instants, records, 6, 1))
    innovations: Array = np.zeros((instants, records, 1, 1))
    if before is None:
        state, spread = start(fixes[:, 0], covariances[:, 0], settings)
        states[0, ..., 0] = state
        steps = _Steps(states[0], spread, np.zeros(records, dtype=np.int64), step_s, settings)
    else:
        steps = _Steps(before.state[:, -1, :, None], before.covariance, before.refused, step_s, settings)
    gaps: BoolArray = np.asarray(missing.any(axis=1))
    for k in range(1 if before is None else 0, instants):
        steps.go(measured[k], uncertain[k], missing[k] if gaps[k] else None, states[k], innovations[k])
    by_record = states[..., 0].swapaxes(0, 1), innovations[..., 0, 0].swapaxes(0, 1)
    return FilteredStates(by_record[0], steps.spread, by_record[1], steps.refused)


class _Steps:
    """The filters of B records at one instant, which go on step by step.

    Every product has a buffer of its own that each step overwrites: with few records, making arrays would take as long
    as the arithmetic. Vectors are columns, (B, n, 1).
    """

    def __init__(
        self, state: Array, spread: Array, refused: IntArray, step_s: float, settings: TrackingSettings
    ) -> None:
        self._settings, self._most_refused = settings, settings.reacquire_s / step_s
        self._move, self._noise = transition(step_s), process_noise(step_s, settings.jerk_density)
        self._state, self.spread, self.refused = np.ascontiguousarray(state), np.array(spread), refused.copy()
        self._refusing = bool(refused.any())
        records = len(state)
        self._moved, self._correction = np.empty((records, 6, 1)), np.empty((records, 6, 1))
        self._surprise, self._weighted = np.empty((records, 4, 1)), np.empty((records, 4, 1))
        self._product, self._gain, self._total = (np.empty((records, *of)) for of in ((6, 6), (6, 4), (4, 4)))

    def go(self, fix: Array, covariance: Array, missing: BoolArray | None, state: Array, innovation: Array) -> None:
        """Go to the next instant. Writes state, (B, 6, 1), and innovation, the normalised one squared, (B, 1, 1).

        fix: (B, 4, 1). covariance: (B, 4, 4). missing: where there is no fix, (B,); None if there are all.
        """
        moved, surprise, gain, product, spread = self._moved, self._surprise, self._gain, self._product, self.spread
        np.matmul(self._move, self._state, out=moved)
        np.matmul(self._move, spread, out=product)
        np.matmul(product, self._move.T, out=spread)
        np.add(spread, self._noise, out=spread)
        weight = np.linalg.inv(np.add(spread[:, :4, :4], covariance, out=self._total))
        # A fix that is missing has no weight: its gain is set to zero.
        if missing is not None:
            weight[missing] = 0.0
        np.subtract(fix, moved[:, :4], out=surprise)
        np.matmul(weight, surprise, out=self._weighted)
        np.matmul(surprise.transpose(0, 2, 1), self._weighted, out=innovation)
        outlier = innovation > self._settings.gate
        if self._refusing or outlier.any():
            self._refuse(outlier[:, 0, 0], missing, weight)
        np.matmul(spread[:, :, :4], weight, out=gain)
        np.add(moved, np.matmul(gain, surprise, out=self._correction), out=state)
        np.matmul(gain, spread[:, :4], out=product)
        np.subtract(spread, product, out=product)
        # Without this, rounding makes the covariance drift from symmetry, and the filter from its reference.
        np.add(product, product.transpose(0, 2, 1), out=spread)
        np.divide(spread, 2, out=spread)
        if self._refusing:
            self._find_again(fix, covariance, state)
        self._state = state

    def _refuse(self, outlier: BoolArray, missing: BoolArray | None, weight: Array) -> None:
        """Take the weight from outliers, and count those in a row."""
        kept = 0 if missing is None else np.where(missing, self.refused, 0)
        self.refused = np.where(outlier, self.refused + 1, kept)
        self._refusing = bool(self.refused.any())
        weight[outlier] = 0.0

    def _find_again(self, fix: Array, covariance: Array, state: Array) -> None:
        """Start the filters anew that have had nothing but outliers for too long."""
        lost = self.refused > self._most_refused
        if lost.any():
            state[lost, :, 0], self.spread[lost] = start(fix[lost, :, 0], covariance[lost], self._settings)
            self.refused[lost] = 0
