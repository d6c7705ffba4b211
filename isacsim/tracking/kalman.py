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
class Tracks:
    """Filtered states of B records.

    state: x, y, vx, vy, ax, ay, (B, S, 6). covariance: after the last step, (B, 6, 6). innovation: normalised
    innovation squared of each fix, (B, S); zero for the first fix and where there is none. refused: number of outliers
    in a row up to the last step, (B,).
    """

    state: Array
    covariance: Array
    innovation: Array
    refused: IntArray


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
    before: Tracks | None = None,
) -> Tracks:
    """Filter the fixes of B records.

    fixes: x, y, vx, vy, (B, S, 4). covariances: (B, S, 4, 4). valid: (B, S); where false, the filter only predicts. The
    first fix of every record must be valid, or have a covariance that says how uncertain it is.
    before: what came of the fixes before these, of the same records; the filter goes on from there. A record that is
    filtered piece by piece gives what it gives as a whole.
    """
    move, noise = transition(step_s), process_noise(step_s, settings.jerk_density)
    states = np.empty((*fixes.shape[:2], 6))
    innovations = np.zeros(fixes.shape[:2])
    missing = ~valid
    if before is None:
        state, spread = start(fixes[:, 0], covariances[:, 0], settings)
        states[:, 0] = state
        refused = np.zeros(len(fixes), dtype=np.int64)
    else:
        state, spread, refused = before.state[:, -1], before.covariance, before.refused.copy()
    for k in range(1 if before is None else 0, fixes.shape[1]):
        state = (move @ state[..., None])[..., 0]
        spread = move @ spread @ move.T + noise
        # A fix that is not valid has no weight: its gain is set to zero.
        weight = np.linalg.inv(spread[:, :4, :4] + covariances[:, k])
        weight[missing[:, k]] = 0.0
        surprise = (fixes[:, k] - state[:, :4])[..., None]
        innovations[:, k] = (surprise.transpose(0, 2, 1) @ (weight @ surprise))[:, 0, 0]
        outlier = innovations[:, k] > settings.gate
        refused = np.where(outlier, refused + 1, np.where(missing[:, k], refused, 0))
        weight[outlier] = 0.0
        gain = spread[:, :, :4] @ weight
        state = state + (gain @ surprise)[..., 0]
        spread = spread - gain @ spread[:, :4]
        # Without this, rounding makes the covariance drift from symmetry, and the filter from its reference.
        spread = (spread + spread.transpose(0, 2, 1)) / 2
        lost = refused > settings.reacquire_s / step_s
        if lost.any():
            state[lost], spread[lost] = start(fixes[lost, k], covariances[lost, k], settings)
            refused[lost] = 0
        states[:, k] = state
    return Tracks(states, spread, innovations, refused)
