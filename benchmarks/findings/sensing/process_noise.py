"""Which density of the filter's white jerk suits the motion of simulated traffic.

The records of a dataset's development seeds are sensed once with the dataset's settings, and their fixes are filtered
with every candidate density. The score is the root mean square error of the acceleration along and across the direction
of travel, by intention and over all.

Run: python -m isac_cosim.benchmarks.findings.sensing.process_noise DATASET LAST_SEED [RECORDS_PER_INTENTION]
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
import pandas as pd

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.sensing.chain import LEAST_SITES, fix
from isac_cosim.isacsim.sensing.following import Approach, run_in_snapshots
from isac_cosim.isacsim.sensing.passages import Passage
from isac_cosim.isacsim.tracking.kalman import track
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.dataset.record_point import in_plane
from isac_cosim.labeling.dataset.shard import RUN_IN
from isac_cosim.labeling.generation.episode import record_key
from isac_cosim.labeling.generation.resense import own_sensing
from isac_cosim.labeling.intentions import Intention

DENSITIES = (1.0, 3.0, 10.0, 20.0, 30.0, 100.0)


@dataclass(frozen=True)
class SensedRecords:
    """Fixes of B records with their run-in of `count` snapshots, (B, S, ...), and the truth, (B, 6, S - count)."""

    state: Array
    covariance: Array
    valid: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
    truth: Array
    intention: list[str]
    count: int


def sensed(dataset: Dataset, last_seed: int, per_intention: int) -> SensedRecords:
    """Sense the first records of every intention, among the seeds up to the last, with the dataset's settings.

    The draws are those of the dataset, so that the fixes are those that its stored states were filtered from.
    """
    settings, table = own_sensing(dataset), dataset.frame()
    names = ("tv_truth", RUN_IN) if dataset.meta.run_in_length else ("tv_truth",)
    x0, y0 = table["x0"].to_numpy(), table["y0"].to_numpy()
    states = {name: in_plane(values, x0, y0) for name, values in dataset.arrays(*names).items()}
    truth, past = states["tv_truth"], states.get(RUN_IN)
    chosen = table[table["seed"] <= last_seed].groupby("intention").head(per_intention).index.to_numpy()
    count = run_in_snapshots(dataset.meta.tv_rate_hz, settings.tracking)
    rate_hz, observed = dataset.meta.tv_rate_hz, []
    for k in chosen:
        row = table.loc[k]
        sites = Panels.of(dataset.sites(row["scenario"]), settings.target_height_m)
        key = record_key(row["scenario"], row["seed"], row["tv_id"], Intention(row["label"]), row["t_start"])
        earlier = None if past is None else past[k]
        passage = Passage(row["tv_id"], row["t_start"], truth[k], key, past=earlier)
        approach = Approach.of(passage, rate_hz, settings.tracking)
        observed.append(fix(approach, rate_hz, sites, settings, key))
    good = [n for n, item in enumerate(observed) if item.n_sites >= LEAST_SITES]
    return SensedRecords(
        state=np.stack([observed[n].fixes.state for n in good]),
        covariance=np.stack([observed[n].fixes.covariance for n in good]),
        valid=np.stack([observed[n].fixes.valid for n in good]),
        truth=truth[chosen[good]],
        intention=[str(name) for name in table["intention"].to_numpy()[chosen[good]]],
        count=count,
    )


def scores(dataset: Dataset, given: SensedRecords) -> pd.DataFrame:
    """RMS error of the acceleration, m/s2: a row for each density and axis, a column for each intention and `all`."""
    settings, rate_hz = own_sensing(dataset).tracking, dataset.meta.tv_rate_hz
    heading = np.arctan2(given.truth[:, 3], given.truth[:, 2])
    rows = {}
    for density in DENSITIES:
        tuned = settings.model_copy(update={"jerk_density": density})
        states = track(given.state, given.covariance, given.valid, 1 / rate_hz, tuned).state[:, given.count :]
        error = states[..., 4:].transpose(0, 2, 1) - given.truth[:, 4:]
        along = error[:, 0] * np.cos(heading) + error[:, 1] * np.sin(heading)
        across = error[:, 1] * np.cos(heading) - error[:, 0] * np.sin(heading)
        for axis, values in (("along", along), ("across", across)):
            square = pd.Series((values**2).mean(axis=1)).groupby(given.intention).mean()
            rows[density, axis] = pow(square, 0.5).to_dict() | {"all": float(np.sqrt((values**2).mean()))}
    return pd.DataFrame(rows).T.round(3)


def main() -> None:
    dataset, last_seed = Dataset.open(sys.argv[1]), int(sys.argv[2])
    given = sensed(dataset, last_seed, int(sys.argv[3]) if len(sys.argv) > 3 else 20)
    print(f"{len(given.intention)} records of seeds up to {last_seed}; rms error of the acceleration, m/s2")
    print(scores(dataset, given).to_string())


if __name__ == "__main__":
    main()
