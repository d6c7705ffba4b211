"""The training loop of every network, run by Lightning: resumable after any epoch, the best epoch is kept."""

from __future__ import annotations

import logging
import multiprocessing
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import lightning
from lightning.pytorch.callbacks import Callback, EarlyStopping, LambdaCallback, ModelCheckpoint
from lightning.pytorch.loggers import TensorBoardLogger
from lightning.pytorch.strategies import DDPStrategy
from torch.multiprocessing.spawn import ProcessRaisedException

from isac_cosim.base.feedback import Feedback
from isac_cosim.base.temporary import TemporaryFolder
from isac_cosim.labeling.intentions import KNOWN, over_text
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.windows import Records
from isac_cosim.models.networks.checkpoints import HISTORY_FILE
from isac_cosim.models.networks.lightning_checkpoints import Checkpoints, read_checkpoint
from isac_cosim.models.networks.lightning_module import (
    MONITOR,
    DivergedError,
    EpochProgress,
    History,
    Monitor,
    NetworkModule,
    TrainedModule,
    WindowData,
)
from isac_cosim.models.networks.losses import inverse_frequency
from isac_cosim.models.networks.network import WindowNetwork
from isac_cosim.models.networks.several_devices import PrivateDDP

CHECKPOINTS = "checkpoints"
LOGS = "tensorboard"
"""Folder of the curves that TensorBoard shows."""
LAST = "last"
"""Name of the checkpoint of the last epoch, from which an interrupted training goes on."""
NETWORK_PREFIX = "network."
"""What Lightning puts before the names of the network's tensors in a checkpoint."""


@dataclass(frozen=True)
class BestEpoch:
    """The epoch whose weights are kept: its number, from 0, and its score on the validation windows."""

    best_epoch: int
    score: float


def fit_network(
    network: WindowNetwork,
    training: Records,
    validation: Records,
    settings: FitSettings,
    folder: Path,
    feedback: Feedback,
    logs: bool = False,
) -> BestEpoch:
    """Train a network, or resume where its training stopped, and give it the weights of the best epoch.

    training, validation: records of the intentions to learn. folder: the run's, where the history and the checkpoints
    are kept. feedback: where progress is reported. logs: whether the curves are also written for TensorBoard, into
    LOGS in the folder. Raises InputError if a checkpoint is damaged, OutputError if nothing can be written,
    DivergedError if a loss is not finite.
    """
    # Networks do not look at lanes, and the lookup of lane maps cannot be sent to other processes.
    data = WindowData(replace(training, lane_maps=None), replace(validation, lane_maps=None), settings)
    network.fit_scale(*data.first_windows())
    alpha = inverse_frequency(training.label, network.n_classes) if settings.loss.class_weights else None
    monitor = Monitor(MONITOR, "max", "macro-F1", over_text(data.validated, KNOWN))
    return fit_module(NetworkModule(network, settings, alpha), data, monitor, folder, feedback, logs)


def fit_module(
    module: TrainedModule,
    data: lightning.LightningDataModule,
    monitor: Monitor,
    folder: Path,
    feedback: Feedback,
    logs: bool = False,
) -> BestEpoch:
    """Train a module's network, or resume where its training stopped; otherwise as `fit_network`."""
    best = _run_epochs(module, data, monitor, folder, feedback, logs)
    weights = {
        name.removeprefix(NETWORK_PREFIX): value
        for name, value in best["state_dict"].items()
        if name.startswith(NETWORK_PREFIX)
    }
    module.network.load_state_dict(weights)
    keepers = (state for name, state in best["callbacks"].items() if name.startswith("ModelCheckpoint"))
    monitored = next(state for state in keepers if state["monitor"] == monitor.name)
    return BestEpoch(int(best["epoch"]), float(monitored["current_score"]))


def _run_epochs(
    module: TrainedModule,
    data: lightning.LightningDataModule,
    monitor: Monitor,
    folder: Path,
    feedback: Feedback,
    logs: bool,
) -> dict[str, Any]:
    """Train to the last epoch, and return the checkpoint of the best one."""
    optimiser, checkpoints = module.settings.optimiser, folder / CHECKPOINTS
    stopping = EarlyStopping(monitor.name, mode=monitor.mode, patience=optimiser.patience)
    keep = partial(_Keeper, checkpoints, enable_version_counter=False, save_on_train_epoch_end=True)
    best = keep("best", monitor=monitor.name, mode=monitor.mode)
    history = History(folder / HISTORY_FILE)
    callbacks: list[Callback] = [
        history,
        stopping,
        best,
        keep(LAST),  # after the best: what it says of the best one is then of the same epoch
        LambdaCallback(on_train_start=partial(_stay_stopped, stopping)),
        EpochProgress(feedback, history, module.settings.model, monitor),
    ]
    last = checkpoints / f"{LAST}.ckpt"
    with _quiet(), ExitStack() as stack:
        strategy: str | DDPStrategy = "auto"
        if optimiser.devices > 1:
            strategy = PrivateDDP(stack.enter_context(TemporaryFolder()).path)
        trainer = lightning.Trainer(
            accelerator=optimiser.accelerator, devices=optimiser.devices,
            strategy=strategy, precision=optimiser.precision,
            max_epochs=optimiser.epochs, callbacks=callbacks,
            gradient_clip_val=optimiser.clip_norm or None,
            logger=TensorBoardLogger(folder, name=LOGS, version="") if logs else False,
            num_sanity_val_steps=0, enable_progress_bar=False, enable_model_summary=False, default_root_dir=folder,
            plugins=[Checkpoints()],
        )  # fmt: skip
        try:
            trainer.fit(module, datamodule=data, ckpt_path=last if last.exists() else None, weights_only=True)
        except SystemExit:
            # Lightning turns Ctrl-C into an exit of its own, and leaves the processes of several devices at work.
            for process in multiprocessing.active_children():
                process.kill()
            raise KeyboardInterrupt from None
        except ProcessRaisedException as error:
            # Of a process that trained on one of several devices, only the text comes back.
            name, _, reason = str(error).rstrip().rpartition("\n")[2].partition(": ")
            if name.endswith(DivergedError.__name__):
                raise DivergedError(reason) from None
            raise
    return read_checkpoint(Path(best.best_model_path))


class _Keeper(ModelCheckpoint):
    """Lightning's keeper of checkpoints, whose state is read back whole: Lightning leaves out the latest score."""

    @property
    def state_key(self) -> str:
        """The name under which checkpoints keep the state."""
        return super().state_key.replace(type(self).__qualname__, ModelCheckpoint.__qualname__)

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Take the state from a checkpoint."""
        super().load_state_dict(state_dict)
        self.current_score = state_dict["current_score"]


def _stay_stopped(stopping: EarlyStopping, trainer: lightning.Trainer, _: lightning.LightningModule) -> None:
    """Train no further epoch if training had stopped early before it was interrupted."""
    trainer.should_stop = trainer.should_stop or stopping.stopped_epoch > 0


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence Lightning's hints on devices, workers and data loaders, which do not apply here."""
    loggers = [logging.getLogger(name) for name in ("lightning.pytorch", "lightning.fabric", "lightning")]
    levels = [logger.level for logger in loggers]
    try:
        for logger in loggers:
            logger.setLevel(logging.ERROR)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module=r"lightning.*|torch\..*")
            yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
