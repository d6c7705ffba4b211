"""The page of the CaSTFormer reproduction: its tables, figures and claims, from the files of the stages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from isac_cosim.evaluation.on_windows.maneuvers import maneuver_statistic
from isac_cosim.evaluation.report.parts import Part, Row
from isac_cosim.evaluation.statistics import class_mean
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.data.clips import NO_BACKGROUND
from isac_cosim.studies.reproduction.castformer import variants
from isac_cosim.studies.reproduction.castformer.claims import castformer_claims
from isac_cosim.studies.reproduction.castformer.measured import MeasuredVariant, measured_of, with_repeats
from isac_cosim.studies.reproduction.castformer.precision_recall import (
    confusion_part,
    maneuvers_part,
    table_1,
    table_2,
)
from isac_cosim.studies.reproduction.castformer.results import SamplesResult
from isac_cosim.studies.reproduction.experiments import drawings
from isac_cosim.studies.reproduction.experiments.counterparts import CASTFORMER, counterparts_part
from isac_cosim.studies.reproduction.experiments.pages import FIGURES, claims_part
from isac_cosim.studies.reproduction.experiments.paper_figures import (
    ABLATION,
    HORIZON,
    HORIZONS_S,
    ORDERS,
    contradictions,
    end_of,
)
from isac_cosim.studies.reproduction.experiments.stages import result_of
from isac_cosim.studies.reproduction.experiments.verdicts import Claim

STAGES = {
    "horizon": "Table 3: observation that ends before the action",
    "ablation": "Table 4: modules",
    "attention": "Fig. 5: attention",
    "orders": "Table 5: order of the modules",
    "counterfactual": "Eq. (6): the mean in the counterfactual",
    "alpha": "Fig. 6: weight of the intention's loss",
    "motorway": "Table 3 on the motorway",
}
"""Tables with a column for each horizon, by stage, with their titles."""


def castformer_parts(out: Path) -> tuple[list[Part], list[Claim]]:
    """Return the parts of the page for the stages that were run, their figures drawn, and the claims."""
    (out / FIGURES).mkdir(exist_ok=True)
    measured = {stage: measured_of(out, stage) for stage in STAGES}
    repeats = [
        measured_of(out, file.stem) for file in sorted((out / "stages").glob(f"{variants.repeat_stage('*')}.json"))
    ]
    for stage in ("horizon", "ablation"):
        measured[stage] = with_repeats(measured[stage], repeats)
    background = next((rows[0].background for rows in measured.values() if rows), None)
    claims = castformer_claims(
        {
            stage: {row.name: {h: row.at(h) for h in HORIZONS_S} for row in rows}
            for stage, rows in measured.items()
            if rows and stage != "motorway"
        },
        background,
    )
    tables = [_table(out, stage, rows) for stage, rows in measured.items() if rows]
    complete = measured["horizon"]
    parts = [
        claims_part(claims),
        _data(out),
        table_1(complete),
        table_2(complete),
        confusion_part(complete, _class_names(out, complete), out),
        *tables,
        maneuvers_part(measured_of(out, "background") or complete),
        _compared(out),
        _contradictions(),
    ]
    shown = [part for part in parts if part is not None]
    return [*shown, counterparts_part(CASTFORMER, shown)], claims


def _class_names(out: Path, measured: Sequence[MeasuredVariant]) -> list[str]:
    """Return the names of the classes of the confusion matrices: intentions, or the numbers of classes of clips."""
    data = result_of(out, "data", SamplesResult)
    if data is None or data.dataset is not None:
        return [intention.text for intention in KNOWN]
    return [f"class {k}" for k in range(len(data.by_class or []))]


def paper_rows(stage: str) -> Mapping[str, Sequence[float]]:
    """Return the paper's row of each network in a stage's table, in percent, by the network's name."""
    if stage == "horizon":
        return {variants.COMPLETE.name: HORIZON["CaSTFormer"]}
    if stage == "ablation":
        return {
            row.name: ABLATION["rsf+cpe+fsn" if row is variants.COMPLETE else row.name.removeprefix("modules-")]
            for row in variants.ablation()
            if row.name != "modules-none"
        } | {"modules-none": ABLATION[""]}
    if stage == "orders":
        complete = {variants.COMPLETE.name: ORDERS["rsf-cpe-fsn"]}
        return complete | {f"order-{order}": row for order, row in ORDERS.items() if order != "rsf-cpe-fsn"}
    return {}


