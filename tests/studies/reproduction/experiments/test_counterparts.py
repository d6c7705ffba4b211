"""Every figure and table of both papers has a counterpart or a reason why not, and what the papers print is shown."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

import cosim
from isac_cosim.studies.reproduction.experiments.counterparts import ASI_BIP, CASTFORMER, Counterpart, counterparts_part
from isac_cosim.studies.reproduction.experiments.paper_figures import HORIZON, PRECISION_RECALL

DOCS = Path(cosim.__file__).parent / "docs"
NUMBERED = {
    "asi-bip": (ASI_BIP, ["Fig. 1", "Fig. 2", "Fig. 3", "Fig. 4", "Fig. 5", "Table I"]),
    "castformer": (CASTFORMER, [*(f"Fig. {k}" for k in range(1, 7)), *(f"Table {k}" for k in range(1, 6))]),
}


@pytest.mark.parametrize("paper", NUMBERED)
def test_nothing_of_a_paper_is_left_out(paper: str) -> None:
    counterparts, numbered = NUMBERED[paper]
    assert {item.source.partition("(")[0] for item in counterparts} >= set(numbered)
    for item in counterparts:
        assert item.here or item.why, item.source


@pytest.mark.parametrize("paper", NUMBERED)
def test_every_counterpart_is_a_table_of_the_stored_run(paper: str) -> None:
    printed = "".join(runpy.run_path(str(DOCS / "reproduction_tables.py"))["tables"](DOCS / "reproduction" / paper))
    assert "not run" not in printed.partition("### Where each figure and table is")[2]


def test_a_part_that_was_not_run_is_named() -> None:
    part = counterparts_part((Counterpart("Table 9", "something", "table9"),), [])
    assert part.rows[0]["here"] == "stage table9, not run"


def test_the_f1_that_the_paper_prints_is_about_that_of_its_precision_and_recall() -> None:
    for method, (precision, recall, f1) in PRECISION_RECALL.items():
        if precision is not None and recall is not None:
            assert 2 * precision * recall / (precision + recall) == pytest.approx(f1, abs=0.3), method
    assert PRECISION_RECALL["CaSTFormer"][2] == HORIZON["CaSTFormer"][0]
