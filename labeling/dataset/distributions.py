"""How the events of a dataset look: durations, leads, peak accelerations, and on how many seeds each class stands."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import numpy.typing as npt

from labeling.dataset.dataset import Dataset
from labeling.intentions import Intention

QUARTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
SEEDS_TO_SPLIT = 5
"""With fewer seeds a class cannot be on every side of a split of 60, 20 and 20 % of the seeds."""


def distributions(dataset: Dataset) -> dict[str, dict[str, Any]]:
    """Per intention: samples by scenario and by seed, seeds, and quantiles (5, 25, 50, 75, 95 %) over its samples.

    duration_s: onset to end. lead_s: onset to commit. peak_along_mps2, peak_across_mps2: of the true acceleration along
    and across the driving direction from onset to the record's end, the value of largest size with its sign (left and
    forward are positive).
    """
    frame = dataset.frame(["intention", "scenario", "seed", "t_start", "t_onset", "t_commit", "t_end"])
    frame["duration_s"] = frame["t_end"] - frame["t_onset"]
    frame["lead_s"] = frame["t_commit"] - frame["t_onset"]
    since_start = ((frame["t_onset"] - frame["t_start"]) * dataset.meta.tv_rate_hz).to_numpy(np.float64)
    onset_row = np.rint(since_start).astype(np.int64)
    peaks = np.empty((2, len(frame)))
    start = 0
    # A shard at a time: all of them may be more than memory holds.
    for part in dataset.arrays_by_shard("tv_truth"):
        rows = slice(start, start + len(part["tv_truth"]))
        peaks[:, rows] = _peaks(part["tv_truth"], onset_row[rows])
        start = rows.stop
    frame["peak_along_mps2"], frame["peak_across_mps2"] = peaks
    measured = ["duration_s", "lead_s", "peak_along_mps2", "peak_across_mps2"]
    found = {}
    for intention in Intention:
        mine = frame[frame["intention"] == intention.text]
        by_seed = Counter(map("{}-{}".format, mine["scenario"], mine["seed"]))
        found[intention.text] = {
            "by_scenario": {str(name): int(n) for name, n in mine.groupby("scenario").size().items()},
            "by_seed": dict(by_seed),
            "seeds": len(by_seed),
            **{name: _quantiles(mine[name].to_numpy(np.float64)) for name in measured},
        }
    return found


def too_few_seeds(found: dict[str, dict[str, Any]]) -> list[str]:
    """The intentions that stand on too few seeds for every side of a split to have them."""
    return [name for name, each in found.items() if 0 < each["seeds"] < SEEDS_TO_SPLIT]


def _peaks(
    truth: npt.NDArray[np.float32], onset_row: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Acceleration of largest size along and across the velocity after onset, of (N, 6, S) states; (N,) each."""
    vx, vy, ax, ay = truth[:, 2:].transpose(1, 0, 2)
    speed = np.maximum(np.hypot(vx, vy), 0.1)
    after = np.arange(truth.shape[2]) >= onset_row[:, None]
    found = []
    for component in ((ax * vx + ay * vy) / speed, (ay * vx - ax * vy) / speed):
        largest = np.abs(component * after).argmax(axis=1)
        found.append(np.take_along_axis(component, largest[:, None], axis=1)[:, 0].astype(np.float64))
    return found[0], found[1]


def _quantiles(values: npt.NDArray[np.float64]) -> list[float] | None:
    """The quantiles, rounded; None of nothing."""
    return [round(float(q), 3) for q in np.quantile(values, QUARTILES)] if len(values) else None
