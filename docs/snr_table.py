"""The table of docs/predictors.md that says which SNR a prediction needs, from the result of a sweep over SNRs.

    python docs/snr_table.py TABLE.json

Prints it in Markdown: a row for each way of sensing, and macro-F1 before the commit, and of all windows, for each
predictor, the mean over trainings with ± their standard deviation; and by how much a predictor is ahead of the floor on
the same windows, with the 95 % interval over test seeds.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from isac_cosim.evaluation.on_windows.results import ScoreName
from isac_cosim.evaluation.report.parts import interval_text, markdown, text_of
from isac_cosim.evaluation.statistics import Estimate
from isac_cosim.models import FLOOR
from isac_cosim.models.predictors.registry import PREDICTORS
from isac_cosim.studies.sweep_axes import WayOfSensing
from isac_cosim.studies.sweep_results import SweepResult, SweepRow

SHOWN: dict[ScoreName, str] = {"before_commit_macro_f1": "before the commit", "macro_f1": "all windows"}


def table(rows: Sequence[SweepRow]) -> str:
    """Return the table of a sweep over SNRs on one network, in which every cell has its predictors in one order."""
    head = ["per antenna element"]
    body: dict[WayOfSensing, list[str]] = {}
    for row in rows:
        name = PREDICTORS[row.model].display_name
        heads = [f"{name}, {title}" for title in SHOWN.values()]
        if row.before_commit_ahead_of_floor is not None:
            heads.append(f"{name} minus {PREDICTORS[FLOOR].display_name}, before the commit")
        head += [title for title in heads if title not in head]
        way = row.sensing
        cells = body.setdefault(way, ["true motion" if way.snr is None else f"{way.snr} dB"])
        cells += _scores(row) + _ahead(row)
    return markdown(head, body.values())


def _scores(row: SweepRow) -> list[str]:
    return [text_of(Estimate(value=mean, sd=sd)) for mean, sd in map(row.score, SHOWN)]


def _ahead(row: SweepRow) -> list[str]:
    ahead = row.before_commit_ahead_of_floor
    if ahead is None:
        return []
    return [f"{ahead:+.3f}{interval_text(row.before_commit_low, row.before_commit_high, sign='+')}"]


def main() -> None:
    """Print the table of the file that is named."""
    result = SweepResult.model_validate_json(Path(sys.argv[1]).read_text(encoding="utf-8"))
    windows = max(row.before_commit_windows or 0 for row in result.cells)
    print(f"### Macro-F1 by SNR: {windows:,} windows before the commit\n")
    print(table(result.cells))


if __name__ == "__main__":
    main()
