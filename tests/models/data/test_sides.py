"""Which records are on a side of a split by vehicle, and what is said of sides that depend on each other."""

from __future__ import annotations

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.labeling.dataset.dependence import Dependence
from isac_cosim.models.data.sides import on_side, trained_on, warning
from isac_cosim.models.data.split import SplitSettings
from tests.support.made_up import make_records

SIDES = {"train": ["toy-0", "toy-1"], "validation": ["toy-2"], "test": ["toy-3"]}


def test_a_vehicle_is_on_one_side_only() -> None:
    records = make_records(4, 2)
    scenario = str(records.table["scenario"].iloc[0])
    sides = {name: [group.replace("toy", scenario) for group in groups] for name, groups in SIDES.items()}
    number = records.table.groupby("seed").cumcount()
    records.table["tv_id"] = "v" + (number % 5).astype(str)
    # Every second vehicle departs at the same time in every seed.
    records.table["tv_departed"] = np.where(number % 2, 7.0, records.table["seed"] + 10.0)
    whole, parted = SplitSettings(), SplitSettings(by="vehicle")
    for side in sides:
        assert set(np.unique(records.groups[on_side(records, sides, side, whole)])) == set(sides[side])
    vehicle = records.table["tv_id"] + records.table["tv_departed"].astype(str)
    of = {side: set(vehicle[on_side(records, sides, side, parted)]) for side in sides}
    assert of["test"] == set(vehicle[records.table["seed"] == 3])
    assert of["train"]
    assert not of["train"] & (of["validation"] | of["test"])
    assert not of["validation"] & of["test"]
    assert set(vehicle[trained_on(records, sides, parted)]) == of["train"] | of["validation"]


def test_records_that_do_not_say_when_they_departed_are_not_split_by_vehicle() -> None:
    records = make_records(4, 2)
    with pytest.raises(InputError, match=r"tv_departed.*generate it anew.*or split by"):
        on_side(records, SIDES, "train", SplitSettings(by="vehicle"))


def test_the_warning_gives_the_shares() -> None:
    line = warning(Dependence(samples=19, shared_tv=17, shared_tvs=12, near_copies=11))
    assert line is not None
    assert "17 of 19 test samples have a TV that is also trained on; 58% are near copies" in line
    assert warning(Dependence(samples=19, shared_tv=0, shared_tvs=0, near_copies=0)) is None
    assert warning(None) is None
