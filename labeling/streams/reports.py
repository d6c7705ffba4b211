"""The reports of UVs, as windows of a stream take them."""

from __future__ import annotations

from functools import lru_cache
from typing import Protocol

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.sensing.reports import report
from isac_cosim.labeling.streams.sensed import StretchSensing

REPORTS_KEPT = 128
"""Vehicles whose reports stay in memory: a vehicle is often the UV of several TVs in turn."""


class Reports:
    """The reports of the vehicles of a recording, at the rate and with the noise of the study.

    A vehicle has a single stream of reports, whichever TV it is the UV of.
    """

    def __init__(self, sensing: StretchSensing) -> None:
        self._sensing = sensing
        self._of = lru_cache(maxsize=REPORTS_KEPT)(self._stream)

    def window(self, vehicle: str, end_s: float, length: int) -> Array:
        """Return the last `length` reports of a vehicle up to a time (s), (6, length).

        Raises ValueError if the vehicle has not reported throughout.
        """
        first, states = self._of(vehicle)
        last = round(end_s * self._sensing.study.record.uv_rate_hz) - first
        if last + 1 < length or last >= states.shape[1]:
            raise ValueError(f"vehicle {vehicle} has not reported throughout the window that ends at {end_s:.3f} s")
        return states[:, last + 1 - length : last + 1]

    def _stream(self, vehicle: str) -> tuple[int, Array]:
        """Return the number of a vehicle's first report, in intervals since time 0, and all its reports, (6, n)."""
        recording, study = self._sensing.recording, self._sensing.study
        track, rate_hz = recording.tracks[vehicle], study.record.uv_rate_hz
        first_s, last_s = track.first_step * recording.step_s, (track.first_step + len(track) - 1) * recording.step_s
        first, last = int(np.ceil(first_s * rate_hz - 1e-6)), int(np.floor(last_s * rate_hz + 1e-6))
        states = self._sensing.motion_of(vehicle, first / rate_hz, last - first + 1, rate_hz)
        key = ("live", recording.scenario, recording.seed, vehicle)
        return first, report(states, study.report, key)


class ReportWindows(Protocol):
    """A source of the UV's part of a window."""

    def window(self, vehicle: str, end_s: float, length: int) -> Array:
        """Return the last `length` reports of a vehicle up to a time (s), (6, length)."""


class NoReports:
    """Stands for a missing UV: it rests at the origin, so that the axes of a window follow the TV's travel."""

    def window(self, vehicle: str, end_s: float, length: int) -> Array:
        return np.zeros((6, length))
