"""Summarises a dataset, as plain values and on a console."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Column, Table

from isac_cosim.isacsim.scene.scores import scene_line, scene_scores
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.dataset.dependence import HELP, Dependence, Driven
from isac_cosim.labeling.dataset.distributions import distributions, too_few_seeds
from isac_cosim.labeling.dataset.label_truth import label_truth
from isac_cosim.labeling.dataset.pull_outs import dropped_pull_outs
from isac_cosim.labeling.dataset.traffic_summary import share_text, traffic_faults, traffic_summary
from isac_cosim.labeling.samples.generated_labels import agreement, other_counts

SHOWN = (
    "seeds", "sensors", "snr_db", "n_sites", "position_error_m", "labels_and_truth", "dependence", "left_out",
    "dropped_pull_outs", "counts",
)  # fmt: skip
"""Keys of the summary that are printed after the tables, in this order."""
EPISODES_SHOWN = 24
"""With more episodes than this, the console shows only the sums by scenario. The plain values hold all of them."""


def summary(dataset: Dataset) -> dict[str, Any]:
    """Return a dataset's counts, rates and qualities as plain values.

    Some of the keys: `by_cause`, for each intention and cause the samples and the median time to collision at the
    reaction's start, s, None where there is nothing to collide with; `sensors`, samples by sensor; `snr_db` and
    `n_sites`, least, median and greatest value over the samples; `position_error_m`, median over the samples of their
    median distances to the true position, before and after the filter; `labels_and_truth`, how far the true motion
    does what the labels say (`labeling.dataset.label_truth`), None where the motion source gives the labels;
    `dependence`, how many samples have a twin in another seed (`labeling.dataset.dependence`);
    `remarks`, what the motion source says of each scenario, such as how far the speeds of a file are from those of its
    positions; `drivers`, what is to be said of the vehicle types of each scenario's demand;
    `left_out`, candidates that did not become samples, by reason; `dropped_pull_outs`, how many of these are kept
    beside the samples, by outcome; `traffic`, what became of the demand (`labeling.dataset.traffic_summary`), None
    where the motion is not SUMO's; `scene`, how well the network knew who was where, over all episodes, only where the
    sites sense all vehicles at once (`isacsim.scene.scores.SceneScores`); `label_agreement`, what the detectors make of
    the maneuvers of each intention, only where the motion source gives the labels.
    """
    meta, shards = dataset.meta, dataset.meta.shards
    seeds: dict[str, list[int]] = {scenario.name: [] for scenario in meta.scenarios}
    for name, seed in zip(shards.scenarios, shards.numbers("seed").tolist(), strict=True):
        seeds[name].append(seed)
    episodes = [dataset.episode(shard) for shard in shards]
    counts = dict(sorted((+shards.totals("counts")).items()))
    agreed = agreement(counts)
    scalars = dataset.frame(["sensor", "snr_db", "n_sites", "intention", "origin", "cause", "cause_ttc_s"])
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
        "by_cause": _causes(scalars[scalars["cause"] != ""]),
        "seeds": seeds,
        "tv_rate_hz": meta.tv_rate_hz,
        "uv_rate_hz": meta.uv_rate_hz,
        "duration_s": meta.duration_s,
        "sensors": {str(name): int(number) for name, number in scalars["sensor"].value_counts().sort_index().items()},
        "snr_db": _quantiles(scalars["snr_db"].to_numpy(np.float64)),
        "n_sites": _quantiles(scalars["n_sites"].to_numpy(np.float64)),
        "position_error_m": {
            "before_filter": _median([error for episode in episodes for error in episode.fix_error_m]),
            "sensed": _median([error for episode in episodes for error in episode.state_error_m]),
        },
        "labels_and_truth": None if agreed else label_truth(dataset),
        "dependence": Driven.of(dataset).between_seeds().model_dump(),
        "left_out": meta.left_out(),
        "dropped_pull_outs": _outcomes(dataset),
        "counts": other_counts(counts),
        **({"label_agreement": agreed} if agreed else {}),
        **scene_scores([episode.scene for episode in episodes]),
        "remarks": {scenario.name: list(scenario.remarks) for scenario in meta.scenarios if scenario.remarks},
        "drivers": {scenario.name: list(scenario.drivers) for scenario in meta.scenarios if scenario.drivers},
        "collided": int(shards.numbers("collided").sum()),
        "teleported": int(shards.numbers("teleported").sum()),
        "traffic": traffic_summary(episodes),
        "distributions": distributions(dataset),
        "lost": [lost.model_dump(mode="json") for lost in meta.lost],
        "short": list(meta.short),
        "bytes": int(shards.numbers("bytes").sum()),
    }


def show(values: dict[str, Any], console: Console) -> None:
    """Print a summary on a console."""
    table = Table("intention", *values["by_origin"], "samples")
    for name, number in values["by_intention"].items():
        table.add_row(name, *map(str, values["by_intention_and_origin"][name].values()), str(number))
    table.add_section()
    table.add_row("all", *map(str, values["by_origin"].values()), str(values["samples"]))
    console.print(f"{values['path']}, digest {values['digest'][:12]}", highlight=False, soft_wrap=True)
    console.print(table)
    console.print(_episodes_table(values["distributions"]))
    console.print(_events_table(values["distributions"]))
    if values["by_cause"]:
        console.print(_causes_table(values["by_cause"]))
    if "label_agreement" in values:
        console.print(_agreement_table(values["label_agreement"]))
    for key in SHOWN:
        console.print(f"{key}: {_brief(values[key])}", highlight=False, soft_wrap=True)
    if "scene" in values:
        console.print(scene_line(values["scene"]), highlight=False, soft_wrap=True)
    for name, remarks in values.get("remarks", {}).items():
        for remark in remarks:
            console.print(f"{name}: {remark}", highlight=False, soft_wrap=True, markup=False)
    for key in ("collided", "teleported"):
        console.print(f"{key}: {share_text(values['traffic'], key, values[key])}", highlight=False, soft_wrap=True)


def _outcomes(dataset: Dataset) -> dict[str, int]:
    """Return the number of dropped pull-outs by their outcome."""
    outcomes = dropped_pull_outs(dataset).frame(["pull_out"])["pull_out"].value_counts().sort_index()
    return {str(outcome): int(number) for outcome, number in outcomes.items()}


def _causes(reactions: pd.DataFrame) -> dict[str, dict[str, dict[str, Any]]]:
    """Return the samples of each intention and cause, and their median time to collision, s."""
    causes: dict[str, dict[str, dict[str, Any]]] = {}
    for (intention, cause), group in reactions.groupby(["intention", "cause"]):
        known = group["cause_ttc_s"].dropna().tolist()
        causes.setdefault(str(intention), {})[str(cause)] = {"samples": len(group), "ttc_s": _median(known)}
    return causes


def _causes_table(by_cause: dict[str, dict[str, dict[str, Any]]]) -> Table:
    """Return a table of what drivers reacted to. by_cause: as in the summary."""
    table = Table("intention", "cause", "samples", "time to collision s", title="reactions")
    for intention, causes in by_cause.items():
        for cause, values in causes.items():
            ttc_s = "" if values["ttc_s"] is None else f"{values['ttc_s']:.1f}"
            table.add_row(intention, cause, str(values["samples"]), ttc_s)
    return table


def _episodes_table(by_intention: dict[str, dict[str, Any]]) -> Table:
    """Return a table of the samples of each intention by scenario, and by seed if the episodes are few.

    by_intention: as `labeling.dataset.distributions.distributions` returns it.
    """
    headings = [Column(name.replace("_", " "), overflow="fold") for name in (*by_intention, "all")]
    table = Table(Column("samples", no_wrap=True), *headings, padding=0)
    by_scenario = {intention: values["by_scenario"] for intention, values in by_intention.items()}
    by_seed = {intention: values["by_seed"] for intention, values in by_intention.items()}
    episodes = {name for counts in by_seed.values() for name in counts}
    for scenario in sorted({name for counts in by_scenario.values() for name in counts}):
        rows = {scenario: by_scenario}
        if len(episodes) <= EPISODES_SHOWN:
            of_scenario = (name for name in episodes if name.rpartition("-")[0] == scenario)
            rows |= dict.fromkeys(sorted(of_scenario, key=lambda name: int(name.rpartition("-")[2])), by_seed)
        for name, counts_by_intention in rows.items():
            numbers = [counts.get(name, 0) for counts in counts_by_intention.values()]
            table.add_row(name, *map(str, numbers), str(sum(numbers)))
        table.add_section()
    return table


def _events_table(by_intention: dict[str, dict[str, Any]]) -> Table:
    """Return a table of what the events of each intention are like: medians, with the 5 and 95 % quantiles."""
    names = {
        "duration_s": "duration s", "lead_s": "to commit s",
        "peak_along_mps2": "along m/s2", "peak_across_mps2": "across m/s2",
    }  # fmt: skip
    table = Table("intention", "seeds", *names.values(), title="median (5 %, 95 %)")
    for intention, values in by_intention.items():
        quantiles = [values[name] for name in names]
        table.add_row(
            intention, str(values["seeds"]), *(f"{q[2]:.1f} ({q[0]:.1f},{q[4]:.1f})" if q else "" for q in quantiles)
        )
    return table


def _agreement_table(agreed: dict[str, dict[str, int]]) -> Table:
    """Return a table of the maneuvers of each generated intention and what the detectors make of them."""
    table = Table("generated", "maneuvers", "agreed", "detected as", title="labels of the source and of the detectors")
    for intention, verdicts in agreed.items():
        number = sum(verdicts.values())
        share = verdicts.get(intention, 0) / number
        others = {verdict: count for verdict, count in verdicts.items() if verdict != intention}
        table.add_row(intention, str(number), f"{share:.1%}", _brief(others) or "no other")
    return table


def faults(values: dict[str, Any]) -> list[str]:
    """Return warnings about a dataset, one line each. values: its summary."""
    lines = [
        f"episode {episode['scenario']}-{episode['seed']} was left out: {episode['reason']}"
        for episode in values["lost"]
    ]
    lines += traffic_faults(values["traffic"])
    if not values["samples"]:
        lines.append("no sample was found; `left_out` shows the candidates and why they were left out")
    if values["short"]:
        lines.append(f"the seeds hold fewer samples than the study requires of: {', '.join(values['short'])}")
    if (compared := values.get("labels_and_truth")) and compared["share"]:
        lines.append(
            f"in {compared['share']:.1%} of {compared['compared']} samples, the true acceleration differs from what "
            f"the label says by more than {compared['limit_mps2']:g} m/s2, at most by {compared['worst_mps2']:.1f} "
            f"m/s2 (sample {compared['sample_id']}); generate the dataset anew"
        )
    if (stored := values.get("dependence")) and (twins := Dependence.model_validate(stored)).marked:
        lines.append(f"{twins.sentence('samples', 'in another seed')}: the seeds are not independent; {HELP}")
    for name, of_drivers in values.get("drivers", {}).items():
        lines += [f"{name}: {line}" for line in of_drivers]
    if few := too_few_seeds(values["distributions"]):
        lines.append(f"too few seeds to split into training, validation and test: {', '.join(few)}")
    return lines


def _brief(value: Any) -> str:
    """Return plain values as short text, with lists of seeds as ranges."""
    if isinstance(value, dict):
        return ", ".join(f"{key} {_brief(entry)}" for key, entry in value.items()) or "none"
    if isinstance(value, list):
        return f"{value[0]} to {value[-1]} ({len(value)})" if value else "none"
    return str(value)


def _quantiles(values: np.ndarray[Any, np.dtype[np.float64]]) -> dict[str, float] | None:
    """Return least, median and greatest of the finite values, None if there are none, as with the SNR of the truth."""
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    return {name: round(float(np.quantile(values, q)), 4) for name, q in (("min", 0), ("median", 0.5), ("max", 1))}


def _median(values: Sequence[float]) -> float | None:
    return round(float(np.median(values)), 6) if values else None
