"""`train`: from its arguments to a run on the console."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from isac_cosim.command_line import output

if TYPE_CHECKING:
    from isac_cosim.models.runs.settings import TrainSettings


def train_and_show(data: Path, out: Path, settings: TrainSettings, console: Console) -> dict[str, Any]:
    """Train a predictor, with a warning of what its scores will lack, and show how that ended.

    Returns what `--json` prints.
    """
    from isac_cosim.base.feedback import Foreword
    from isac_cosim.evaluation.on_windows.coverage import lacking
    from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
    from isac_cosim.labeling.dataset.dataset import Dataset
    from isac_cosim.models.training.training import train

    dataset = Dataset.open(data)
    foreword = Foreword(output.feedback_of(console), lacking(dataset, settings, EvaluateSettings()), output.warn)
    run = train(dataset, out, settings, foreword)
    foreword.say()
    return output.show_run(run, console)
