"""The split of scenario seeds into those that train, those on which is chosen, and those that test."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.seeding import stream
from isac_cosim.base.setting_fields import Seed
from isac_cosim.base.settings import Settings
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.models.data.windows import Records


class SplitSettings(Settings):
    """Shares of the scenario seeds on each side.

    A demand that names its vehicles puts them into every seed, and so on every side, unless the split is by vehicle:
    records of training seeds whose TV is also one of a validation or test seed are then not trained on, and those of
    validation seeds whose TV is also one of a test seed nothing is chosen on (`models.data.sides`).
    """

    validation: float = Field(0.15, gt=0, lt=1, description="share of the seeds on which the best epoch is chosen")
    test: float = Field(0.25, gt=0, lt=1, description="share of the seeds on which nothing is chosen")
    training_share: float = Field(
        1.0, gt=0, le=1, description="share of the training seeds that is used; smaller shares are subsets"
    )
    seed: Seed = Field(0, description="seed of the split")
    by: Literal["seed", "vehicle"] = Field(
        "seed", description="vehicle: no vehicle of the demand is on two sides; records of shared ones stay in the test"
    )

    @model_validator(mode="after")
    def _leaves_training(self) -> Self:
        if self.validation + self.test >= 1:
            raise ValueError("validation and test shares leave no seed for training: lower one of them")
        return self


def split(records: Records, settings: SplitSettings) -> dict[str, list[str]]:
    """Split the scenario seeds into `train`, `validation` and `test`, each a sorted list of `<scenario>-<seed>`.

    Training seeds beyond `training_share` are on a side `unused`, which exists only if the share is below 1; validation
    and test seeds are the same for every share.

    Of many random splits, the one is chosen in which the fewest intentions are missing from a side, known ones first;
    among those, the one whose sides hold shares of every intention closest to the wanted ones. Raises InputError if
    there are fewer than 3 seeds.
    """
    groups, of_record = np.unique(records.groups.astype(str), return_inverse=True)
    if len(groups) < 3:
        raise InputError(
            f"the dataset has {len(groups)} scenario seed(s): train, validation and test need one each; add seeds"
        )
    counts = np.zeros((len(groups), len(Intention)))
    np.add.at(counts, (of_record, records.label), 1)
    n_test = max(1, round(settings.test * len(groups)))
    n_validation = max(1, round(settings.validation * len(groups)))
    n_test -= max(0, n_test + n_validation + 1 - len(groups))
    wanted = np.array([len(groups) - n_test - n_validation, n_validation, n_test]) / len(groups)
    side = np.repeat([0, 1, 2], [len(groups) - n_test - n_validation, n_validation, n_test])
    rng = stream("split", settings.seed)
    best = min((rng.permutation(side) for _ in range(500)), key=lambda s: _imbalance(s, counts, wanted))
    sides: dict[str, list[str]] = {
        name: groups[best == k].tolist() for k, name in enumerate(("train", "validation", "test"))
    }
    if settings.training_share < 1:
        order = stream("training share", settings.seed).permutation(sides["train"]).tolist()
        used = max(1, round(settings.training_share * len(order)))
        sides |= {"train": sorted(order[:used]), "unused": sorted(order[used:])}
    return sides


def _imbalance(side: IntArray, counts: Array, wanted: Array) -> tuple[int, int, float]:
    """Return known intentions missing from sides, all intentions missing, and the deviation from the wanted shares."""
    held = np.stack([counts[side == k].sum(axis=0) for k in range(3)])
    present = counts.sum(axis=0) > 0
    missing = (held == 0) & present
    share = held[:, present] / held[:, present].sum(axis=0)
    return int(missing[:, KNOWN].sum()), int(missing.sum()), float(np.abs(share - wanted[:, None]).sum())
