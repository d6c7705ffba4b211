"""Which windows a predictor is measured on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from isac_cosim.base.setting_fields import Seed, WindowEnds
from isac_cosim.base.settings import Settings


class WindowEndCurveSettings(Settings):
    """Fixed window ends at which a predictor is measured, one after the other."""

    relative_to: Literal["onset", "commit"] = Field("onset", description="instant from which the ends are counted")
    first_s: float = Field(-0.5, ge=-1e3, le=1e3, description="first end after that instant, s; negative is before it")
    last_s: float = Field(2.2, ge=-1e3, le=1e3, description="no end is later than this, s")
    step_s: float = Field(0.2, ge=0.001, le=1e3, description="time between ends, s")

    @property
    def ends_s(self) -> list[float]:
        """The window ends, s after the instant `relative_to`."""
        count = int(np.floor((self.last_s - self.first_s) / self.step_s + 1e-6)) + 1
        return [round(self.first_s + k * self.step_s, 6) for k in range(count)]


class EvaluateSettings(Settings):
    """Which windows a predictor is measured on."""

    ends_per_record: int = Field(4, ge=1, le=10_000, description="fixed windows of each record")
    leads_s: tuple[Annotated[float, Field(gt=0, le=1e3)], ...] = Field(
        (0.25, 0.5, 1.0, 1.5, 2.0), description="measure windows that end at exactly these times before the commit, s"
    )
    seed: Seed = Field(0, description="seed of the window ends")
    end_after_s: WindowEnds | None = Field(
        None, description="range of window ends, s; when absent, the range used in training"
    )
    window_end_curve: WindowEndCurveSettings | None = Field(
        None, description="measure at fixed window ends as well, if given"
    )

    @model_validator(mode="before")
    @classmethod
    def _accept_former_key(cls, content: object) -> object:
        return with_current_key(content)


def with_current_key(content: object) -> object:
    """Rename the key `sweep`, the former name of `window_end_curve`, in settings given as plain values.

    Study files and results written under the former name stay readable. Anything else is returned unchanged.
    """
    if not isinstance(content, Mapping) or "sweep" not in content or "window_end_curve" in content:
        return content
    return {"window_end_curve" if key == "sweep" else key: value for key, value in content.items()}
