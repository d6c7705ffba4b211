"""A run: the folder of one trained predictor, its card, and the predictor loaded from it.

    RUN/run.json          the card: settings, split, classes, dataset, versions
    RUN/...               the files of the predictor: weights.pt, trees.skops, rule.json, minirocket.npz, or others
    RUN/reference.npz     features of training windows, for the unknown scores that compare with them
    RUN/pre_onset.skops   the reject option: trees that know windows before onset
    RUN/history.csv       of a network: loss and scores of every epoch
    RUN/checkpoints/      of a network: what training resumes from

Loading a run executes nothing that its files contain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, get_args

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from isac_cosim.base.arrays import Float32Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.files import DIGEST, file_digest, shortened
from isac_cosim.base.settings import Sealed, read_json, write_sealed
from isac_cosim.base.stored.arrays import check_array, read_arrays
from isac_cosim.base.stored.errors import READ_ERRORS, reason_of
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.data.windows import Windows
from isac_cosim.models.networks.checkpoints import HISTORY_FILE
from isac_cosim.models.predictors.protocol import Outputs, Predictor, WindowShape
from isac_cosim.models.runs import former_names
from isac_cosim.models.runs.former_names import OpenSetScore, present_file, present_score
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.trees.stored_trees import read_trees

if TYPE_CHECKING:
    from sklearn.ensemble import HistGradientBoostingClassifier

CARD_FILE, REFERENCE_FILE, REJECT_OPTION_FILE = "run.json", "reference.npz", former_names.FILE
SIDES = ("train", "validation", "test", "unused")
"""Sides of a split."""
MOST_SAMPLES = 1_000_000
"""Largest number of samples of a window."""
LARGEST = 1e30
"""No answer of a trained predictor is as large."""
FASTEST_HZ = 100_000.0
"""Highest sampling rate, Hz."""
UnknownScore = Literal["msp", "max_logit", "energy", "entropy", "knn", "mahalanobis", "pre_onset"]
"""Names of the scores in `models.scores.open_set`."""
Share = Annotated[float, Field(ge=0, le=1)]
FileName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$")]
Digest = Annotated[str, Field(pattern=DIGEST)]


class RunCard(Sealed):
    """The content of `run.json`.

    files: digest of each file of the predictor, and of the others in the folder that belong to the run, by name; empty
    in runs of earlier versions, schema 1. classes: the intentions, in the order of the logits. split:
    `<scenario>-<seed>` of each side. counts: training records per class. validation_counts: validation records per
    class; None on cards of earlier versions. tv_length, uv_length: samples per window. dataset: its digest and study.
    best_epoch, parameters, validation_macro_f1, lstm_precision: see `FitSummary`. unknown_score: of the scores in
    `models.scores.open_set`, the one that best separated `following` from the known intentions on the validation seeds;
    validation_auroc has the AUROC of each.
    unknown_threshold: windows that score below it are rejected; 95 % of the known validation windows score above it.
    temperature: logits are divided by it for calibrated probabilities; it is fitted on the validation seeds.
    """

    sealed_since: ClassVar[int] = 2

    schema_version: Literal[1, 2] = 2
    complete: bool
    settings: TrainSettings
    classes: tuple[str, ...]
    split: dict[str, list[str]]
    counts: dict[str, Annotated[int, Field(ge=0)]]
    validation_counts: dict[str, Annotated[int, Field(ge=0)]] | None = None
    tv_length: int = Field(ge=1, le=MOST_SAMPLES)
    uv_length: int = Field(ge=1, le=MOST_SAMPLES)
    tv_rate_hz: float = Field(gt=0, le=FASTEST_HZ)
    uv_rate_hz: float = Field(gt=0, le=FASTEST_HZ)
    dataset: dict[str, Any]
    versions: dict[str, str]
    files: dict[FileName, Digest] = Field(default_factory=dict)
    best_epoch: int | None = Field(None, ge=0)
    parameters: int | None = Field(None, ge=0)
    validation_macro_f1: Share | None = None
    lstm_precision: str | None = None
    unknown_score: Annotated[UnknownScore, BeforeValidator(present_score)] = "msp"
    unknown_threshold: float | None = None
    temperature: float = Field(1.0, ge=0.04, le=25.0)
    validation_auroc: dict[OpenSetScore, Share] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _is_of_one_training(self) -> Self:
        known = tuple(intention.text for intention in KNOWN)
        if self.classes != known:
            raise ValueError(f"classes: are not {', '.join(known)}")
        if unknown := self.split.keys() - set(SIDES):
            raise ValueError(f"split: {min(unknown)} is not one of {', '.join(SIDES)}")
        if missing := {*SIDES[:3]} - self.split.keys():
            raise ValueError(f"split: {min(missing)} is missing")
        if not isinstance(self.dataset.get("digest"), str) or not isinstance(self.dataset.get("study", {}), dict):
            raise ValueError("dataset: has no digest, or a study that is none")
        if unknown := self.validation_auroc.keys() - set(get_args(UnknownScore)):
            raise ValueError(f"validation_auroc: {min(unknown)} is not a score")
        for stream in ("tv", "uv"):
            length, rate_hz = getattr(self, f"{stream}_length"), getattr(self, f"{stream}_rate_hz")
            if abs(self.settings.windows.window_s * rate_hz - length) > 1:
                raise ValueError(f"{stream}_length: is not what settings.windows.window_s and {stream}_rate_hz give")
        if self.complete and self.schema_version > 1 and not self.files:
            raise ValueError("files: is empty")
        return self

    @property
    def validated(self) -> list[str] | None:
        """The classes that the validation records hold; None if the card does not say."""
        if self.validation_counts is None:
            return None
        return [name for name in self.classes if self.validation_counts.get(name)]

    @property
    def shape(self) -> WindowShape:
        """The shape of the predictor's windows and logits."""
        return WindowShape(len(self.classes), self.tv_length, self.uv_length, self.tv_rate_hz, self.uv_rate_hz)


