"""What a predictor is: the base class of every predictor, what it is given to be fitted, and what it answers.

A function can stand in the place of one, to be measured.
"""

from __future__ import annotations

import importlib.util
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Self

import numpy as np

from isac_cosim.base.arrays import Array, Float32Array, IntArray
from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.settings import Settings
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.windows import Ends, Records, Windows, batches, draw_ends

LEAST_PROBABILITY = 1e-12
"""Probabilities are raised to this value before their logarithm is taken."""
STATISTICS_S = 0.09e-3
"""Processor time of the statistics of a default window, s."""


@dataclass(frozen=True)
class Outputs:
    """What a predictor answers for a batch of n windows.

    logits: (n, G), one column per known intention, in the order of `labeling.intentions.KNOWN`.
    features: (n, F), what the logits are computed from; the unknown scores compare them with those of training windows.
    exclusive: whether a window shows exactly one intention; otherwise each logit is the log-odds of its own intention,
    whatever the others are.
    """

    logits: Array
    features: Array
    exclusive: bool = True

    @property
    def probabilities(self) -> Array:
        """Softmax of the logits, or the sigmoid of each where they are not exclusive, (n, G)."""
        if not self.exclusive:
            return np.asarray(0.5 * (1.0 + np.tanh(self.logits / 2)))
        e = np.exp(self.logits - self.logits.max(axis=1, keepdims=True))
        return np.asarray(e / e.sum(axis=1, keepdims=True))

    def finite(self, source: object) -> Self:
        """Return these outputs. Raises RunError where one is NaN or infinite; source: the run, for its message."""
        odd = np.asarray(~(np.isfinite(self.logits).all(axis=1) & np.isfinite(self.features).all(axis=1)))
        if odd.any():
            raise RunError(
                f"{source}: answers {int(np.sum(odd))} of {len(self.logits)} windows with values that are not finite; "
                "its training diverged: train it anew with a lower learning rate"
            )
        return self


@dataclass(frozen=True)
class WindowShape:
    """The shape of what goes in and out of a predictor.

    n_classes: number of logits, G. tv_length, uv_length: samples per window of the TV's and of the UV's stream, taken
    at tv_rate_hz and uv_rate_hz.
    """

    n_classes: int
    tv_length: int
    uv_length: int
    tv_rate_hz: float
    uv_rate_hz: float


@dataclass(frozen=True)
class FitTask:
    """What a predictor is fitted on.

    training, validation: records of the intentions to learn; the test records are kept away. settings: those of the
    training; `settings.of(...)` gives the predictor's own section. shape: of the windows. folder: the run's folder,
    where a long training may keep what it resumes from. logs: whether networks write their curves for TensorBoard.
    """

    training: Records
    validation: Records
    settings: FitSettings
    shape: WindowShape
    folder: Path
    logs: bool = False

    def training_ends(self, per_record: int) -> tuple[Ends, IntArray]:
        """Draw `per_record` window ends from every training record. Returns them with their labels, (n,)."""
        ends = draw_ends(self.training, self.settings.windows, "train", self.settings.seed, 0, per_record=per_record)
        return ends, self.training.label[ends.row]

    def batches(self, ends: Ends, size: int = 256) -> Iterator[Windows]:
        """Cut the training windows with these ends, in order, `size` at a time."""
        return batches(self.training, ends, self.settings.windows, size)


@dataclass(frozen=True)
class Workload:
    """How many windows a training and its evaluation process, for estimates of time.

    training, validation: records. tested: windows that are evaluated. scale: length of a window relative to the default
    one of 2.2 s at 400 and 100 Hz.
    """

    training: float
    validation: float
    tested: float
    scale: float


@dataclass(frozen=True)
class FitSummary:
    """What a run's card says of a training in epochs; all None for predictors that are trained at once.

    best_epoch: the epoch whose weights are kept, from 0. parameters: trained numbers. validation_macro_f1: of that
    epoch. lstm_precision: in which the LSTMs of ASI-BIP were trained, "bfloat16" or "float32".
    """

    best_epoch: int | None = None
    parameters: int | None = None
    validation_macro_f1: float | None = None
    lstm_precision: str | None = None


