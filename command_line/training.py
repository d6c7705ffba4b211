"""`train`: from its arguments to a run on the console."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import shortened
from isac_cosim.base.progress import print_line
from isac_cosim.command_line import output

if TYPE_CHECKING:
    from isac_cosim.models.runs.settings import TrainSettings


LOGS = "tensorboard"
"""What `--log` takes."""


def train_and_show(
    data: Path, out: Path, settings: TrainSettings, console: Console, log: str | None = None
) -> dict[str, Any]:
    """Train a predictor, with a warning of what its scores will lack, and show how that ended.

    log: what `--log` gives. Returns what `--json` prints. Raises InputError where nothing can be logged as it says.
    """
    _check_log(log, settings.model)
    from isac_cosim.base.feedback import Foreword
    from isac_cosim.evaluation.on_windows.coverage import lacking
    from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
    from isac_cosim.labeling.dataset.dataset import Dataset
    from isac_cosim.models.training.training import train

    dataset = Dataset.open(data)
    foreword = Foreword(output.feedback_of(console), lacking(dataset, settings, EvaluateSettings()), output.warn)
    run = train(dataset, out, settings, foreword, logs=log is not None)
    foreword.say()
    if (out / LOGS).is_dir():
        print_line(console, f"tensorboard --logdir {out} shows the curves")
    return output.show_run(run, console)


def _check_log(log: str | None, model: str) -> None:
    """Raise InputError where `--log` names something else than LOGS, or what is not installed, or no network."""
    if log is None:
        return
    if log != LOGS:
        raise InputError(f"--log {shortened(log)}: curves can be logged for {LOGS} alone; give --log {LOGS}")
    if find_spec(LOGS) is None:
        raise InputError(f"--log {LOGS} needs TensorBoard: pip install '.[{LOGS}]' in a checkout")
    from isac_cosim.models.predictors.registry import PREDICTORS

    if not PREDICTORS[model].is_network:
        raise InputError(f"--log applies to networks, which learn in epochs: remove it, or --model {model}")
