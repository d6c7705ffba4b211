"""`train`: from its arguments to a run on the console."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import shortened
from isac_cosim.base.progress import print_line
from isac_cosim.command_line import output

if TYPE_CHECKING:
    from isac_cosim.models.runs.run import Run
    from isac_cosim.models.runs.settings import TrainSettings


LOGS = "tensorboard"
"""What `--log` takes."""


@dataclass(frozen=True)
class TrainArguments:
    """The options of `train`; None where one is not given. uv, lanes, truth: of a training on streams.

    study: file whose `[training]` holds where no option says otherwise.
    """

    model: str | None = None
    epochs: int | None = None
    seed: int | None = None
    held_out: str | None = None
    training_share: float | None = None
    uv: bool | None = None
    lanes: bool | None = None
    truth: bool | None = None
    log: str | None = None
    study: Path | None = None

    def settings(self, of_streams: bool) -> TrainSettings:
        """Return the settings of the training. Raises InputError if options do not fit each other or the data."""
        from isac_cosim.base.settings import checked, merged
        from isac_cosim.models import DEFAULT
        from isac_cosim.models.hazards.registry import DEFAULT as DEFAULT_ON_STREAMS
        from isac_cosim.models.hazards.registry import STREAM_PREDICTORS
        from isac_cosim.models.predictors.registry import PREDICTORS
        from isac_cosim.models.runs.settings import TrainSettings

        seen = {"uv": self.uv, "lanes": self.lanes, "truth": self.truth}
        wrong = [f"--{name}" if value else f"--no-{name}" for name, value in seen.items() if value is not None]
        if not of_streams and wrong:
            raise InputError(f"{wrong[0]} applies to streams, and this is a dataset of records; remove it")
        if self.training_share is not None and not 0.0 < self.training_share <= 1.0:
            raise InputError(f"--training-share {self.training_share:g}: give a share above 0, and 1 at most")
        content = self._of_study()
        if not of_streams and "streams" in content:
            raise InputError(f"{self.study}: has [training.streams], and this is a dataset of records; remove it")
        content = {"model": DEFAULT_ON_STREAMS if of_streams else DEFAULT, **content}
        if self.model:
            content["model"] = self.model
        options: dict[str, Any] = {
            "seed": self.seed,
            "held_out": self.held_out,
            "split": {"training_share": self.training_share},
            "optimiser": {"epochs": self.epochs},
        }
        if of_streams:
            content = {"streams": {}, **content}
            options["streams"] = seen
        where = f"{self.study}, [training]" if self.study else "arguments"
        # By itself first: an option would otherwise replace a section that is no section, and hide that.
        model = checked(TrainSettings, content, where).model
        registry = STREAM_PREDICTORS if of_streams else PREDICTORS
        if self.epochs is not None and not registry[model].is_network:
            raise InputError(f"--epochs applies to networks: remove it, or --model {model}")
        return checked(TrainSettings, merged(content, _given(options)), where)

    def _of_study(self) -> dict[str, Any]:
        """Return `[training]` of the study, as it stands there. Raises InputError where there is none."""
        from isac_cosim.base.settings import read_toml

        if self.study is None:
            return {}
        content = read_toml(self.study).get("training")
        if not isinstance(content, dict):
            raise InputError(f"{self.study}: has no section [training]; give a study that has one")
        return content


def _given(options: dict[str, Any]) -> dict[str, Any]:
    """Return the options that are given, and sections with at least their given ones."""
    return {
        name: _given(value) if isinstance(value, dict) else value
        for name, value in options.items()
        if value is not None
    }


def train_and_show(data: Path, out: Path, arguments: TrainArguments, console: Console) -> dict[str, Any]:
    """Train a predictor on a dataset or on streams, and show how that ended. Returns what `--json` prints."""
    from isac_cosim.labeling.streams.dataset import META_FILE, Streams
    from isac_cosim.models.training.on_streams import train_on_streams

    if not (data / META_FILE).is_file():
        settings = arguments.settings(False)
        _check_log(arguments.log, settings.model)
        run = _on_records(data, out, settings, console, arguments.log is not None)
        if (out / LOGS).is_dir():
            print_line(console, f"tensorboard --logdir {out} shows the curves")
        return output.show_run(run, console)
    if arguments.log is not None:
        raise InputError("--log applies to a dataset of records, and these are streams; remove it")
    streams = Streams.open(data)
    run = train_on_streams(streams, out, arguments.settings(True), output.feedback_of(console))
    return output.show_run(run, console)


def _on_records(data: Path, out: Path, settings: TrainSettings, console: Console, logs: bool) -> Run:
    """Train a predictor on records, with a warning of what its scores will lack."""
    from isac_cosim.base.feedback import Foreword
    from isac_cosim.evaluation.on_windows.coverage import lacking
    from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
    from isac_cosim.labeling.dataset.dataset import Dataset
    from isac_cosim.models.training.training import train

    dataset = Dataset.open(data)
    foreword = Foreword(output.feedback_of(console), lacking(dataset, settings, EvaluateSettings()), output.warn)
    run = train(dataset, out, settings, foreword, logs=logs)
    foreword.say()
    return run


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
