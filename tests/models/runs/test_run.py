"""The folder of a run: cards and files of earlier versions still open, and a training is not repeated for them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import checked
from isac_cosim.models.data.windows import Records, cut, draw_ends
from isac_cosim.models.predictors.asi_bip import AsiBipSettings
from isac_cosim.models.predictors.registry import sections
from isac_cosim.models.runs.run import RunCard, load_run, read_card
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.scores import open_set
from isac_cosim.models.training.training import train_records
from tests.support.made_up import MADE_OF, SMALL_RUN

STORED_CARD = """
{"schema_version": 1, "complete": true, "settings": {"model": "ensemble", "seed": 0, "held_out": null,
"windows": {"window_s": 1.2, "relative_to": "onset", "end_after_s": [0.5, 2.2], "frame": "relative"},
"split": {"validation": 0.15, "test": 0.25, "training_share": 1.0, "seed": 0}, "ends_per_record": 1,
"validation_ends": 2, "asi_bip": {"hidden": 12, "lstm_layers": 1, "width": 16, "encoder_layers": 2, "heads": 4,
"feedforward": 32, "norm_first": true, "dropout": 0.05, "attention_dropout": 0.0, "tokens": "pooled",
"tv_pool": 20, "uv_pool": 5, "lstm_bfloat16": false, "tv_patch": 1, "uv_patch": 1, "statistics": false},
"aligned": {"length": 220, "hidden": 64, "layers": 1, "dropout": 0.1}, "castformer": {"frame_s": 0.1,
"width": 64, "heads": 8, "encoder_layers": 2, "feedforward": 128, "dropout": 0.1, "causal_encoder": true,
"rsf": true, "cpe": true, "fsn": true, "order": "rsf-cpe-fsn", "attention": "bda", "delay_frames": 1,
"residual": false, "detach_mean": true, "intent_source": "in", "alpha": 0.1}, "trees": {"rounds": 10,
"learning_rate": 0.1, "leaves": 15, "l2": 1.0, "ends_per_record": 1}, "rule": {"smooth_s": 0.5,
"line_crossing_s": 1.5, "brake_mps2": 4.0, "accel_mps2": 2.5, "swerve_mps2": 3.0, "level_s": 30.0,
"fit": false}, "minirocket": {"features": 10000, "ends_per_record": 1}, "preludes": {"use": true,
"end_after_onset_s": [-0.6, -0.1], "ends_per_record": 1, "rounds": 20, "learning_rate": 0.1, "leaves": 15,
"l2": 1.0}, "augment": {"turn_deg": 0.0, "noise_m": 0.0, "noise_mps": 0.0, "noise_mps2": 0.0,
"mirror_share": 0.0}, "loss": {"gamma": 2.0, "exposure_weight": 0.0, "class_weights": true},
"optimiser": {"epochs": 3, "batch": 16, "learning_rate": 0.005, "betas": [0.9, 0.999], "weight_decay": 0.0,
"schedule": "cosine", "warmup_share": 0.1, "clip_norm": 1.0, "patience": 12, "threads": 1}},
"classes": ["hard_brake", "left_lane_change", "right_lane_change", "overtake", "hard_accel", "evasive_swerve"],
"split": {"train": ["toy-0", "toy-2", "toy-3", "toy-4", "toy-7"], "validation": ["toy-5"], "test": ["toy-1",
"toy-6"]}, "counts": {"hard_brake": 20, "left_lane_change": 20, "right_lane_change": 20, "overtake": 20,
"hard_accel": 20, "evasive_swerve": 20}, "tv_length": 480, "uv_length": 120, "tv_rate_hz": 400.0,
"uv_rate_hz": 100.0, "dataset": {"digest": "made up", "study": {"name": "made up"}},
"versions": {"isac-cosim": "0.2.0", "lightning": "2.6.6", "numpy": "2.4.6", "scikit-learn": "1.9.1",
"torch": "2.13.0+cpu"}, "best_epoch": 1, "parameters": 10038, "validation_macro_f1": 0.6648372411727905,
"unknown_score": "entropy", "unknown_threshold": -1.6658776874061754, "temperature": 0.25961018023580446,
"validation_auroc": {"msp": 0.9583333333333334, "max_logit": 0.9583333333333334, "energy": 0.5221354166666667,
"entropy": 0.9869791666666667, "knn": 0.5729166666666666, "mahalanobis": 0.6536458333333334,
"prelude": 0.8515625}}
"""
"""The card of an ensemble of SMALL_RUN, as the version before the registry of predictors wrote it."""
LATER_OPTIMISER_KEYS = {"accelerator": "auto", "devices": 1, "precision": "32-true"}
"""Keys that the stored card does not have yet, with their defaults, in order."""
FILES = {"weights.pt", "trees.skops", "preludes.skops", "reference.npz", "history.csv"}
"""Its files, under the names of then."""


@pytest.fixture(scope="module")
def stored(records: Records, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run with the stored card, beside the files of the same training."""
    folder = tmp_path_factory.mktemp("stored") / "run"
    train_records(records, MADE_OF, folder, SMALL_RUN.model_copy(update={"model": "ensemble"}))
    (folder / "pre_onset.skops").rename(folder / "preludes.skops")
    (folder / "run.json").write_text(STORED_CARD)
    return folder


