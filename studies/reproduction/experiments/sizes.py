"""How large a reproduction is: full, at the papers' size, or quick, which only shows that everything runs."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from isac_cosim.base.settings import Settings

SizeName = Literal["full", "quick"]


class AsiBipSize(Settings):
    """Sizes of the reproduction of ASI-BIP.

    dataset, training: sections of a study that replace those of the bundled kinematic study, key by key.
    """

    training_seeds: tuple[int, ...] = Field((0, 1, 2), min_length=1, description="seeds of the trainings of each case")
    literal_epochs: int = Field(
        7, ge=1, description="epochs of the comparison of 1,101 tokens with pooled ones, one training each"
    )
    snr_db: tuple[float, ...] = Field(
        (-30, -25, -20, -15, -10, -5, 0, 5, 10, 15, 20), min_length=2, description="test SNRs of the fifth figure, dB"
    )
    weather_chains: tuple[str, ...] = Field(
        ("isac", "isac-padded-parabola", "isac-padded-grid", "isac-grid"),
        description="ISAC cases that are measured in adverse weather",
    )
    dataset: dict[str, Any] = Field(default_factory=dict, description="[dataset] keys that differ from the study's")
    training: dict[str, Any] = Field(default_factory=dict, description="[training] keys that differ from the study's")


class CastformerSize(Settings):
    """Sizes of the reproduction of CaSTFormer.

    dataset, training: as in `AsiBipSize`. motorway: `[dataset]` keys of the second source, None to leave it out.
    """

    background_share: float = Field(
        0.42,
        ge=0,
        lt=1,
        description="share of plain driving among the clips of the stage `background`, which 0 leaves out; in "
        "Brain4Cars 295 of 700",
    )
    training_seeds: tuple[int, ...] = Field(
        (0, 1, 2),
        min_length=1,
        description="training seeds of the main comparison, T-Base against each module and all; the first is that of "
        "every table",
    )
    folds: int = Field(5, ge=2, description="parts of the scenario seeds, each tested once")
    alphas: tuple[float, ...] = Field((0.01, 0.05, 0.1, 0.2, 0.5, 1.0), description="weights of the intention's loss")
    compared: tuple[str, ...] = Field(
        ("asi-bip", "aligned", "minirocket", "trees", "rule"), description="predictors beside CaSTFormer"
    )
    trained_end_s: tuple[float, float] = Field(
        (-4.0, 0.0), description="range of the window ends in training, s after the commit"
    )
    compared_epochs: int = Field(40, ge=1, description="most epochs of the compared networks")
    dataset: dict[str, Any] = Field(default_factory=dict)
    training: dict[str, Any] = Field(default_factory=dict)
    motorway: dict[str, Any] | None = None


PATCHED = {"tv_patch": 10, "uv_patch": 5}
"""Steps of 25 ms and 50 ms in the LSTMs, an extension that makes trainings short."""

ASI_BIP: dict[SizeName, AsiBipSize] = {
    # 20 epochs at the paper's rate keep every stage below an hour on two cores.
    "full": AsiBipSize(training={"optimiser": {"epochs": 20, "patience": 20}}),
    "quick": AsiBipSize(
        training_seeds=(0,),
        snr_db=(-30, -10, 10, 20),
        literal_epochs=1,
        weather_chains=("isac",),
        dataset={
            "seeds": {"first": 1, "last": 10},
            "selection": {"per_class": 3, "following": 3},
            "kinematics": {"per_class": 3, "following_scenes": 3},
        },
        training={
            "split": {"validation": 0.15, "test": 0.3},
            "optimiser": {"epochs": 4, "patience": 4, "learning_rate": 1e-3},
            "asi_bip": PATCHED,
        },
    ),
}
"""Sizes of the reproduction of ASI-BIP, by name."""

RECORDS = {"duration_s": 11.5, "before_onset_s": 6.5}
"""Records that hold a window of 2.2 s that ends 4 s before a commit right at the onset, and a commit 4.5 s after it."""
SCENES = {
    "lead_s": 8.0,
    "settle_s": 5.2,
    "following_scenes": 1,
    "situation": {"uv_speed_mps": [10, 17]},
}
"""Scenes of the kinematic source that are long enough for such records, and so slow that the sites see all of them."""

CASTFORMER: dict[SizeName, CastformerSize] = {
    "full": CastformerSize(
        dataset={
            "seeds": {"first": 1, "last": 25},
            "selection": {"per_class": 5, "following": 0},
            "kinematics": {"per_class": 5, **SCENES},
            "record": RECORDS,
        },
        # Half of the paper's 160 epochs: it keeps every stage below an hour on two cores.
        training={"optimiser": {"epochs": 80, "patience": 80}},
        motorway={"seeds": {"first": 1, "last": 25}, "selection": {"per_class": 10, "following": 0}, "record": RECORDS},
    ),
    "quick": CastformerSize(
        training_seeds=(0, 1),
        folds=2,
        alphas=(0.1, 1.0),
        compared=("asi-bip", "trees"),
        compared_epochs=3,
        dataset={
            "seeds": {"first": 1, "last": 8},
            "selection": {"per_class": 3, "following": 0},
            "kinematics": {"per_class": 3, **SCENES},
            "record": RECORDS,
        },
        training={"optimiser": {"epochs": 3, "patience": 3}, "asi_bip": PATCHED},
    ),
}
"""Sizes of the reproduction of CaSTFormer, by name."""
