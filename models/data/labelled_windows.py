"""Windows with their labels, one by one, as PyTorch takes them: those that a training sees, and those of a test."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from torch import Tensor
from torch.utils.data import Dataset

from isac_cosim.base.arrays import Float32Array, IntArray
from isac_cosim.base.seeding import stream
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.windows import Ends, Records, Windows, batches, cut, draw_ends

TOGETHER = 256
"""Windows that are cut at a time."""


def epoch_ends(training: Records, settings: FitSettings, epoch: int) -> Ends:
    """Return the ends of the windows of an epoch, counted from 0, shuffled. training: records of the training side."""
    ends = draw_ends(training, settings.windows, "train", settings.seed, epoch, per_record=settings.ends_per_record)
    return ends[stream("shuffle", settings.seed, epoch).permutation(len(ends))]


def validation_ends(validation: Records, settings: FitSettings) -> Ends:
    """Return the ends of the windows on which epochs are compared. validation: records of the validation side."""
    return draw_ends(validation, settings.windows, "validation", settings.seed, per_record=settings.validation_ends)


@dataclass(frozen=True, repr=False)
class LabelledWindows(Dataset[tuple[Tensor, Tensor, int]]):
    """Windows with their labels, a map-style dataset of PyTorch: `len`, and item k is (tv, uv, label).

    tv: float32 (6, T) and uv: (6, U), states as sensed and as reported, in the frame of the settings. label: number of
    the intention, 0 to 5, and 6 for `following`.

    side: of the split, "train", "validation" or "test". records: those of that side. ends: of the windows, in order.
    settings: what decides on the split, the frame and the ends. validation: records of the validation side, on which
    networks that are fitted to these windows choose their best epoch.
    """

    side: str
    records: Records
    ends: Ends
    settings: FitSettings
    validation: Records

    def __len__(self) -> int:
        return len(self.ends)

    def __repr__(self) -> str:
        return f"<LabelledWindows: {len(self)} of {len(self.records)} records, {self.side}>"

    def __getitem__(self, k: int) -> tuple[Tensor, Tensor, int]:
        if not -len(self) <= k < len(self):
            raise IndexError(f"there are {len(self)} windows")
        one = Ends(self.ends.row[[k]], self.ends.step[[k]])
        windows = cut(self.records, one, self.settings.windows)
        return torch.from_numpy(windows.tv[0]), torch.from_numpy(windows.uv[0]), int(self.labels[k])

    @property
    def labels(self) -> IntArray:
        """Number of the intention of each window, (n,)."""
        return self.records.label[self.ends.row]

    @property
    def groups(self) -> np.ndarray[tuple[int], np.dtype[np.object_]]:
        """Episode of each window, `SCENARIO-SEED`, (n,): cross-validate by these, never by window."""
        return self.records.groups[self.ends.row]

    def batches(self) -> Iterator[Windows]:
        """Cut the windows in order, TOGETHER at a time, as predictors take them."""
        return batches(self.records, self.ends, self.settings.windows, TOGETHER)

    def arrays(self) -> tuple[Float32Array, Float32Array, IntArray]:
        """Return all windows at once: tv (n, 6, T), uv (n, 6, U), labels (n,)."""
        parts = list(self.batches())
        return np.concatenate([part.tv for part in parts]), np.concatenate([part.uv for part in parts]), self.labels

    def table(self) -> pd.DataFrame:
        """Return a row a window: the sample that it is cut from, when it ends and how long before the commit, s."""
        table = self.records.table.iloc[self.ends.row].reset_index(drop=True)
        end_s = self.ends.times(self.records)
        return table.assign(t_window_end=end_s, lead_s=table["t_commit"] - end_s)
