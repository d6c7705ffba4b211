"""The evaluation of a run on a dataset, as the command line shows it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from isac_cosim.command_line import output


def evaluate_and_show(
    run: Path, data: Path, out: Path | None, against: Sequence[Path], console: Console, explain: bool = False
) -> dict[str, Any]:
    """Evaluate a run on a dataset, write the report and show the scores. Returns what `--json` prints.

    explain: whether what the modules of a CaSTFormer do is shown as well.
    """
    from isac_cosim.evaluation.on_windows.evaluation import evaluate
    from isac_cosim.evaluation.report import report
    from isac_cosim.labeling.dataset.dataset import Dataset
    from isac_cosim.models.runs.run import load_run

    loaded, dataset = load_run(run), Dataset.open(data)
    folder = out or run / "evaluation"
    others = [load_run(path) for path in against]
    evaluation = evaluate(loaded, dataset, folder, against=others, explains=explain)
    page = report.write_report(evaluation, dataset, folder)
    output.note_former([loaded, *others], console)
    output.show_metrics(evaluation.result, page, console)
    return {"report": str(folder), **evaluation.result.model_dump(mode="json")}
