"""How far the seeds of a dataset depend on each other.

A demand that names every vehicle with its departure and route puts the same vehicles into every seed. What a predictor
then meets in a test seed it has partly been trained on, and its scores say little about other traffic.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.base.settings import Settings
from isac_cosim.labeling.dataset.record_point import in_plane

if TYPE_CHECKING:
    from isac_cosim.labeling.dataset.dataset import Dataset

SAME_DEPARTURE_S = 0.001
"""Departures of one vehicle agree within this, s. A flow that draws them gives the k-th vehicle of two seeds about the
same departure now and then; with 1 s, that would count up to one vehicle in ten."""
COPY_M = 2.0
"""Paths within this, root mean square, are near copies, m."""
COPY_S = 2.0
"""So are only records whose onsets lie within this of each other, s: on one road, any two vehicles drive one path."""
RATE_HZ = 20.0
"""Rate at which paths are compared, Hz."""
MARK = 0.02
"""A larger share of samples that are not independent is marked."""
COLUMNS = ["scenario", "seed", "label", "tv_id", "tv_departed", "t_start", "t_onset"]


class Dependence(Settings):
    """How many of some samples have a twin among the samples of other seeds.

    samples: how many there are. shared_tv: those whose TV, by id and departure, is the TV of a sample there; None where
    the dataset does not say when vehicles departed. near_copies: those of which a sample of the same label there drives
    the same path, within 2 m root mean square, at the same time, within 2 s. shared_tvs: number of the vehicles.
    """

    samples: int
    shared_tv: int | None
    shared_tvs: int | None
    near_copies: int

    @property
    def marked(self) -> bool:
        """Whether the share of samples that are not independent is worth a warning."""
        return max(self.shared_tv or 0, self.near_copies) > MARK * self.samples

    def sentence(self, samples: str, elsewhere: str) -> str:
        """Return the shares in words: `samples` have a TV that is also `elsewhere`, and so many near copies there."""
        copies = f"{self.near_copies / max(self.samples, 1):.0%} are near copies (same label, within {COPY_M:g} m)"
        if self.shared_tv is None:
            return f"of {self.samples} {samples}, {copies} of a record that is {elsewhere}"
        return f"{self.shared_tv} of {self.samples} {samples} have a TV that is also {elsewhere}; {copies}"


HELP = "draw departures anew with --demand drawn (dataset.traffic.demand), or split by vehicle (training.split.by)"
"""What helps."""


@dataclass(frozen=True)
class Driven:
    """What the TVs of a dataset drove: a row for each sample, with COLUMNS, and the paths, (N, 2 P), m.

    A path has its place at P instants relative to the onset, the same for all samples.
    """

    table: pd.DataFrame
    paths: Array

    @classmethod
    def of(cls, dataset: Dataset) -> Self:
        """Read the true motion of a dataset. Raises InputError where a shard is damaged."""
        table = dataset.frame([*COLUMNS, "x0", "y0"])
        if not len(table):
            return cls(table, np.empty((0, 2)))
        rate_hz, length = dataset.meta.tv_rate_hz, dataset.meta.tv_length
        lead_s = (table["t_onset"] - table["t_start"]).to_numpy(np.float64)
        first, last = -lead_s.min(), (length - 1) / rate_hz - lead_s.max()
        instants = np.linspace(first, max(first, last), max(2, round((last - first) * RATE_HZ)))
        steps = np.clip(np.rint((lead_s[:, None] + instants) * rate_hz).astype(np.int64), 0, length - 1)
        paths, start = np.empty((len(table), 2 * len(instants))), 0
        # One shard at a time: all of them may exceed the memory.
        for shard in dataset.arrays_by_shard("tv_truth"):
            rows = slice(start, start + len(shard["tv_truth"]))
            states = np.take_along_axis(shard["tv_truth"][:, :2], steps[rows, None, :], axis=2)
            placed = in_plane(states, table["x0"].to_numpy()[rows], table["y0"].to_numpy()[rows])
            paths[rows] = placed.reshape(paths[rows].shape)  # of a shard without samples, too
            start = rows.stop
        return cls(table, paths)

    @property
    def groups(self) -> Array:
        """`<scenario>-<seed>` of each sample, (N,)."""
        return np.asarray(self.table["scenario"].astype(str) + "-" + self.table["seed"].astype(str))

    def between_seeds(self) -> Dependence:
        """Return how many samples have a twin in another seed of the dataset."""
        everything = np.ones(len(self.table), bool)
        return self.between(everything, everything)

    def between(self, asked: BoolArray, others: BoolArray) -> Dependence:
        """Return how many of the samples asked, (N,), have a twin among others, (N,), of other seeds."""
        vehicle, known = vehicles(self.table), self.table["tv_departed"].notna().to_numpy()
        seed = self.table["seed"].to_numpy()
        shared = np.zeros(len(self.table), bool)
        elsewhere = pd.DataFrame({"vehicle": vehicle, "seed": seed})[others & known].groupby("vehicle")["seed"]
        only, number = elsewhere.first().to_dict(), elsewhere.nunique().to_dict()
        for k in np.flatnonzero(asked & known):
            met = number.get(vehicle[k], 0)
            shared[k] = met > 1 or (met == 1 and only[vehicle[k]] != seed[k])
        copied = np.zeros(len(self.table), bool)
        for a, b in self._copies():
            copied[a] |= asked[a] & others[b]
            copied[b] |= asked[b] & others[a]
        says = bool(known[asked].any())
        return Dependence(
            samples=int(asked.sum()),
            shared_tv=int(shared.sum()) if says else None,
            shared_tvs=len(set(vehicle[shared].tolist())) if says else None,
            near_copies=int(copied.sum()),
        )

    def _copies(self) -> Iterator[tuple[int, int]]:
        """Yield the pairs of samples of different seeds that are near copies of each other."""
        onset, seed = self.table["t_onset"].to_numpy(np.float64), self.table["seed"].to_numpy()
        if not len(self.paths):
            return
        centre = self.paths.reshape(len(self.paths), 2, -1).mean(axis=2)
        for indices in self.table.groupby(["scenario", "label"]).indices.values():
            rows = np.asarray(indices, np.int64)
            # Centres of paths are no further apart than the paths, root mean square.
            pairs: IntArray = rows[cKDTree(centre[rows]).query_pairs(COPY_M, output_type="ndarray")]
            pairs = pairs[np.abs(np.diff(onset[pairs], axis=1)[:, 0]) <= COPY_S]
            pairs = pairs[seed[pairs[:, 0]] != seed[pairs[:, 1]]]
            for a, b in pairs.tolist():
                apart = (self.paths[a] - self.paths[b]) ** 2
                if 2.0 * apart.mean() <= COPY_M**2:
                    yield a, b


def vehicles(table: pd.DataFrame) -> IntArray:
    """Return a number for the TV of each sample, (N,): the same where scenario, id and departure agree.

    table: with COLUMNS.
    """
    departed = np.rint(table["tv_departed"].to_numpy(np.float64) / SAME_DEPARTURE_S)
    keys = table[["scenario", "tv_id"]].assign(departed=departed)
    return np.asarray(keys.groupby(["scenario", "tv_id", "departed"], dropna=False).ngroup(), np.int64)
