"""The settings of a training: sections of predictors, and which optimiser a predictor is trained with."""

from __future__ import annotations

import json

import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import checked
from isac_cosim.models import DEFAULT, FLOOR
from isac_cosim.models.data.fit_settings import OptimiserSettings
from isac_cosim.models.predictors.asi_bip import AsiBipSettings
from isac_cosim.models.predictors.castformer import CastformerSettings
from isac_cosim.models.predictors.registry import sections
from isac_cosim.models.predictors.trees import TreesSettings
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.studies.study import Study


def training(**content: object) -> TrainSettings:
    """The training settings of a study with that section."""
    return checked(Study, {"training": content}, "study.toml").training


def test_sections_are_read_and_written_under_their_names() -> None:
    settings = training(asi_bip={"hidden": 32}, trees={"rounds": 7})
    assert settings.of(AsiBipSettings) == AsiBipSettings(hidden=32)
    assert settings.of(TreesSettings).rounds == 7
    assert settings.of(CastformerSettings) == CastformerSettings()
    stored = json.loads(settings.model_dump_json())
    assert list(stored) == [
        "model", "seed", "held_out", "windows", "split", "ends_per_record", "validation_ends", *sections(), "pre_onset",
        "augment", "loss", "optimiser",
    ]  # fmt: skip
    assert stored["trees"]["rounds"] == 7
    assert TrainSettings.model_validate(stored) == settings
    assert TrainSettings.model_validate_json(settings.model_dump_json()) == settings
    assert TrainSettings(asi_bip=AsiBipSettings(hidden=32), trees=TreesSettings(rounds=7)) == settings
    assert settings != training(asi_bip={"hidden": 32})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"asi_bib": {"hidden": 32}}, "training.asi_bib: unknown key"),
        ({"asi_bip": {"hiden": 32}}, "training.asi_bip.hiden: unknown key"),
        ({"asi_bip": {"hidden": 0}}, "training.asi_bip.hidden: must be at least 1, not 0"),
        ({"trees": 3}, "training.trees: "),
        ({"tv_alone": {"hidden": 32}}, "training.tv_alone: unknown key"),
        ({"model": "asi-bib"}, "training.model: unknown predictor 'asi-bib': did you mean asi-bip? choose one of "),
        ({"model": 3}, "training.model: "),
        ({"model": "oracle", "oracle": {}}, "training.model: unknown predictor 'oracle'"),
        ({"optimiser": {"epochs": 0}}, "training.optimiser.epochs: "),
        ({"optimiser": 3}, "training.optimiser: "),
    ],
)
def test_a_wrong_key_is_reported_in_one_line_by_its_path(content: dict[str, object], message: str) -> None:
    with pytest.raises(InputError) as raised:
        training(**content)
    assert str(raised.value).startswith(f"study.toml: {message}")
    assert "\n" not in str(raised.value)


def test_a_predictor_s_own_optimiser_applies_to_the_keys_that_are_not_given() -> None:
    plain = OptimiserSettings()
    assert training().optimiser == plain
    paper = OptimiserSettings(epochs=160, batch=16, learning_rate=1e-3)
    assert training(model="castformer").optimiser == paper
    mixed = training(model="castformer", optimiser={"epochs": 20, "learning_rate": plain.learning_rate})
    assert mixed.optimiser == OptimiserSettings(epochs=20, batch=16, learning_rate=plain.learning_rate)
    assert TrainSettings(model="castformer", optimiser=OptimiserSettings(epochs=20)).optimiser.batch == 16


def test_another_predictor_of_a_study_has_its_own_defaults() -> None:
    study = checked(Study, {"training": {"optimiser": {"epochs": 20}}, "sweep": {"models": ["castformer"]}}, "test")
    cells = {cell.model: study.training_of(cell.model, 5) for cell in study.cells}
    assert list(cells) == [FLOOR, "castformer"]
    assert cells[FLOOR].optimiser == OptimiserSettings(epochs=20)
    assert cells["castformer"].optimiser == OptimiserSettings(epochs=20, batch=16, learning_rate=1e-3)
    assert {settings.seed for settings in cells.values()} == {5}
    back = cells["castformer"].for_predictor(DEFAULT, 0)
    assert back == study.training


def test_stored_values_are_kept_whatever_the_defaults_are() -> None:
    """A card holds the resolved values, which count as given when it is read."""
    stored = training(optimiser={"epochs": 20}).model_dump(mode="json") | {"model": "castformer"}
    assert TrainSettings.model_validate(stored).optimiser == OptimiserSettings(epochs=20)
