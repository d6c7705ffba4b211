"""Pre-onset windows: windows that end before the onset of their record's maneuver, and so show mere driving."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from isac_cosim.base.setting_fields import WindowEnds
from isac_cosim.models.data.windows import Records, WindowSettings, end_bounds
from isac_cosim.models.trees.boosting import BoostingSettings


class PreOnsetSettings(BoostingSettings):
    """Where pre-onset windows end, and the trees of the reject option that learn to recognise them."""

    use: bool = Field(True, description="train the reject option; it then is one of the unknown scores to choose from")
    end_after_onset_s: WindowEnds = Field(
        (-0.6, -0.1),
        description="range of the ends of pre-onset windows relative to onset, s; negative is before onset",
    )
    ends_per_record: int = Field(
        2, ge=1, le=10_000, description="pre-onset windows per record, and as many windows of the maneuver"
    )
    rounds: int = Field(150, ge=1, le=100_000, description="boosting rounds")

    @model_validator(mode="after")
    def _before_onset(self) -> Self:
        early, late = self.end_after_onset_s
        if not early <= late <= 0:
            raise ValueError(f"end_after_onset_s {self.end_after_onset_s}: give the earlier end first, both at most 0")
        return self


def pre_onset_windows(windows: WindowSettings, settings: PreOnsetSettings) -> WindowSettings:
    """Return the window settings of a training, moved to before onset."""
    moved = {"relative_to": "onset", "end_after_s": settings.end_after_onset_s}
    return WindowSettings.model_validate({**windows.model_dump(), **moved})


def has_pre_onset_windows(records: Records, windows: WindowSettings, settings: PreOnsetSettings) -> bool:
    """Return whether any record reaches far enough back to hold a pre-onset window."""
    first, last = end_bounds(records, pre_onset_windows(windows, settings))
    return bool((last >= first).any())