def _data(out: Path) -> Part | None:
    result = result_of(out, "data", SamplesResult)
    if result is None:
        return None
    if result.dataset is None:
        rows: list[Row] = [
            {"class": k, "clips": count, "counts as": "background" if k == result.background else "maneuver"}
            for k, count in enumerate(result.by_class or [])
        ]
        straight = "Every class counts as a maneuver, as the user says."
        if result.background != NO_BACKGROUND:
            straight = f"Class {result.background} drives straight on: the background of Eq. (13), no maneuver."
        floor = ""
        if result.random:
            views = " and ".join(result.random)
            floor = f" Features of the {views} are of networks with random weights: a floor, not the paper's features."
        return Part("data", "Clips", f"{result.clips} feature files. {straight}{floor}", rows)
    rows = [{"intention": name, "samples": count} for name, count in result.dataset.by_intention.items() if count]
    text = (
        f"Source: {result.source}. The folds are of scenario seeds, so no traffic is on two sides. A window of "
        "2.2 s ends 0 to 4 s before the commit; in training anywhere between. The kinematic UVs drive at 10 to 17 m/s, "
        "so that the sites see all of the long records."
    )
    return Part("data", "Samples", text, rows)


def _table(out: Path, stage: str, measured: Sequence[MeasuredVariant]) -> Part:
    paper, rows = paper_rows(stage), list[Row]()
    f1 = maneuver_statistic("f1", measured[0].background)
    curves: dict[str, list[float]] = {}
    reference: dict[str, list[float]] = {}
    for row in measured:
        scores = {h: class_mean(f1, row.at(h)) for h in HORIZONS_S}
        cells: dict[str, Any] = {"network": row.title}
        for k, h in enumerate(HORIZONS_S):
            if row.name in paper:
                cells[f"paper: {end_of(h)}"] = paper[row.name][k] / 100
            cells[f"ours: {end_of(h)}"] = scores[h]
        rows.append(cells)
        curves[row.title] = [np.nan if (value := scores[h].value) is None else value for h in HORIZONS_S]
        if row.name in paper:
            reference[row.title] = [score / 100 for score in paper[row.name]]
    if stage == "horizon":
        others = {method: scores for method, scores in HORIZON.items() if method != variants.COMPLETE.title}
        rows += [
            {"network": method}
            | {f"paper: {end_of(h)}": score / 100 for h, score in zip(HORIZONS_S, scores, strict=True)}
            for method, scores in others.items()
        ]
    figure = f"{stage}.png"
    labels = (STAGES[stage], "observation ends this long before the action, s", "F1 of Eq. (13)")
    drawings.lines(curves, list(HORIZONS_S), out / FIGURES / figure, labels, reference)
    text = (
        "F1 of macro precision and macro recall, Eq. (13), over all folds together, every missed maneuver counted as "
        "MP. 95 % intervals are over the folds, each with trainings of its own. The paper's numbers are of Brain4Cars, "
        "so compare the order of the networks, not single numbers."
    )
    if not any(row.repeats for row in measured):
        text += " Each network was trained once on each fold."
    return Part(stage, STAGES[stage], text, rows, [(figure, f"{STAGES[stage]}. Dotted: the paper.")])


def _compared(out: Path) -> Part | None:
    measured = measured_of(out, "compared")
    if not measured:
        return None
    rows: list[Row] = []
    f1 = maneuver_statistic()
    for row in measured:
        window_ms = [fold.window_ms for fold in row.scores if fold.window_ms is not None]
        rows.append(
            {
                "predictor": row.title,
                "parameters": row.scores[0].parameters,
                "processor time of a training, s": float(np.mean([fold.cpu_s for fold in row.scores])),
                "time of a prediction, ms": float(np.mean(window_ms)) if window_ms else None,
                **{f"F1: {end_of(h)}": class_mean(f1, row.at(h)) for h in HORIZONS_S},
            }
        )
    text = (
        "The same windows and folds. Times are of one thread on this machine, other work included. The paper's Table 2 "
        "gives its network 14.53 million parameters, feature extraction from video included, which ours has no part of."
    )
    return Part("compared", "Parameters and time beside F1", text, rows)


def _contradictions() -> Part:
    rows: list[Row] = [{"contradiction": sentence} for sentence in contradictions()]
    text = "Tables 3 and 4 print the network that is the first row of Table 5. The rest compares the text with tables."
    return Part("contradictions", "Where the paper contradicts itself", text, rows)
