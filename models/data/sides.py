"""Which records belong to a side of a split, and how far the sides depend on each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from isac_cosim.base.arrays import BoolArray
from isac_cosim.base.errors import InputError
from isac_cosim.labeling.dataset.dependence import HELP, Dependence, Driven, vehicles
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.split import SplitSettings
from isac_cosim.models.data.windows import Records

if TYPE_CHECKING:
    from isac_cosim.labeling.dataset.dataset import Dataset

Sides = Mapping[str, Sequence[str]]
"""Scenario seeds of each side, `<scenario>-<seed>`, as `models.data.split.split` returns them."""
TESTED_AFTER = {"train": ("validation", "test"), "validation": ("test",)}
"""The sides that keep a vehicle which is also on this one, where the split is by vehicle."""


def on_side(records: Records, sides: Sides, side: str, settings: SplitSettings) -> BoolArray:
    """Return which records belong to a side, (N,).

    With a split by vehicle, those whose TV is on a side that is measured later are left out. Raises InputError where
    that cannot be told, because the records do not say when their TVs departed.
    """
    groups = records.groups
    chosen = np.isin(groups, sides[side])
    if settings.by == "seed":
        return chosen
    if records.table.reindex(columns=["tv_departed"])["tv_departed"].isna().any():
        raise InputError(
            'training.split.by = "vehicle" needs the column tv_departed, which this dataset lacks or leaves empty: '
            'generate it anew from SUMO, or split by "seed"'
        )
    later = np.isin(groups, [group for name in TESTED_AFTER.get(side, ()) for group in sides.get(name, ())])
    vehicle = vehicles(records.table)
    return chosen & ~np.isin(vehicle, vehicle[later])


def is_taught(records: Records, settings: FitSettings) -> BoolArray:
    """Return which records are of an intention that is trained, (N,)."""
    return np.asarray(np.isin(records.label, [i for i in KNOWN if i is not settings.left_out]))


def taught(records: Records, sides: Sides, side: str, settings: FitSettings) -> Records:
    """Return the records of a side that are of an intention that is trained."""
    return records.take(is_taught(records, settings) & on_side(records, sides, side, settings.split))


def trained_on(records: Records, sides: Sides, settings: SplitSettings) -> BoolArray:
    """Return which records a run with this split was trained or chosen on, (N,)."""
    return on_side(records, sides, "train", settings) | on_side(records, sides, "validation", settings)


def dependence_of_test(dataset: Dataset, records: Records, sides: Sides, settings: SplitSettings) -> Dependence | None:
    """Return how many samples of the seeds that a run has not seen have a twin among those that it has.

    records: of the dataset, all of them. Returns None where the dataset holds no seed that the run was trained on, or
    none to test it on.
    """
    groups = records.groups
    known = [group for name, of_side in sides.items() if name != "test" for group in of_side]
    tested, trained = ~np.isin(groups, known), trained_on(records, sides, settings)
    if not (tested.any() and trained.any()):
        return None
    return Driven.of(dataset).between(tested, trained)


def warning(dependence: Dependence | None) -> str | None:
    """Return what to say of a test side that depends on the training side; None where it does not."""
    if dependence is None or not dependence.marked:
        return None
    shares = dependence.sentence("test samples", "trained on")
    return f"warning: {shares}: scores say little about other traffic; {HELP}"