class Predictor(ABC):
    """A predictor of intentions: it is fitted on records, saved to files, loaded again, and answers windows.

    To add one, subclass this in a file of `models/predictors` and add a line to `models.predictors.registry`; a package
    of your own offers it as an entry point of the group `isac_cosim.predictors`. Everything else (settings in study
    files and on cards, choices of the command line, messages, estimates, names in figures) follows from the class.
    Neural networks subclass `models.predictors.network_predictor.NetworkPredictor`, which has the training loop.

    An implementation declares:

    - display_name: how tables and figures name it, "ASI-BIP with trees".
    - summary: one line for help texts.
    - settings_class: the class of its own settings, each with a default; None if it has none. They are the section of a
      study `[training.<name>]`, with `_` for `-` in the name. Predictors with the same class share the section of the
      one that is registered first.
    - optimiser_defaults: keys of `OptimiserSettings` for which it has a default of its own.
    - optional_packages: packages that it needs beyond those of the project, with the command that installs each.
    - is_network: whether it is a single network that trains in epochs: its run holds a history and checkpoints, and it
      can be exported.

    fit_summary is what the card of a run says of the training; a fitted predictor may set it.
    """

    display_name: ClassVar[str]
    summary: ClassVar[str]
    settings_class: ClassVar[type[Settings] | None] = None
    optimiser_defaults: ClassVar[Mapping[str, object]] = {}
    optional_packages: ClassVar[Mapping[str, str]] = {}
    is_network: ClassVar[bool] = False
    fit_summary: FitSummary = FitSummary()

    @classmethod
    def check_requirements(cls) -> None:
        """Raise InputError, with the command that installs it, if an optional package is missing."""
        for package, command in cls.optional_packages.items():
            if importlib.util.find_spec(package) is None:
                raise InputError(f"{cls.display_name} needs the optional package {package}: {command}")

    @classmethod
    @abstractmethod
    def fit(cls, task: FitTask, feedback: Feedback) -> Self:
        """Return a predictor fitted on the task's training records.

        The same task gives the same predictor: draw all random numbers from `task.settings.seed`. A fit that was
        interrupted is called again with the same folder. feedback: where progress is reported.
        Raises InputError if the records or the settings do not allow it.
        """

    @abstractmethod
    def save(self, folder: Path) -> None:
        """Write the predictor's files into a run's folder, each by `base.files.replace_file`.

        The same predictor gives the same bytes. The names run.json, reference.npz, pre_onset.skops, history.csv and
        checkpoints are taken.
        """

    @classmethod
    @abstractmethod
    def load(cls, folder: Path, settings: FitSettings, shape: WindowShape) -> Self:
        """Return the predictor that `save` wrote into a folder.

        Loading never executes code from the files. If they are damaged, it raises one of
        `base.stored.errors.READ_ERRORS`, which the caller reports in one line.
        """

    @abstractmethod
    def __call__(self, windows: Windows) -> Outputs:
        """Return logits (n, G) and features (n, F) of n windows; each row depends on its own window alone."""

    @classmethod
    def cost_s(cls, workload: Workload, settings: FitSettings) -> float:
        """Return roughly what one training with its evaluation takes, s of processor time.

        The default is that of a predictor that computes simple statistics of every window once.
        """
        return STATISTICS_S * workload.scale * (workload.training * settings.ends_per_record + workload.tested)


Answer = Callable[[Float32Array, Float32Array], "Array | Outputs"]
"""Answers n windows, TV (n, 6, T) and UV (n, 6, U): probabilities (n, G) of the known intentions, or `Outputs`."""


class AskedPredictor(Predictor):
    """A function in the place of a predictor: somebody else's model, measured as this project's are.

    The features of an answer that has probabilities alone are its logits.
    """

    display_name = "a function"
    summary = "a function of windows, which Python gives to isac_cosim.evaluate"

    def __init__(self, answer: Answer, name: str) -> None:
        self._answer = answer
        self.display_name = name  # type: ignore[misc]  # of a class elsewhere, of a function here

    @classmethod
    def check_requirements(cls) -> None:
        raise InputError("a function is no predictor that can be trained or loaded: name another one")

    @classmethod
    def fit(cls, task: FitTask, feedback: Feedback) -> Self:
        raise NotImplementedError

    def save(self, folder: Path) -> None:
        raise NotImplementedError

    @classmethod
    def load(cls, folder: Path, settings: FitSettings, shape: WindowShape) -> Self:
        raise NotImplementedError

    def __call__(self, windows: Windows) -> Outputs:
        """Ask the function. Raises InputError where it does not answer with probabilities of the known intentions."""
        answer = self._answer(windows.tv, windows.uv)
        if isinstance(answer, Outputs):
            return answer
        probabilities = np.asarray(answer, dtype=np.float64)
        if probabilities.shape != (len(windows), len(KNOWN)):
            raise InputError(
                f"{self.display_name}: answers {len(windows)} windows with shape {probabilities.shape}; return "
                f"probabilities ({len(windows)}, {len(KNOWN)})"
            )
        if not ((probabilities >= 0).all() and np.allclose(probabilities.sum(axis=1), 1, atol=1e-3)):
            raise InputError(
                f"{self.display_name}: answers with numbers that are no probabilities; each row must add up to 1"
            )
        logits = np.log(np.maximum(probabilities, LEAST_PROBABILITY))
        return Outputs(logits, logits)


def among_known(logits: Array, taught: IntArray) -> Array:
    """Return logits (n, G) of all known intentions, given those (n, G') of the intentions `taught`, (G',).

    The intentions that were not taught get LEAST_PROBABILITY of the smallest of a window's logits.
    """
    every = np.repeat(logits.min(axis=1, keepdims=True) + np.log(LEAST_PROBABILITY), len(KNOWN), axis=1)
    every[:, taught] = logits
    return every