@dataclass(frozen=True, repr=False)
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

    def __repr__(self) -> str:
        card = self.card
        lengths = f"{card.tv_length} and {card.uv_length} samples"
        return (
            f"<Run {shortened(self.path)}: {card.settings.model}, {len(card.classes)} intentions, {lengths} a window>"
        )

    @property
    def name(self) -> str:
        """The display name of the predictor."""
        return self.predictor.display_name

    @property
    def is_of_streams(self) -> bool:
        """Whether it was trained on streams; its answers are then the odds of each intention, whatever the others."""
        return self.card.settings.streams is not None

    def answer(self, windows: Windows) -> Outputs:
        """Return what the predictor answers to n windows, logits (n, G) and features (n, F).

        Raises InputError if an answer is not finite, or not of the width that the run's other files are made for.
        """
        # What a damaged network answers may be anything; of that, numpy need not warn.
        with np.errstate(all="ignore"):
            outputs = self.predictor(windows)
        widths = {"logits": len(self.card.classes), "features": self.reference[0].shape[1]}
        for name, width in widths.items():
            values = getattr(outputs, name)
            if values.shape != (len(windows), width):
                raise InputError(
                    f"{self.path}: {name} are of {values.shape[-1]} numbers a window, not {width}; its files belong to "
                    "different runs: train it again"
                )
            if not (np.abs(values) < LARGEST).all():
                raise InputError(
                    f"{self.path}: {name} are not finite, or beyond {LARGEST:g}: its files are damaged; train it again"
                )
        return outputs


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
    """Open the run in a folder whose card is known. Raises InputError if it is damaged or not the one that was made."""
    kind = card.settings.predictor_class
    kind.check_requirements()
    try:
        for name, digest in card.files.items():
            if file_digest(folder / name) != digest:
                raise ValueError(f"{name}: its bytes differ from the digest in {CARD_FILE}")
        predictor = kind.load(folder, card.settings, card.shape)
        reference = read_reference(folder / REFERENCE_FILE)
        reject_option = None
        if (stored := present_file(folder)).exists():
            reject_option = read_trees(stored, reference[0].shape[1], (0, 1))
        if card.unknown_score == former_names.SCORE and reject_option is None:
            raise ValueError(f"{stored.name}: is missing, on which unknown_score rests")
    except READ_ERRORS as error:
        raise InputError(f"{folder}: the run is damaged ({reason_of(error)}); train it again") from None
    return Run(folder, card, predictor, reference, reject_option)


def read_reference(path: Path) -> tuple[Float32Array, IntArray]:
    """Return the features (n, F) and labels (n,) of training windows in a file.

    Raises one of READ_ERRORS, which names the array, if it is damaged.
    """
    arrays = read_arrays(path)
    try:
        label = check_array(arrays, "label", "iu", (None,))
        features = check_array(arrays, "features", "f", (len(label), None))
        if not len(label) or not features.shape[1]:
            raise ValueError("features: are none")
        if not set(np.unique(label).tolist()) <= set(KNOWN):
            raise ValueError("label: is not a known intention in every row")
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}") from None
    return features, label


def files_written(folder: Path, write: Callable[[], object]) -> list[str]:
    """Return the names of the files in a folder that a call has written, each completely or not at all."""

    def marks() -> dict[str, tuple[int, int]]:
        states = {path.name: path.stat() for path in folder.iterdir() if path.is_file()}
        return {name: (state.st_ino, state.st_mtime_ns) for name, state in states.items()}

    before = marks()
    write()
    return sorted(name for name, mark in marks().items() if before.get(name) != mark)


def digests_of(folder: Path, names: Sequence[str]) -> dict[str, str]:
    """Return the digests of a run's files by name: of those named, and of the ones that a run may have beside them."""
    present = [name for name in (REFERENCE_FILE, REJECT_OPTION_FILE, HISTORY_FILE) if (folder / name).is_file()]
    return {name: file_digest(folder / name) for name in sorted({*names, *present})}


def read_card(folder: Path) -> RunCard | None:
    """Read a folder's `run.json`; None if it has none. Raises InputError if it is damaged or of another version."""
    return read_json(RunCard, folder / CARD_FILE)


def write_card(folder: Path, card: RunCard) -> None:
    """Write a folder's `run.json`. Raises OutputError."""
    write_sealed(folder / CARD_FILE, card)


def begin_run(folder: Path, card: RunCard) -> bool:
    """Write the card into a claimed folder that has none, and return whether the training is finished already.

    Raises InputError if the folder is another training's.
    """
    before = read_card(folder)
    if before is None:
        write_card(folder, card)
        return False
    if (before.settings, before.dataset.get("digest"), before.split) != (
        card.settings,
        card.dataset.get("digest"),
        card.split,
    ):
        raise InputError(f"{folder}: holds a run of other settings or another dataset; choose a new folder")
    return before.complete
