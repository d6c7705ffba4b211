"""Distributions of a dataset's events: durations, lead times, peak accelerations, and the number of seeds per class."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import numpy.typing as npt

from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.intentions import Intention

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
SEEDS_TO_SPLIT = 5
"""With fewer seeds a class cannot be on every side of a split of 60, 20 and 20 % of the seeds."""


def distributions(dataset: Dataset) -> dict[str, dict[str, Any]]:
    """Return for each intention its samples by scenario and by seed, and quantiles (5, 25, 50, 75, 95 %) over them.

    Keys `by_scenario` and `by_seed` (number of samples), `seeds` (their number), and the quantiles of:
    duration_s: from onset to end. lead_s: from onset to commit. peak_along_mps2, peak_across_mps2: the true
    acceleration of largest magnitude from onset to the end of the record, along and across the driving direction, with
    its sign (forward and left positive). The quantiles of an intention without samples are None.
    """
    frame = dataset.frame(["intention", "scenario", "seed", "t_start", "t_onset", "t_commit", "t_end"])
    frame["duration_s"] = frame["t_end"] - frame["t_onset"]
    frame["lead_s"] = frame["t_commit"] - frame["t_onset"]
    since_start = ((frame["t_onset"] - frame["t_start"]) * dataset.meta.tv_rate_hz).to_numpy(np.float64)
    onset_row = np.rint(since_start).astype(np.int64)
    peaks = np.empty((2, len(frame)))
    start = 0
    # One shard at a time: all of them may exceed the memory.
    for shard in dataset.arrays_by_shard("tv_truth"):
        rows = slice(start, start + len(shard["tv_truth"]))
        peaks[:, rows] = _peaks(shard["tv_truth"], onset_row[rows])
        start = rows.stop
    frame["peak_along_mps2"], frame["peak_across_mps2"] = peaks
    measured = ["duration_s", "lead_s", "peak_along_mps2", "peak_across_mps2"]
    result = {}
    for intention in Intention:
        samples = frame[frame["intention"] == intention.text]
        by_seed = Counter(map("{}-{}".format, samples["scenario"], samples["seed"]))
        result[intention.text] = {
            "by_scenario": {str(name): int(n) for name, n in samples.groupby("scenario").size().items()},
            "by_seed": dict(by_seed),
            "seeds": len(by_seed),
            **{name: _quantiles(samples[name].to_numpy(np.float64)) for name in measured},
        }
    return result


def too_few_seeds(by_intention: dict[str, dict[str, Any]]) -> list[str]:
    """Return the intentions with samples from too few seeds for every side of a split.

    by_intention: as from `distributions`; of each intention `seeds` is read.
    """
    return [name for name, content in by_intention.items() if 0 < content["seeds"] < SEEDS_TO_SPLIT]


def _peaks(
    truth: npt.NDArray[np.float32], onset_row: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the acceleration of largest magnitude after onset, along and across the velocity, m/s2, (N,) each.

    truth: states x, y, vx, vy, ax, ay, (N, 6, S). onset_row: row of the onset in each record, (N,).
    """
    vx, vy, ax, ay = truth[:, 2:].transpose(1, 0, 2)
    speed = np.maximum(np.hypot(vx, vy), 0.1)
    after_onset = np.arange(truth.shape[2]) >= onset_row[:, None]
    peaks = []
    for component in ((ax * vx + ay * vy) / speed, (ay * vx - ax * vy) / speed):
        largest = np.where(after_onset, np.abs(component), -1.0).argmax(axis=1)
        peaks.append(np.take_along_axis(component, largest[:, None], axis=1)[:, 0].astype(np.float64))
    return peaks[0], peaks[1]


def _quantiles(values: npt.NDArray[np.float64]) -> list[float] | None:
    """Return the quantiles, rounded, or None without values."""
    return [round(float(q), 3) for q in np.quantile(values, QUANTILES)] if len(values) else None
