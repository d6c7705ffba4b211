"""Windows of pull-outs: whether the TV passes the UV soon after them, and for which of them that is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
import numpy.typing as npt
import pandas as pd

from isacsim.arrays import Array, BoolArray
from labeling.dataset.pull_outs import dropped_pull_outs
from models.data.windows import Ends, Records, WindowSettings, draw_ends, end_bounds

if TYPE_CHECKING:
    from labeling.dataset.dataset import Dataset

COLUMNS = ("sample_id", "pull_out", "t_pass", "t_pair_end")
"""The scalar columns of a dataset that are read of pull-outs."""
TOLERANCE_S = 1e-6
"""Times that differ by less are equal but for rounding, s."""


@dataclass(frozen=True)
class PullOuts:
    """The pull-outs of a dataset.

    table: one row for each, by its sample id, with the other COLUMNS. dropped: the records of those that are in no
    class.
    """

    table: pd.DataFrame
    dropped: Records

    @classmethod
    def of(cls, dataset: Dataset, sensed: Literal["tv", "tv_truth"] = "tv") -> Self | None:
        """Return the pull-outs of a dataset, or None if it has none or does not say when they pass.

        Also None if its study keeps no dropped pull-outs: the others are chosen by what became of them.
        sensed: the column that gives the TV's states.
        """
        if dataset.meta.study.get("selection", {}).get("pull_outs") == 0:
            return None
        dropped = dropped_pull_outs(dataset)
        table = pd.concat([part.frame(COLUMNS) for part in (dataset, dropped)], ignore_index=True)
        table = table[table["pull_out"] != ""].set_index("sample_id")
        if not len(table):
            return None
        return cls(table, Records.of(dropped, sensed))

    def among(self, sample_id: npt.NDArray[np.object_]) -> BoolArray:
        """Return which of some samples are pull-outs, a mask (n,)."""
        return np.asarray(pd.Index(sample_id).isin(self.table.index))

    def parts(self, records: Records, groups: list[str]) -> list[Records]:
        """Return the records of all pull-outs of some scenario seeds: those that are samples, then the dropped ones.

        records: of the dataset's samples.
        """
        sampled = self.among(records.table["sample_id"].to_numpy(dtype=object)) & np.isin(records.groups, groups)
        return [records.take(sampled), self.dropped.take(np.isin(self.dropped.groups, groups))]


@dataclass(frozen=True)
class PassWindows:
    """Windows of pull-outs, each array (n,).

    passes_after_s: how long after the end of the window the TV passes the UV, s; NaN if that is not observed.
    observed_s: how long after the end of the window the pair is observed, s.
    """

    sample_id: npt.NDArray[np.object_]
    group: npt.NDArray[np.object_]
    outcome: npt.NDArray[np.object_]
    passes_after_s: Array
    observed_s: Array

    @classmethod
    def of(
        cls, pull_outs: PullOuts, sample_id: npt.NDArray[np.object_], group: npt.NDArray[np.object_], end_s: Array
    ) -> Self:
        """Return the windows of some pull-outs, given by sample and scenario seed; end_s: ends of the windows, s."""
        rows = pull_outs.table.loc[pd.Index(sample_id)]
        times = {name: rows[name].to_numpy(dtype=np.float64) - end_s for name in ("t_pass", "t_pair_end")}
        outcome = rows["pull_out"].to_numpy(dtype=object)
        return cls(sample_id, group, outcome, times["t_pass"], times["t_pair_end"])

    def __len__(self) -> int:
        return len(self.sample_id)

    @property
    def already_passed(self) -> BoolArray:
        """Windows at whose end the TV has passed the UV, which ask nothing, a mask (n,)."""
        return np.asarray(self.passes_after_s <= TOLERANCE_S)

    def censored(self, within_s: float) -> BoolArray:
        """Return the windows after which the pair is not observed for that long, s, a mask (n,).

        This does not depend on whether the TV passes: otherwise, shortly before the end of a recording only pull-outs
        that pass would count.
        """
        return np.asarray(~self.already_passed & (self.observed_s < within_s - TOLERANCE_S))

    def asked(self, within_s: float) -> BoolArray:
        """Return the windows for which it is known whether the TV passes within that time, s, a mask (n,)."""
        return np.asarray(~self.already_passed & ~self.censored(within_s))

    def passes(self, within_s: float) -> BoolArray:
        """Return whether the TV passes within that time after the end of each window, s, (n,); False if unknown."""
        return np.asarray(~self.already_passed & (self.passes_after_s <= within_s + TOLERANCE_S))


def ends_of(records: Records, windows: WindowSettings, seed: int, per_record: int) -> Ends:
    """Return the window ends that the evaluation draws from some records; none if no record holds such a window."""
    first, last = end_bounds(records, windows)
    if not (last >= first).any():
        return Ends(np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64))
    return draw_ends(records, windows, "evaluate", seed, per_record=per_record)
