"""Reproductions so small that the default tests run them: few instants, few scenes, networks of a few numbers."""

from __future__ import annotations

from typing import Any

from isac_cosim.studies.reproduction.experiments.sizes import RECORDS, SCENES, AsiBipSize, CastformerSize

SLOW_RATES = {"tv_rate_hz": 40.0, "uv_rate_hz": 20.0}
NETWORKS: dict[str, Any] = {
    "asi_bip": {"hidden": 4, "width": 8, "heads": 2, "encoder_layers": 1, "feedforward": 8},
    "aligned": {"length": 10, "hidden": 4},
    "castformer": {"width": 8, "heads": 2, "encoder_layers": 1, "feedforward": 8},
    "trees": {"rounds": 4},
}


def asi_bip(**changes: Any) -> AsiBipSize:
    """Return a size of which every stage takes about a second."""
    content: dict[str, Any] = {
        "training_seeds": (0,),
        "snr_db": (-10, 20),
        "literal_epochs": 1,
        "weather_chains": ("isac",),
        "dataset": {
            "seeds": {"first": 1, "last": 5},
            "selection": {"per_class": 1, "following": 1},
            "kinematics": {"per_class": 1, "following_scenes": 1},
            "record": SLOW_RATES,
        },
        "training": {
            **NETWORKS,
            "pre_onset": {"rounds": 2},
            "split": {"validation": 0.2, "test": 0.4},
            "optimiser": {"epochs": 1, "learning_rate": 1e-3},
        },
    }
    return AsiBipSize.model_validate(content | changes)


def castformer(**changes: Any) -> CastformerSize:
    """Return a size of which every stage takes about a second."""
    content: dict[str, Any] = {
        "training_seeds": (0, 1),
        "folds": 2,
        "alphas": (0.1,),
        "compared": ("trees",),
        "compared_epochs": 1,
        "dataset": {
            "seeds": {"first": 1, "last": 4},
            "selection": {"per_class": 1, "following": 0},
            "kinematics": {"per_class": 1, **SCENES},
            "record": {**RECORDS, **SLOW_RATES},
        },
        "training": {**NETWORKS, "optimiser": {"epochs": 1}},
    }
    return CastformerSize.model_validate(content | changes)
