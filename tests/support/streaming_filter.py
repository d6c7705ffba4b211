"""The filter of `isacsim.tracking.kalman` for one vehicle, fix by fix as they come in, on filterpy: its reference.

It has the model, the gate and the restart of the batched filter.
"""

from __future__ import annotations

import numpy as np
from filterpy.kalman import KalmanFilter

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.tracking.kalman import TrackingSettings, process_noise, start, transition


class StreamingFilter:
    """Six-state constant-acceleration Kalman filter over the fixes of one vehicle.

    step_s: time between calls of `step`, s. state: x, y, vx, vy, ax, ay after the latest step, m, m/s, m/s2, (6,).
    covariance: of the state, (6, 6). Both are None until the first fix.
    """

    def __init__(self, step_s: float, settings: TrackingSettings | None = None) -> None:
        self.settings = settings or TrackingSettings()
        self.state: Array | None = None
        self.covariance: Array | None = None
        self._reacquire_steps = self.settings.reacquire_s / step_s
        self._refused = 0
        self._kalman = KalmanFilter(dim_x=6, dim_z=4)
        self._kalman.F, self._kalman.H = transition(step_s), np.eye(4, 6)
        self._kalman.Q = process_noise(step_s, self.settings.jerk_density)

    def step(self, fix: Array | None, covariance: Array | None = None) -> Array | None:
        """Advance by one time step, and use the fix that came in, if any.

        fix: x, y, vx, vy, (4,). covariance: of the fix, (4, 4). A fix whose normalised innovation squared exceeds the
        settings' gate is not used; after `reacquire_s` of nothing but such fixes the filter starts anew.
        Returns the state after the step, (6,), or None if there has been no fix yet.
        """
        if self.state is None:
            if fix is not None and covariance is not None:
                self._start(fix, covariance)
            return self.state
        self._kalman.predict()
        if fix is not None and covariance is not None:
            self._use(fix, covariance)
        self.state, self.covariance = self._kalman.x.copy(), self._kalman.P.copy()
        return self.state

    def _use(self, fix: Array, covariance: Array) -> None:
        surprise = fix - self._kalman.x[:4]
        spread = self._kalman.P[:4, :4] + covariance
        if surprise @ np.linalg.solve(spread, surprise) <= self.settings.gate:
            self._refused = 0
            self._kalman.update(fix, R=covariance)
            return
        self._refused += 1
        if self._refused > self._reacquire_steps:
            self._start(fix, covariance)

    def _start(self, fix: Array, covariance: Array) -> None:
        state, spread = start(fix[None], covariance[None], self.settings)
        self._kalman.x, self._kalman.P = state[0], spread[0]
        self._refused = 0
        self.state, self.covariance = state[0].copy(), spread[0].copy()
