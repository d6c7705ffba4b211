"""What is in a dataset, in numbers and for people."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Column, Table

from labeling.dataset.dataset import Dataset
from labeling.dataset.distributions import distributions, too_few_seeds
from labeling.dataset.shard import read_episode

SHOWN = (
    "seeds", "sensors", "snr_db", "n_sites", "position_error_m", "left_out", "counts", "collided", "teleported",
)  # fmt: skip
"""What follows the tables, in this order."""
EPISODES_SHOWN = 24
"""Of more episodes, people see the sums by scenario alone; all stand in the plain values."""


def summary(dataset: Dataset) -> dict[str, Any]:
    """A dataset's counts, rates and qualities, as plain values.

    sensors: samples by sensor. snr_db, n_sites: least, median and greatest over the samples. position_error_m: median
    over the samples of each one's median distance to the true position, before and after the filter. left_out:
    candidates that became no sample, by reason.
    """
    meta = dataset.meta
    seeds = {
        scenario.name: [shard.episode.seed for shard in meta.shards if shard.episode.scenario == scenario.name]
        for scenario in meta.scenarios
    }
    episodes = [shard.episode for shard in meta.shards]
    errors = [read_episode(dataset.shard_path(shard)) for shard in meta.shards]
    scalars = dataset.frame(["sensor", "snr_db", "n_sites", "intention", "origin"])
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
        "sensors": {str(name): int(number) for name, number in scalars["sensor"].value_counts().sort_index().items()},
        "snr_db": _quantiles(scalars["snr_db"].to_numpy(np.float64)),
        "n_sites": _quantiles(scalars["n_sites"].to_numpy(np.float64)),
        "position_error_m": {
            "before_filter": _median([error for episode in errors for error in episode.fix_error_m]),
            "sensed": _median([error for episode in errors for error in episode.state_error_m]),
        },
        "left_out": meta.left_out(),
        "counts": dict(sorted(sum((Counter(episode.counts) for episode in episodes), Counter()).items())),
        "collided": sum(episode.collided for episode in episodes),
        "teleported": sum(episode.teleported for episode in episodes),
        "distributions": distributions(dataset),
        "lost": [lost.model_dump(mode="json") for lost in meta.lost],
        "short": list(meta.short),
        "bytes": sum(shard.bytes for shard in meta.shards),
    }


def show(found: dict[str, Any], console: Console) -> None:
    """A summary, on a console."""
    table = Table("intention", *found["by_origin"], "samples")
    for name, number in found["by_intention"].items():
        table.add_row(name, *map(str, found["by_intention_and_origin"][name].values()), str(number))
    table.add_section()
    table.add_row("all", *map(str, found["by_origin"].values()), str(found["samples"]))
    console.print(f"{found['path']}, digest {found['digest'][:12]}", highlight=False, soft_wrap=True)
    console.print(table)
    console.print(_episodes_table(found["distributions"]))
    console.print(_events_table(found["distributions"]))
    for key in SHOWN:
        console.print(f"{key}: {_brief(found[key])}", highlight=False, soft_wrap=True)


def _episodes_table(found: dict[str, dict[str, Any]]) -> Table:
    """Samples of each intention by scenario, and by seed where the episodes are few."""
    headings = [Column(name.replace("_", " "), overflow="fold") for name in (*found, "all")]
    table = Table(Column("samples", no_wrap=True), *headings, padding=0)
    by_scenario = {intention: each["by_scenario"] for intention, each in found.items()}
    by_seed = {intention: each["by_seed"] for intention, each in found.items()}
    seeds = {name for each in by_seed.values() for name in each}
    for scenario in sorted({name for each in by_scenario.values() for name in each}):
        rows = {scenario: by_scenario}
        if len(seeds) <= EPISODES_SHOWN:
            own = (name for name in seeds if name.rpartition("-")[0] == scenario)
            rows |= dict.fromkeys(sorted(own, key=lambda name: int(name.rpartition("-")[2])), by_seed)
        for name, counted in rows.items():
            numbers = [each.get(name, 0) for each in counted.values()]
            table.add_row(name, *map(str, numbers), str(sum(numbers)))
        table.add_section()
    return table


def _events_table(found: dict[str, dict[str, Any]]) -> Table:
    """Medians, with the 5 and 95 % quantiles, of what the events are like."""
    names = {
        "duration_s": "duration s", "lead_s": "to commit s",
        "peak_along_mps2": "along m/s2", "peak_across_mps2": "across m/s2",
    }  # fmt: skip
    table = Table("intention", "seeds", *names.values(), title="median (5 %, 95 %)")
    for intention, each in found.items():
        values = [each[name] for name in names]
        table.add_row(
            intention, str(each["seeds"]), *(f"{q[2]:.1f} ({q[0]:.1f},{q[4]:.1f})" if q else "" for q in values)
        )
    return table


def faults(found: dict[str, Any]) -> list[str]:
    """What is amiss with a dataset by its summary, a line each."""
    lines = [f"episode {each['scenario']}-{each['seed']} was left out: {each['reason']}" for each in found["lost"]]
    if not found["samples"]:
        lines.append("no sample was found; what candidates there were, and why they were left out, stands above")
    if found["short"]:
        lines.append(f"the seeds ended before the study's least number was reached of: {', '.join(found['short'])}")
    if few := too_few_seeds(found["distributions"]):
        lines.append(f"too few seeds to split into training, validation and test: {', '.join(few)}")
    return lines


def _brief(value: Any) -> str:
    """Plain values for a person's eye: runs of seeds as ranges."""
    if isinstance(value, dict):
        return ", ".join(f"{key} {_brief(each)}" for key, each in value.items())
    if isinstance(value, list):
        return f"{value[0]} to {value[-1]} ({len(value)})" if value else "none"
    return str(value)


def _quantiles(values: np.ndarray[Any, np.dtype[np.float64]]) -> dict[str, float] | None:
    """Least, median and greatest of the finite values; None of nothing: what no echo gave has no SNR."""
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    return {name: round(float(np.quantile(values, q)), 4) for name, q in (("min", 0), ("median", 0.5), ("max", 1))}


def _median(values: Sequence[float]) -> float | None:
    return round(float(np.median(values)), 6) if values else None
