"""The settings of the ASI-BIP reproduction are the paper's, whatever the size."""

from __future__ import annotations

from pathlib import Path

import pytest

from isac_cosim.base.feedback import SILENT
from isac_cosim.base.settings import merged
from isac_cosim.models.predictors.asi_bip import AsiBipSettings
from isac_cosim.studies.reproduction.asi_bip.stages import AsiBipReproduction, study_of
from isac_cosim.studies.reproduction.experiments.sizes import ASI_BIP, SizeName
from isac_cosim.studies.reproduction.experiments.stages import in_full
from tests.support.scripted import InlineEngine


def test_the_full_size_is_the_papers() -> None:
    study = study_of(ASI_BIP["full"])
    optimiser, dataset = study.training.optimiser, study.dataset
    assert (optimiser.learning_rate, optimiser.betas, optimiser.batch) == (1e-4, (0.9, 0.999), 32)
    assert (optimiser.schedule, optimiser.clip_norm, optimiser.weight_decay) == ("constant", 0, 0)
    assert (study.training.loss.gamma, study.training.windows.window_s) == (2.0, 2.2)
    assert dataset.sensing.channel.snr_range_db == (0.0, 10.0)
    assert (dataset.record.tv_rate_hz, dataset.record.uv_rate_hz) == (400.0, 100.0)
    assert study.training.of(AsiBipSettings).tv_patch == 1
    known = len(dataset.seeds) * 6 * dataset.selection.per_class
    assert known == 6000 + 1200
    shares = study.training.split.validation, study.training.split.test
    assert [round(share * known, -2) for share in shares] == [1200, 1200]


def test_a_size_replaces_single_keys() -> None:
    study, full = study_of(ASI_BIP["quick"]), study_of(ASI_BIP["full"])
    assert study.training.optimiser.clip_norm == 0
    assert len(study.dataset.seeds) < len(full.dataset.seeds)
    assert study.dataset.kinematics.hard_brake == full.dataset.kinematics.hard_brake
    assert merged({"a": {"b": 1, "c": 2}, "d": 3}, {"a": {"b": 4}, "d": {"e": 5}}) == {
        "a": {"b": 4, "c": 2},
        "d": {"e": 5},
    }


@pytest.mark.parametrize(
    ("size", "chains"),
    [("full", ["isac", "isac-padded-parabola", "isac-padded-grid", "isac-grid"]), ("quick", ["isac"])],
)
def test_the_stages(size: SizeName, chains: list[str], tmp_path: Path) -> None:
    reproduction = AsiBipReproduction(ASI_BIP[size], tmp_path, InlineEngine(), SILENT)
    stages = reproduction.stages()
    assert [stage.name for stage in stages if stage.group == "table1"] == [
        "truth", "isac", "isac-padded-parabola", "isac-padded-grid", "isac-grid",
        "radar-clear", "radar-nlos", "radar-weather", "framework-clear", "framework-nlos", "framework-weather",
        *(f"{chain}-weather" for chain in chains),
    ]  # fmt: skip
    assert {stage.name for stage in stages if stage.group != "table1"} == {
        "data", "fig3", "fig4", "fig5", "aligned", "control-slow", "control-fast", "literal", "fast",
    }  # fmt: skip
    assert all(stage.cost_s > 0 for stage in in_full(stages, tmp_path))
