"""A reject option that never sees the unknown class: trees that know a record's own prelude.

Windows that end before a record's onset show a vehicle that merely drives. Trees learn to tell them from the training
windows by the predictor's features, and so give a score of how much a window looks like a maneuver at all. No sample of
`following` takes part; that it merely drives, too, is for the evaluation to find out.
"""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import Field, model_validator
from sklearn.ensemble import HistGradientBoostingClassifier

from isacsim.arrays import Float32Array
from isacsim.settings import Settings
from models.data.windows import Records, WindowSettings, end_bounds


class PreludeSettings(Settings):
    """Which windows are preludes, and the trees that learn them."""

    use: bool = Field(True, description="learn the reject option, which then is one of the scores to choose among")
    end_after_onset_s: tuple[float, float] = Field(
        (-0.6, -0.1), description="range of the preludes' ends, s; negative is before onset"
    )
    ends_per_record: int = Field(2, ge=1, description="preludes, and as many training windows, of each record")
    rounds: int = Field(150, ge=1, description="boosting rounds")
    learning_rate: float = Field(0.1, gt=0, description="shrinkage of a round")
    leaves: int = Field(15, ge=2, description="leaves of a tree")
    l2: float = Field(1.0, ge=0, description="L2 regularisation of leaf values")

    @model_validator(mode="after")
    def _before_onset(self) -> Self:
        early, late = self.end_after_onset_s
        if not early <= late <= 0:
            raise ValueError(f"end_after_onset_s {self.end_after_onset_s}: give the earlier end first, both at most 0")
        return self


def prelude_windows(windows: WindowSettings, settings: PreludeSettings) -> WindowSettings:
    """The windows of a training, moved before onset."""
    moved = {"relative_to": "onset", "end_after_s": settings.end_after_onset_s}
    return WindowSettings.model_validate({**windows.model_dump(), **moved})


def holds_preludes(records: Records, windows: WindowSettings, settings: PreludeSettings) -> bool:
    """Whether any record reaches far enough back for a prelude."""
    first, last = end_bounds(records, prelude_windows(windows, settings))
    return bool((last >= first).any())


def fit_preludes(
    maneuvers: Float32Array, preludes: Float32Array, settings: PreludeSettings, seed: int
) -> HistGradientBoostingClassifier:
    """Trees that tell features of training windows (n, F), class 1, from those of preludes (m, F), class 0."""
    trees = HistGradientBoostingClassifier(
        max_iter=settings.rounds, learning_rate=settings.learning_rate, max_leaf_nodes=settings.leaves,
        l2_regularization=settings.l2, class_weight="balanced", early_stopping=False, random_state=seed,
    )  # fmt: skip
    label = np.repeat([1, 0], [len(maneuvers), len(preludes)])
    return trees.fit(np.concatenate([maneuvers, preludes]), label)
