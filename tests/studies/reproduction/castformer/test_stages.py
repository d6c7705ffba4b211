"""Folds, variants and training settings of the CaSTFormer reproduction, and what the paper contradicts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import SILENT
from isac_cosim.models.data.clips import Clip
from isac_cosim.models.predictors.castformer import CastformerSettings
from isac_cosim.studies.reproduction.castformer import variants
from isac_cosim.studies.reproduction.castformer.clips import shortened
from isac_cosim.studies.reproduction.castformer.report import MeasuredVariant, paper_rows
from isac_cosim.studies.reproduction.castformer.stages import CastformerReproduction, folds_of, sides_of
from isac_cosim.studies.reproduction.experiments.paper_figures import ABLATION, HORIZON, contradictions
from isac_cosim.studies.reproduction.experiments.sizes import CASTFORMER
from isac_cosim.studies.reproduction.experiments.trainings import Scores
from tests.studies.reproduction import tiny
from tests.support.scripted import InlineEngine


def test_every_seed_is_tested_once_and_never_seen_before() -> None:
    groups = [f"road-{seed}" for seed in range(13)]
    folds = folds_of(groups, 5)
    assert sorted(group for fold in folds for group in fold) == sorted(groups)
    assert {len(fold) for fold in folds} == {2, 3}
    for fold, sides in zip(folds, sides_of(folds), strict=True):
        assert sides["test"] == sorted(fold)
        assert sorted(sides["train"] + sides["validation"] + sides["test"]) == sorted(groups)
        assert len(sides["validation"]) == 1


def test_too_few_seeds_are_refused() -> None:
    with pytest.raises(InputError, match="too few for 2 folds"):
        folds_of(["road-1", "road-2"], 2)


def test_the_ablation_has_every_combination_once() -> None:
    settings = [CastformerSettings(**row.settings) for row in variants.ablation()]
    switched = {(row.rsf, row.cpe, row.fsn) for row in settings}
    assert len(settings) == len(switched) == 8
    assert variants.ablation()[-1] is variants.COMPLETE


def test_every_row_of_the_papers_tables_has_its_counterpart() -> None:
    for stage, rows in (("ablation", variants.ablation()), ("orders", variants.orders())):
        assert set(paper_rows(stage)) == {row.name for row in rows}
    assert paper_rows("ablation")["modules-rsf+fsn"][0] == 98.0
    assert paper_rows("orders")["order-cpe-fsn-rsf"][4] == 62.8
    assert paper_rows("orders")["complete"] != paper_rows("ablation")["complete"]


def test_variants_differ_from_the_complete_network_in_one_thing() -> None:
    complete = dict(CastformerSettings(**variants.COMPLETE.settings))
    rows = (variants.attention(), variants.orders(), variants.counterfactuals(), variants.alphas((0.1, 0.5)))
    for row in (row for table in rows for row in table):
        different = {key for key, value in CastformerSettings(**row.settings) if value != complete[key]}
        assert len(different) == (0 if row is variants.COMPLETE else 1)


def test_the_papers_settings_not_ours(tmp_path: Path) -> None:
    reproduction = CastformerReproduction(CASTFORMER["full"], tmp_path, InlineEngine(), SILENT)
    settings = reproduction.training(variants.COMPLETE)
    assert settings.optimiser.clip_norm == 0
    assert (settings.optimiser.schedule, settings.optimiser.learning_rate, settings.optimiser.batch) == (
        "constant", 1e-3, 16,
    )  # fmt: skip
    assert not settings.loss.class_weights
    assert settings.of(CastformerSettings).intent_source == "out"
    beside = reproduction.training(variants.compared(("asi-bip",))[1])
    assert (beside.model, beside.optimiser.learning_rate, beside.optimiser.clip_norm) == ("asi-bip", 1e-4, 0)


def test_a_network_of_several_tables_is_trained_once(tmp_path: Path) -> None:
    reproduction = CastformerReproduction(tiny.castformer(), tmp_path, InlineEngine(), SILENT)
    trained = {stage.name: stage.parallel for stage in reproduction.stages()}
    assert trained == {
        "data": 8, "horizon": 2, "ablation": 14, "attention": 6, "orders": 6, "counterfactual": 2,
        "alpha": 1, "compared": 2, "repeat-1": 10, "background": 2,
    }  # fmt: skip


def test_the_unit_of_an_interval_is_the_fold() -> None:
    folds = [{"road-1": [[2, 1], [0, 3]], "road-2": [[1, 0], [0, 1]]}, {"road-3": [[0, 4], [1, 0]]}]
    scores = [Scores(name="", training_seed=0, counts={"3": fold}, windows={}) for fold in folds]
    measured = MeasuredVariant("complete", "CaSTFormer", scores).at(3)
    assert measured == [{"fold 0": [[3, 1], [0, 4]], "fold 1": [[0, 4], [1, 0]]}]


def test_a_clip_ends_early() -> None:
    clip = Clip("c", np.arange(100.0)[:, None], np.arange(100.0)[:, None], 1)
    assert len(shortened(clip, 0).inner) == 100
    assert shortened(clip, 3).inner[-1] == 39
    assert len(shortened(Clip("c", np.zeros((3, 1)), np.zeros((3, 1)), 1), 4).outer) == 1


def test_the_papers_contradictions_are_named() -> None:
    assert HORIZON["CaSTFormer"] == ABLATION["rsf+cpe+fsn"], "Tables 3 and 4 are of the same network"
    sentences = contradictions()
    assert len(sentences) == 6
    assert "1.2, 7.3, 11.7 and 14.7 points" in sentences[2]
    assert "5 of 7 are below the baseline's 63.2 %" in sentences[3]
    assert "98.6 %" in sentences[4]
    assert "97.6 %" in sentences[4]
    assert "75.5 % in Table 2, and 75.7 % in Table 3" in sentences[5]
    assert "-3 s" in sentences[0]
    assert "78.4" in sentences[0]
    assert "76.2" in sentences[0]
    assert "-4 s" in sentences[1]
