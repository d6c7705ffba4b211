"""The page of the CaSTFormer reproduction: what one network has in several of its tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.files import write_json
from isac_cosim.evaluation.report.parts import Part
from isac_cosim.evaluation.statistics import Estimate
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.studies.reproduction.castformer.report import castformer_parts
from isac_cosim.studies.reproduction.castformer.results import VariantScores, VariantsResult
from isac_cosim.studies.reproduction.castformer.variants import (
    COMPLETE,
    Variant,
    ablation,
    horizon,
    main_comparison,
    orders,
)
from isac_cosim.studies.reproduction.experiments.paper_figures import HORIZONS_S
from isac_cosim.studies.reproduction.experiments.trainings import Scores

WINDOWS = 100 * len(KNOWN)
"""Windows of a training, over its folds."""


def write_stage(out: Path, stage: str, rows: list[Variant], right: int, background: int | None = None) -> None:
    """Write what a stage measured: in each of two folds, `right` of 50 windows of every intention are right."""
    counts = np.full((len(KNOWN), len(KNOWN)), (50 - right) // (len(KNOWN) - 1))
    np.fill_diagonal(counts, right)
    by_horizon = {str(horizon_s): counts.tolist() for horizon_s in HORIZONS_S}
    folds = [
        Scores(name="", training_seed=0, counts={h: {f"road-{fold}": of} for h, of in by_horizon.items()}, windows={})
        for fold in range(2)
    ]
    variants = [VariantScores(name=row.name, title=row.title, folds=folds) for row in rows]
    (out / "stages").mkdir(exist_ok=True)
    result = VariantsResult(stage=stage, source="kinematic", variants=variants, background=background)
    write_json(out / "stages" / f"{stage}.json", result.model_dump(mode="json") | {"schema_version": 1})


def part(parts: list[Part], name: str) -> Part:
    return next(one for one in parts if one.name == name)


def f1_at_0_s(parts: list[Part], name: str) -> Estimate:
    """What a table says of the complete network."""
    f1 = next(row for row in part(parts, name).rows if row["network"] == COMPLETE.title)["ours: 0 s"]
    assert isinstance(f1, Estimate)
    return f1


def test_the_complete_network_has_all_its_trainings_in_every_table_of_it_alone(tmp_path: Path) -> None:
    write_stage(tmp_path, "horizon", horizon(), right=40)
    write_stage(tmp_path, "ablation", ablation(), right=40)
    write_stage(tmp_path, "orders", orders(), right=40)
    for stage, right in (("repeat-1", 45), ("repeat-2", 50)):
        write_stage(tmp_path, stage, main_comparison(), right)
    parts, claims = castformer_parts(tmp_path)
    alone = f1_at_0_s(parts, "horizon")
    assert alone.value == pytest.approx(np.mean([0.8, 0.9, 1.0]))
    assert f1_at_0_s(parts, "ablation") == alone
    assert next(row for row in part(parts, "table1").rows if "ours: F1" in row)["ours: F1"] == alone
    assert (
        sum(int(str(n)) for row in part(parts, "fig4").rows for name, n in row.items() if name != "true") == 3 * WINDOWS
    )
    assert f1_at_0_s(parts, "orders").value == pytest.approx(0.8)
    assert "trained once" in part(parts, "orders").text
    assert "trained once" not in part(parts, "ablation").text
    assert {claim.verdict for claim in claims if claim.claim.startswith("At 0 s, the order")} == {"undecided"}


def test_samples_are_counted_once_however_often_the_network_was_trained(tmp_path: Path) -> None:
    """As with clips, of which one class is plain driving."""
    background = len(KNOWN) - 1
    for stage, rows in (("horizon", horizon()), ("repeat-1", main_comparison())):
        write_stage(tmp_path, stage, rows, 40, background)
    parts, _ = castformer_parts(tmp_path)
    at_0_s = part(parts, "precision_recall").rows[0]
    assert (at_0_s["maneuvers"], at_0_s["background"]) == (WINDOWS - 100, 100)
