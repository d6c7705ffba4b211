"""The bundled studies: enough test seeds for their intervals to mean something."""

from __future__ import annotations

import importlib.resources
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.data.split import split
from isac_cosim.models.data.windows import Records
from isac_cosim.studies.study import read_study


@pytest.mark.parametrize(("name", "least"), [("quick", 8), ("full", 20), ("scene", 7)])
def test_a_bundled_study_is_tested_on_enough_seeds(name: str, least: int) -> None:
    study = read_study(Path(str(importlib.resources.files("isac_cosim.studies") / f"{name}.toml")))
    # Without a number of samples to reach, every seed is generated.
    assert study.dataset.selection.windows is None
    seeds = np.repeat(list(study.dataset.seeds), len(Intention))
    label = np.resize(np.arange(len(Intention)), len(seeds))
    table = pd.DataFrame({"scenario": "motorway", "seed": seeds, "label": label})
    empty = np.empty((len(table), 6, 0), np.float32)
    sides = split(Records(empty, empty, 400.0, 100.0, table), study.training.split)
    assert len(sides["test"]) >= least
    assert len(sides["train"]) > len(sides["test"])
