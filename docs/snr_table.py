"""The table of docs/predictors.md that says which SNR a prediction needs, from the result of a sweep over SNRs.

    python docs/snr_table.py TABLE.json

Prints it in Markdown: a row for each way of sensing, and macro-F1 before the commit, and of all windows, for each
predictor, the mean over trainings with ± their standard deviation.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from isac_cosim.evaluation.on_windows.results import ScoreName
from isac_cosim.evaluation.report.parts import markdown
from isac_cosim.models.predictors.registry import PREDICTORS
from isac_cosim.studies.sweep_results import SweepResult, SweepRow

SHOWN: dict[ScoreName, str] = {"before_commit_macro_f1": "before the commit", "macro_f1": "all windows"}


def table(rows: Sequence[SweepRow]) -> str:
    """Return the table of a sweep over SNRs on one network."""
    models = list(dict.fromkeys(row.model for row in rows))
    ways = {row.sensing: {other.model: other for other in rows if other.sensing == row.sensing} for row in rows}
    heads = [f"{PREDICTORS[model].display_name}, {title}" for model in models for title in SHOWN.values()]
    body = [
        ["true motion" if way.snr is None else f"{way.snr} dB"]
        + [_mean(of.get(model), score) for model in models for score in SHOWN]
        for way, of in ways.items()
    ]
    return markdown(["per antenna element", *heads], body)


def _mean(row: SweepRow | None, score: ScoreName) -> str:
    mean, sd = row.score(score) if row is not None else (None, None)
    if mean is None:
        return ""
    return f"{mean:.3f}" + (f" ±{sd:.3f}" if sd is not None else "")


def main() -> None:
    """Print the table of the file that is named."""
    result = SweepResult.model_validate_json(Path(sys.argv[1]).read_text(encoding="utf-8"))
    windows = max(row.before_commit_windows or 0 for row in result.cells)
    print(f"### Macro-F1 by SNR: {windows:,} windows before the commit\n")
    print(table(result.cells))


if __name__ == "__main__":
    main()
