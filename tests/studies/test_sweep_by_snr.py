"""The curve of a sweep over the SNR: which cells are on it, and what its line is called."""

from __future__ import annotations

from pathlib import Path

from isac_cosim.evaluation.report.html.charts import Chart
from isac_cosim.studies.sweep_results import SweepRow
from isac_cosim.studies.sweep_table import HEADINGS, SNR, by_snr, draw_by_snr

SCORE = HEADINGS["before_commit_macro_f1"]


def row(model: str, snr: str | None, score: float | None, network: str = "north") -> SweepRow:
    nothing = dict.fromkeys(
        name for name in SweepRow.model_fields if name.startswith(("before", "macro", "auroc", "acc"))
    )
    given = {"network": network, "tested_on": network, "sensor": "isac", "snr": snr, "model": model, "report": "r"}
    counts = {"trainings": 2, "test_seeds": 2, "windows": 10, "runs": []}
    ahead = dict.fromkeys(("ahead_of_floor", "low", "high"))
    return SweepRow.model_validate({**nothing, **ahead, **given, **counts, "before_commit_macro_f1": score})


def test_cells_at_one_snr_each_are_a_line_by_predictor(tmp_path: Path) -> None:
    cells = [
        row("a", "10", 0.8),
        row("a", "-5", 0.25),
        row("b", "-5", None),
        row("a", "0:10", 0.5),
        row("a", None, 0.5),
    ]
    rows = by_snr(cells)
    (line,) = Chart(SNR, (SCORE,)).content(rows)["lines"]
    assert (line["name"], line["x"], line["y"]) == ("a", [-5.0, 10.0], [0.25, 0.8])
    draw_by_snr(rows, tmp_path / "snr.png")
    assert (tmp_path / "snr.png").stat().st_size > 5000


def test_lines_of_several_networks_say_which(tmp_path: Path) -> None:
    rows = by_snr([row("a", snr, 0.5, network) for network in ("north", "south") for snr in ("0", "5")])
    assert {line["name"] for line in Chart(SNR, (SCORE,)).content(rows)["lines"]} == {"a, north", "a, south"}


def test_a_single_snr_is_no_curve() -> None:
    assert by_snr([row("a", "5", 0.5), row("b", "5", 0.6), row("a", "link", 0.7)]) == []
