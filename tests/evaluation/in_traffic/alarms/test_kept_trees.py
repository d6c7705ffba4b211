"""Trees are trained once, come back the same, and go when nobody asks for them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sklearn.ensemble import HistGradientBoostingClassifier

from isac_cosim.base.errors import InputError
from isac_cosim.evaluation.in_traffic.alarms.background import KeptTrees
from isac_cosim.evaluation.in_traffic.settings import BackgroundSettings

SETTINGS = BackgroundSettings(rounds=5)
DRAWN = np.random.default_rng(1)
FEATURES = DRAWN.normal(size=(400, 3)).astype(np.float32)
LABEL = (FEATURES[:, 0] > 0).astype(np.int64) + (FEATURES[:, 1] > 1)
WEIGHT = np.ones(len(LABEL))


def train(kept: KeptTrees, settings: BackgroundSettings = SETTINGS) -> np.ndarray:
    return np.asarray(kept.trained(FEATURES, LABEL, WEIGHT, settings).predict_proba(FEATURES))


def test_trees_are_trained_once_and_come_back_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trained = train(KeptTrees())
    first = train(KeptTrees(tmp_path / "trees"))
    monkeypatch.setattr(HistGradientBoostingClassifier, "fit", None)
    again = train(KeptTrees(tmp_path / "trees"))
    assert (trained == first).all()
    assert (trained == again).all()
    with pytest.raises(TypeError, match="not callable"):
        train(KeptTrees(tmp_path / "trees"), SETTINGS.model_copy(update={"leaves": 3}))


def test_a_damaged_file_is_reported(tmp_path: Path) -> None:
    train(KeptTrees(tmp_path))
    next(tmp_path.iterdir()).write_bytes(b"PK")
    with pytest.raises(InputError, match=r"\.skops: is damaged .*; delete it"):
        train(KeptTrees(tmp_path))


@pytest.mark.parametrize("changed", ["features", "label", "weight"])
def test_other_data_give_other_trees(tmp_path: Path, changed: str) -> None:
    kept, arrays = KeptTrees(tmp_path), {"features": FEATURES, "label": LABEL, "weight": WEIGHT}
    kept.trained(**arrays, settings=SETTINGS)
    other = arrays[changed].copy()
    other[0] += 1
    kept.trained(**{**arrays, changed: other}, settings=SETTINGS)
    assert len(list(tmp_path.iterdir())) == 2


def test_trees_that_nobody_asks_for_are_removed(tmp_path: Path) -> None:
    kept, others = KeptTrees(tmp_path), KeptTrees(tmp_path)
    train(kept)
    train(others, SETTINGS.model_copy(update={"leaves": 3}))
    (tmp_path / ".killed-1.skops").write_bytes(b"")
    (tmp_path / "notes.txt").write_text("mine")
    assert len(list(tmp_path.glob("*.skops"))) == 3
    kept.remove_others()
    assert len(list(tmp_path.glob("*.skops"))) == 1
    assert (tmp_path / "notes.txt").is_file()
    train(kept)
