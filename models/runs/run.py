"""A run: the folder of one trained predictor, its card, and the predictor loaded from it.

    RUN/run.json          the card: settings, split, classes, dataset, versions
    RUN/...               the files of the predictor: weights.pt, trees.skops, rule.json, minirocket.npz, or others
    RUN/reference.npz     features of training windows, for the unknown scores that compare with them
    RUN/preludes.skops    the reject option: trees that know windows before onset
    RUN/history.csv       of a network: loss and scores of every epoch
    RUN/checkpoints/      of a network: what training resumes from

Loading a run executes nothing that its files contain.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field
from sklearn.ensemble import HistGradientBoostingClassifier

from isac_cosim.base.arrays import Float32Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.files import write_json
from isac_cosim.base.settings import Settings, read_json
from isac_cosim.models.networks.checkpoints import READ_ERRORS
from isac_cosim.models.predictors.protocol import Predictor, WindowShape
from isac_cosim.models.predictors.registry import PREDICTORS
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.trees.stored_trees import read_trees

CARD_FILE, REFERENCE_FILE, REJECT_OPTION_FILE = "run.json", "reference.npz", "preludes.skops"


class RunCard(Settings):
    """The content of `run.json`.

    classes: the intentions, in the order of the logits. split: `<scenario>-<seed>` of each side. counts: training
    records per class. tv_length, uv_length: samples per window. dataset: its digest and study. best_epoch, parameters,
    validation_macro_f1, lstm_precision: see `FitSummary`. unknown_score: of the scores in `models.scores.open_set`, the
    one that best separated `following` from the known intentions on the validation seeds; validation_auroc has the
    AUROC of each.
    unknown_threshold: windows that score below it are rejected; 95 % of the known validation windows score above it.
    temperature: logits are divided by it for calibrated probabilities; it is fitted on the validation seeds.
    """

    schema_version: Literal[1] = 1
    complete: bool
    settings: TrainSettings
    classes: tuple[str, ...]
    split: dict[str, list[str]]
    counts: dict[str, int]
    tv_length: int
    uv_length: int
    tv_rate_hz: float
    uv_rate_hz: float
    dataset: dict[str, Any]
    versions: dict[str, str]
    best_epoch: int | None = None
    parameters: int | None = None
    validation_macro_f1: float | None = None
    lstm_precision: str | None = None
    unknown_score: str = "msp"
    unknown_threshold: float | None = None
    temperature: float = 1.0
    validation_auroc: dict[str, float] = Field(default_factory=dict)

    @property
    def shape(self) -> WindowShape:
        """The shape of the predictor's windows and logits."""
        return WindowShape(len(self.classes), self.tv_length, self.uv_length, self.tv_rate_hz, self.uv_rate_hz)


@dataclass(frozen=True)
class Run:
    """A finished run.

    path: its folder. reference: features (n, F) and labels (n,) of training windows. reject_option: trees whose class 1
    are maneuvers and class 0 pre-onset windows, by their features; None if there are none.
    """

    path: Path
    card: RunCard
    predictor: Predictor
    reference: tuple[Float32Array, IntArray]
    reject_option: HistGradientBoostingClassifier | None = None

    @property
    def name(self) -> str:
        """The display name of the predictor."""
        return self.predictor.display_name


def load_run(path: str | Path) -> Run:
    """Load a finished run from its folder. Raises InputError if it is not a run, not finished or damaged."""
    folder = Path(path)
    card = read_card(folder)
    if card is None:
        raise InputError(f"{folder}: not a run (no {CARD_FILE} in it); make one with `cosim train`")
    if not card.complete:
        raise InputError(f"{folder}: training is not finished; run the same `cosim train` again to finish it")
    return open_run(folder, card)


def open_run(folder: Path, card: RunCard) -> Run:
    """Open the run in a folder whose card is known. Raises InputError if it is damaged."""
    kind = PREDICTORS[card.settings.model]
    kind.check_requirements()
    try:
        predictor = kind.load(folder, card.settings, card.shape)
        with np.load(folder / REFERENCE_FILE, allow_pickle=False) as stored:
            reference = (stored["features"], stored["label"])
        reject_option = read_trees(folder / REJECT_OPTION_FILE) if (folder / REJECT_OPTION_FILE).exists() else None
    except READ_ERRORS as error:
        reason = str(error).partition("\n")[0]
        raise InputError(f"{folder}: the run is damaged ({reason}); train it again") from None
    return Run(folder, card, predictor, reference, reject_option)


def read_card(folder: Path) -> RunCard | None:
    """Read a folder's `run.json`; None if it has none. Raises InputError if it is damaged or of another version."""
    return read_json(RunCard, folder / CARD_FILE)


def write_card(folder: Path, card: RunCard) -> None:
    """Write a folder's `run.json`. Raises OutputError."""
    write_json(folder / CARD_FILE, card.model_dump(mode="json"))
