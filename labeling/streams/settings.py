"""How vehicles are watched throughout, and what of it is stored."""

from __future__ import annotations

from math import ceil
from typing import Self

from pydantic import Field

from isac_cosim.base.settings import Settings
from isac_cosim.labeling.detectors.near_misses import NearMissSettings


def _whole(seconds: float, *rates_hz: float) -> float:
    """Return the shortest time, s, not shorter than `seconds`, that is a whole number of samples at all rates.

    That is `seconds` itself where no such time is near.
    """
    slowest = min(rates_hz)
    first = ceil(seconds * slowest - 1e-6)
    times = (k / slowest for k in range(first, first + 100))
    return next((t for t in times if all(abs(t * rate - round(t * rate)) < 1e-6 for rate in rates_hz)), seconds)


class StretchSettings(Settings):
    """When a vehicle is watched."""

    decision_s: float = Field(0.1, gt=0.0, le=2.0, description="time between two predictions for a vehicle, s")
    report_delay_s: float = Field(
        0.02,
        ge=0.0,
        le=2.0,
        description="age of a UV's newest report at the end of a window, s",
    )
    outcome_s: float = Field(
        6.0,
        ge=0.0,
        le=1e5,
        description="no prediction is made this close to the end of a vehicle's track, s: whether an alarm is right "
        "would not be known",
    )
    longest_stretch_s: float = Field(
        120.0,
        ge=10.0,
        le=1e5,
        description="longest stretch that is sensed without acquiring the vehicle anew, s; limits the use of memory",
    )

    def fitting(self, tv_rate_hz: float, uv_rate_hz: float) -> Self:
        """Return these settings with times that are whole numbers of samples, as little longer as possible."""
        return self.model_copy(
            update={
                "decision_s": _whole(self.decision_s, tv_rate_hz, uv_rate_hz),
                "report_delay_s": _whole(self.report_delay_s, uv_rate_hz),
            }
        )


class StreamDatasetSettings(Settings):
    """What a dataset of streams holds.

    stretches: when a vehicle is watched. window_s: length of the windows that can be cut at every decision, s.
    near_misses: which motions just under a threshold are among the events.
    """

    stretches: StretchSettings = StretchSettings()
    window_s: float = Field(2.2, gt=0.0, le=60.0, description="length of the windows that can be cut, s")
    near_misses: NearMissSettings = NearMissSettings()
