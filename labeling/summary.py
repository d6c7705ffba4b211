"""What is in a dataset, in numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from labeling.dataset import Dataset


def summary(dataset: Dataset) -> dict[str, Any]:
    """A dataset's counts, rates and qualities, as plain values.

    snr_db, n_sites: least, median and greatest over the samples. position_error_m: median over the samples of each
    one's median distance to the true position, before and after the filter. left_out: candidates that became no sample,
    by reason.
    """
    meta = dataset.meta
    seeds = {
        scenario.name: [shard.episode.seed for shard in meta.shards if shard.episode.scenario == scenario.name]
        for scenario in meta.scenarios
    }
    episodes = [shard.episode for shard in meta.shards]
    scalars = dataset.frame(["snr_db", "n_sites", "intention", "origin"])
    origins = scalars.groupby(["intention", "origin"]).size()
    return {
        "path": str(dataset.path),
        "digest": dataset.digest,
        "samples": meta.samples,
        "by_intention": meta.by_intention(),
        "by_origin": meta.by_origin(),
        "by_intention_and_origin": {
            intention: {origin: int(origins.get((intention, origin), 0)) for origin in meta.by_origin()}
            for intention in meta.class_names
        },
        "seeds": seeds,
        "tv_rate_hz": meta.tv_rate_hz,
        "uv_rate_hz": meta.uv_rate_hz,
        "duration_s": meta.duration_s,
        "snr_db": _quantiles(scalars["snr_db"].to_numpy(np.float64)),
        "n_sites": _quantiles(scalars["n_sites"].to_numpy(np.float64)),
        "position_error_m": {
            "before_filter": _median([error for episode in episodes for error in episode.fix_error_m]),
            "sensed": _median([error for episode in episodes for error in episode.state_error_m]),
        },
        "left_out": meta.left_out(),
        "collided": sum(episode.collided for episode in episodes),
        "teleported": sum(episode.teleported for episode in episodes),
        "lost": [lost.model_dump(mode="json") for lost in meta.lost],
        "short": list(meta.short),
        "bytes": sum(shard.bytes for shard in meta.shards),
    }


def _quantiles(values: np.ndarray[Any, np.dtype[np.float64]]) -> dict[str, float] | None:
    """Least, median and greatest value; None of nothing."""
    if not len(values):
        return None
    return {name: round(float(np.quantile(values, q)), 4) for name, q in (("min", 0), ("median", 0.5), ("max", 1))}


def _median(values: Sequence[float]) -> float | None:
    return round(float(np.median(values)), 6) if values else None
