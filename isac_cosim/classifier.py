"""`isac_cosim.IntentionClassifier`: the predictors of this tool behind `fit` and `predict_proba`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Self

import numpy as np
from sklearn.base import BaseEstimator

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import SILENT
from isac_cosim.base.temporary import TemporaryFolder
from isac_cosim.base.workers.threads import limited
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models import FLOOR
from isac_cosim.models.data.labelled_windows import LabelledWindows
from isac_cosim.models.data.windows import Windows, lengths
from isac_cosim.models.predictors.protocol import FitTask, Predictor, WindowShape
from isac_cosim.models.predictors.registry import PREDICTORS
from isac_cosim.models.runs.settings import TrainSettings


class IntentionClassifier(BaseEstimator):  # type: ignore[misc]  # scikit-learn has no types
    """A predictor in the manner of scikit-learn, fitted as `cosim train` fits it.

    model: its name, as in `cosim train --model`. `classes_`: numbers of the intentions, in the order of the columns of
    `predict_proba`.
    """

    def __init__(self, model: str = FLOOR) -> None:
        self.model = model

    def fit(self, windows: LabelledWindows, y: None = None) -> Self:
        """Fit the predictor to the records of the training windows.

        Each predictor draws from them the windows that it learns from, in the same ranges; networks choose their best
        epoch on the validation side. y: not used, the windows have labels.
        Raises InputError for an unknown model, an optional package that is missing, or windows of another side.
        """
        if windows.side != "train":
            raise InputError(f'windows are of the {windows.side} side: fit to windows(split="train")')
        kind = PREDICTORS[self.model]
        kind.check_requirements()
        assert isinstance(windows.settings, TrainSettings)
        settings, records = windows.settings.for_predictor(self.model), windows.records
        shape = WindowShape(len(KNOWN), *lengths(records, settings.windows), records.tv_rate_hz, records.uv_rate_hz)
        with TemporaryFolder() as folder, limited(settings.optimiser.threads):
            predictor = kind.fit(FitTask(records, windows.validation, settings, shape, folder.path), SILENT)
        self.classes_ = np.array(KNOWN, dtype=np.int64)
        self._fitted = predictor, settings
        return self

    @property
    def fitted(self) -> tuple[Predictor, TrainSettings]:
        """The predictor, and the settings that it was fitted with. Raises InputError before `fit`."""
        if not hasattr(self, "_fitted"):
            raise InputError(f"{self.model} is not fitted: call fit() first")
        return self._fitted

    def predict_proba(self, windows: LabelledWindows | tuple[Any, Any]) -> Array:
        """Return the probability of each intention, (n, G).

        windows: those of a dataset, or arrays tv (n, 6, T) and uv (n, 6, U) in the same frame; predictors that look at
        lanes need the former. Raises InputError before `fit`.
        """
        predictor, _ = self.fitted
        parts: Iterable[Windows] = windows.batches() if isinstance(windows, LabelledWindows) else [_given(*windows)]
        return np.concatenate([predictor(part).probabilities for part in parts])

    def predict(self, windows: LabelledWindows | tuple[Any, Any]) -> IntArray:
        """Return the number of the likeliest intention of each window, (n,)."""
        return np.asarray(self.classes_[self.predict_proba(windows).argmax(axis=1)])


def _given(tv: Any, uv: Any) -> Windows:
    return Windows(np.asarray(tv, np.float32), np.asarray(uv, np.float32))
