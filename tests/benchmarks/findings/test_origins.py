"""The bench of origins: what is trained on, and that every seed is a test seed once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.feedback import SILENT
from isac_cosim.benchmarks.findings import origins as bench
from isac_cosim.labeling.intentions import Intention
from isac_cosim.models.data.windows import Records
from tests.support.made_up import SMALL_RUN, make_records

FOUR = [
    Intention.HARD_BRAKE,
    Intention.LEFT_LANE_CHANGE,
    Intention.RIGHT_LANE_CHANGE,
    Intention.OVERTAKE,
]


@pytest.fixture
def records() -> Records:
    """Six seeds; half the records of four intentions are natural, those of the others are not."""
    records = make_records(6, 4)
    alternating = np.arange(len(records)) % 2 == 0
    natural = alternating & np.isin(records.label, FOUR)
    records.table["origin"] = np.where(natural, "natural", np.where(records.label % 2, "reaction", "commanded"))
    return records


def test_every_training_has_as_many_records_of_each_intention(records: Records) -> None:
    natural = (records.table["origin"] == "natural").to_numpy()
    offered = np.isin(records.label, FOUR) & (records.table["seed"] != 0).to_numpy()
    rows = bench.training_rows(records, natural, offered, FOUR, 0)
    for origin, share in (("natural", 1.0), ("other", 0.0), ("both", 0.5)):
        assert natural[rows[origin]].mean() == share
        assert offered[rows[origin]].all()
        assert len(set(rows[origin])) == len(rows[origin])
        counts = np.bincount(records.label[rows[origin]], minlength=7)
        assert (counts == np.bincount(records.label[rows["natural"]], minlength=7)).all()


def test_every_seed_is_a_test_seed_once(records: Records, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "LEAST", 6)
    tested: dict[str, list[str]] = {}
    predict = bench.predict

    def noted(run, test, ends):  # type: ignore[no-untyped-def]
        trained_on = {group for groups in run.card.split.values() for group in groups}
        assert trained_on.isdisjoint(test.groups)
        tested.setdefault(run.path.name.partition("-")[0], []).extend(set(test.groups))
        return predict(run, test, ends)

    monkeypatch.setattr(bench, "predict", noted)
    monkeypatch.setattr(bench, "ENDS_PER_RECORD", 1)
    settings = SMALL_RUN.for_predictor("trees")
    result = bench.run(records, {"digest": "d"}, tmp_path, settings, 2, SILENT)
    assert {name: sorted(groups) for name, groups in tested.items()} == {
        name: sorted(set(records.groups)) for name in ("natural", "other", "both")
    }
    assert result["intentions"] == [intention.text for intention in FOUR]
    for row in result["trained_on"].values():
        assert row["natural"]["groups"] == row["other"]["groups"] == 6
        assert row["natural"]["n"] >= 10
