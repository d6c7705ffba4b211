"""Tables as CSV and as a page."""

from __future__ import annotations

import csv
from pathlib import Path

from isac_cosim.evaluation.report.parts import Part, text_of, write_table
from isac_cosim.evaluation.statistics import Estimate
from isac_cosim.studies.reproduction.experiments.pages import FIGURES, write_pages
from isac_cosim.studies.reproduction.experiments.stages import identity_of

ROWS = [{"case": "truth", "F1": Estimate(value=0.5, low=0.4, high=0.6, sd=0.01), "paper": 0.9249}, {"case": "<b>"}]


def test_an_estimate_takes_the_columns_of_its_parts(tmp_path: Path) -> None:
    write_table(ROWS, tmp_path / "table.csv")
    with (tmp_path / "table.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert rows[0] == {
        "case": "truth",
        "F1": "0.5",
        "F1 low": "0.4",
        "F1 high": "0.6",
        "F1 sd": "0.01",
        "paper": "0.9249",
    }
    assert rows[1]["F1"] == ""


def test_cells_as_people_read_them() -> None:
    assert text_of(Estimate(value=0.5, low=0.4, high=0.6, sd=0.01)) == "0.500 ±0.010 (0.400 to 0.600)"
    assert text_of(Estimate(value=0.5)) == "0.500"
    assert text_of(Estimate(value=None)) == text_of(None) == "-"


def test_the_page_names_its_size_and_what_is_missing(tmp_path: Path) -> None:
    (tmp_path / FIGURES).mkdir()
    part = Part("table", "A table", "Words.", ROWS)
    for size, marked in (("quick", True), ("full", False)):
        page = write_pages("Title", identity_of("asi-bip", size, {}), [part], ["fig5: F1 by SNR"], tmp_path).read_text()
        assert ("say nothing about the paper" in page) is marked
        assert "fig5: F1 by SNR" in page
        assert "&lt;b&gt;" in page