def test_a_stored_run_opens_and_answers(stored: Path, records: Records, network_run, trees_run) -> None:  # type: ignore[no-untyped-def]
    run = load_run(stored)
    assert run.name == "ASI-BIP with trees"
    assert run.card.settings.of(AsiBipSettings).hidden == 12
    assert {path.name for path in stored.iterdir()} >= FILES
    assert run.reject_option is not None
    windows = cut(records, draw_ends(records, SMALL_RUN.windows, "test")[:12], SMALL_RUN.windows)
    mean = (network_run.predictor(windows).probabilities + trees_run.predictor(windows).probabilities) / 2
    np.testing.assert_allclose(run.predictor(windows).probabilities, mean, atol=1e-6)


def test_a_stored_card_is_written_back_with_the_same_keys_and_values(stored: Path) -> None:
    """Beside them the sections of predictors that came later, with their defaults, in the order of the registry.

    Pre-onset windows have their present name.
    """
    card = read_card(stored)
    assert card is not None
    expected = json.loads(STORED_CARD.replace('"preludes"', '"pre_onset"').replace('"prelude"', '"pre_onset"'))
    stored_settings = expected["settings"]
    of_predictors = {
        name: {**kind().model_dump(mode="json"), **stored_settings.get(name, {})} for name, kind in sections().items()
    }
    keys = list(stored_settings)
    first, last = keys.index("asi_bip"), keys.index("pre_onset")
    assert set(keys[first:last]) <= of_predictors.keys()
    expected["settings"] = {
        **{key: stored_settings[key] for key in keys[:first]},
        **of_predictors,
        **{key: stored_settings[key] for key in keys[last:]},
    }
    expected["settings"]["optimiser"] |= LATER_OPTIMISER_KEYS
    expected["settings"]["split"]["by"] = "seed"
    # Of a version that stored no digests.
    expected |= {"sha256": None, "files": {}, "lstm_precision": None, "validation_counts": None}
    assert card.model_dump(mode="json") == expected


def test_a_score_of_a_stored_run_has_its_present_name(stored: Path, records: Records) -> None:
    run = load_run(stored)
    windows = cut(records, draw_ends(records, SMALL_RUN.windows, "test")[:3], SMALL_RUN.windows)
    value = open_set.of_run(run)["pre_onset"](run.answer(windows))
    assert value.shape == (3,)
    assert run.card.validation_auroc["pre_onset"] == 0.8515625
    assert RunCard.model_validate(json.loads(STORED_CARD) | {"unknown_score": "prelude"}).unknown_score == "pre_onset"


def test_a_study_may_use_the_former_name_but_not_both() -> None:
    former = TrainSettings.model_validate({"preludes": {"rounds": 7}})
    assert former == TrainSettings.model_validate({"pre_onset": {"rounds": 7}})
    with pytest.raises(InputError, match=r"study: .*preludes: is the former name of pre_onset, which is given, too"):
        checked(TrainSettings, {"preludes": {"rounds": 7}, "pre_onset": {}}, "study")


def test_a_card_without_later_keys_opens(stored: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(stored, folder)
    content = json.loads(STORED_CARD)
    for section in ("rule", "minirocket", "augment"):
        del content["settings"][section]
    (folder / "run.json").write_text(json.dumps(content))
    assert load_run(folder).card == RunCard.model_validate_json(STORED_CARD)


def test_the_same_training_resumes_a_stored_run(
    stored: Path, records: Records, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("isac_cosim.models.training.training._fill", None)
    settings = SMALL_RUN.model_dump() | {"model": "ensemble"}
    # The default of then.
    settings["asi_bip"]["lstm_bfloat16"] = False
    run = train_records(records, MADE_OF, stored, TrainSettings.model_validate(settings))
    assert run.card.versions["torch"] == json.loads(STORED_CARD)["versions"]["torch"]
