"""A run: the folder of one trained predictor, and the predictor loaded from it.

    RUN/run.json          what made it: settings, split, classes, dataset, versions
    RUN/weights.pt        tensors only, of the best epoch; trees are in trees.skops, an ensemble has both
    RUN/rule.json         instead of weights, the thresholds of the rule
    RUN/minirocket.npz    instead of weights, the arrays of a MiniRocket
    RUN/reference.npz     features of training windows, for the scores that compare with them
    RUN/preludes.skops    trees that know windows before onset, for the score that tells maneuvers from them
    RUN/history.csv       loss and scores of every epoch
    RUN/checkpoints/      what training resumes from

Nothing in it executes code when it is loaded.
"""

from __future__ import annotations

import pickle
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, Self

import numpy as np
import numpy.typing as npt
import skops.io
import torch
from pydantic import Field, model_validator
from sklearn.ensemble import HistGradientBoostingClassifier
from torch import nn

from isacsim.arrays import Array, Float32Array
from isacsim.errors import InputError
from isacsim.files import write_json
from isacsim.settings import Settings, read_json
from labeling.intentions import KNOWN, LANE_CHANGES, Intention
from models.data.augment import AugmentSettings
from models.data.windows import SplitSettings, Windows, WindowSettings
from models.predictors.asi_bip import AsiBip, AsiBipSettings, Streams
from models.predictors.castformer import Castformer, CastformerSettings
from models.predictors.floors import Aligned, AlignedSettings, TreesSettings, statistics
from models.predictors.losses import LossSettings
from models.predictors.minirocket import MinirocketSettings, Rocket, read_rocket
from models.predictors.network import WindowNetwork
from models.predictors.reject_option import PreludeSettings
from models.predictors.rule import RuleSettings, drive, logits

CARD_FILE, WEIGHTS_FILE, TREES_FILE, REFERENCE_FILE, PRELUDES_FILE, HISTORY_FILE = (
    "run.json", "weights.pt", "trees.skops", "reference.npz", "preludes.skops", "history.csv",
)  # fmt: skip
RULE_FILE, ROCKET_FILE = "rule.json", "minirocket.npz"
CHECKPOINTS = "checkpoints"
HeldOut = Literal["hard_brake", "left_lane_change", "right_lane_change", "overtake", "hard_accel", "evasive_swerve"]
Model = Literal["asi-bip", "tv-alone", "uv-alone", "aligned", "castformer", "ensemble", "trees", "rule", "minirocket"]
NAMES: dict[Model, str] = {
    "asi-bip": "ASI-BIP", "tv-alone": "TV alone", "uv-alone": "UV alone", "aligned": "aligned fusion",
    "castformer": "CaSTFormer", "ensemble": "ASI-BIP with trees", "trees": "boosted trees",
    "rule": "rule of the road", "minirocket": "MiniRocket",
}  # fmt: skip
DAMAGE = (
    OSError, RuntimeError, ValueError, LookupError, TypeError, AttributeError, EOFError, pickle.UnpicklingError,
    zipfile.BadZipFile, zlib.error,
)  # fmt: skip
"""What the readers of weights, trees and arrays raise on files that are cut off or not theirs."""
LEAST_PROBABILITY = 1e-12
"""Below it a probability has no logarithm worth having."""
TRUSTED = (
    "numpy.dtype",
    "sklearn._loss.link.Interval",
    "sklearn._loss.link.LogLink",
    "sklearn._loss.link.LogitLink",
    "sklearn._loss.link.MultinomialLogit",
    "sklearn._loss.loss.HalfBinomialLoss",
    "sklearn._loss.loss.HalfMultinomialLoss",
    "sklearn.ensemble._hist_gradient_boosting.binning._BinMapper",
    "sklearn.ensemble._hist_gradient_boosting.predictor.TreePredictor",
)
"""The only types, beside plain ones, that a file of trees may hold."""


class OptimiserSettings(Settings):
    """Adam and its schedule; the paper gives learning rate, betas and batch size."""

    epochs: int = Field(60, ge=1, description="epochs at most")
    batch: int = Field(32, ge=1, description="windows a step")
    learning_rate: float = Field(1e-4, gt=0, description="of Adam; the peak where the schedule is cosine")
    betas: tuple[float, float] = Field((0.9, 0.999), description="of Adam")
    weight_decay: float = Field(0.0, ge=0, description="decoupled weight decay")
    schedule: Literal["constant", "cosine"] = Field(
        "constant", description="cosine: linear warm-up, then half a cosine to 0"
    )
    warmup_share: float = Field(0.1, ge=0, lt=1, description="share of all steps that the learning rate rises over")
    clip_norm: float = Field(1.0, ge=0, description="gradients are scaled down to this norm; 0 leaves them")
    patience: int = Field(12, ge=1, description="epochs without a better validation macro-F1 before training stops")
    threads: int = Field(2, ge=1, description="CPU threads; the last digits of a result depend on it")


class TrainSettings(Settings):
    """What a predictor is, what it sees, and how it is trained."""

    model: Model = Field("asi-bip", description="the predictor")
    seed: int = Field(0, description="of initial weights, window ends and batches")
    held_out: HeldOut | None = Field(
        None, description="known intention that is left out of training, to be one more unknown in evaluation"
    )
    windows: WindowSettings = WindowSettings()
    split: SplitSettings = SplitSettings()
    ends_per_record: int = Field(1, ge=1, description="windows drawn anew of each record in an epoch")
    validation_ends: int = Field(2, ge=1, description="fixed windows of each validation record")
    asi_bip: AsiBipSettings = AsiBipSettings()
    aligned: AlignedSettings = AlignedSettings()
    castformer: CastformerSettings = CastformerSettings()
    trees: TreesSettings = TreesSettings()
    rule: RuleSettings = RuleSettings()
    minirocket: MinirocketSettings = MinirocketSettings()
    preludes: PreludeSettings = PreludeSettings()
    augment: AugmentSettings = AugmentSettings()
    loss: LossSettings = LossSettings()
    optimiser: OptimiserSettings = OptimiserSettings()

    @model_validator(mode="after")
    def _frame_can_turn(self) -> Self:
        if self.augment.turns_frame and self.windows.frame == "absolute":
            raise ValueError("augment turns or mirrors windows, which an absolute frame does not allow: choose another")
        return self

    @model_validator(mode="after")
    def _does_not_show_what_is_held_out(self) -> Self:
        if self.augment.mirror_share and self.left_out in LANE_CHANGES:
            raise ValueError(
                f"held_out {self.held_out}: mirrored lane changes would show it in training; set augment.mirror_share 0"
            )
        return self

    @property
    def left_out(self) -> Intention | None:
        """The intention held out, if any."""
        return None if self.held_out is None else Intention[self.held_out.upper()]


class RunCard(Settings):
    """`run.json`.

    classes: in the order of the logits. split: `<scenario>-<seed>` of each side. counts: training records a class.
    tv_length, uv_length: samples of a window. dataset: its digest and study. unknown_score: of the scores in
    `models.scores.open_set`, the one that told `following` apart best on the validation seeds (`validation_auroc`);
    what is below unknown_threshold is rejected: 95 % of the known validation windows are above it. temperature: what
    logits are divided by for calibrated probabilities, fitted on the validation seeds. parameters: trained numbers of
    a network.
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
    unknown_score: str = "msp"
    unknown_threshold: float | None = None
    temperature: float = 1.0
    validation_auroc: dict[str, float] = Field(default_factory=dict)


@dataclass(frozen=True)
class Outputs:
    """Of a batch of windows: logits (n, G), and features (n, F) of the layer before them."""

    logits: Array
    features: Array

    @property
    def probabilities(self) -> Array:
        """(n, G), rows sum to 1."""
        e = np.exp(self.logits - self.logits.max(axis=1, keepdims=True))
        return np.asarray(e / e.sum(axis=1, keepdims=True))


class Predictor(Protocol):
    """Anything that answers windows with logits."""

    def __call__(self, windows: Windows) -> Outputs: ...


@dataclass(frozen=True)
class NetworkPredictor:
    """A trained network on the CPU, in float32."""

    network: WindowNetwork

    def __call__(self, windows: Windows) -> Outputs:
        with torch.inference_mode():
            features = self.network.features(torch.from_numpy(windows.tv), torch.from_numpy(windows.uv))
            logits = self.network.classify(features)
        return Outputs(logits.double().numpy(), features.double().numpy())


@dataclass(frozen=True)
class TreesPredictor:
    """Trained trees; their features are the window's statistics. An intention they never saw is all but ruled out."""

    trees: Any

    def __call__(self, windows: Windows) -> Outputs:
        features = statistics(windows)
        said = np.asarray(self.trees.decision_function(features))
        if said.ndim == 1:  # of two classes, the second's log-odds
            said = np.stack([np.zeros_like(said), said], axis=1)
        return Outputs(among_known(said, self.trees.classes_), features.astype(np.float64))


@dataclass(frozen=True)
class RocketPredictor:
    """A trained MiniRocket; its features are its logits, for those of its transform are too many to keep."""

    rocket: Rocket

    def __call__(self, windows: Windows) -> Outputs:
        said = among_known(self.rocket.decide(windows), self.rocket.classes)
        return Outputs(said, said)


@dataclass(frozen=True)
class RulePredictor:
    """The rule of the road; its features are its logits."""

    settings: RuleSettings

    def __call__(self, windows: Windows) -> Outputs:
        said = logits(drive(windows, self.settings.smooth_s), self.settings)
        return Outputs(said, said)


@dataclass(frozen=True)
class EnsemblePredictor:
    """The mean of a network's and the trees' probabilities; its features are the network's."""

    network: NetworkPredictor
    trees: TreesPredictor

    def __call__(self, windows: Windows) -> Outputs:
        said, trees = self.network(windows), self.trees(windows)
        mean = (said.probabilities + trees.probabilities) / 2
        return Outputs(np.log(np.maximum(mean, LEAST_PROBABILITY)), said.features)


@dataclass(frozen=True)
class Run:
    """A finished run: its folder, its card, the predictor, and features (n, F) and labels (n,) of training windows.

    preludes: trees that tell maneuvers (1) from windows before onset (0) by their features, where they were learnt.
    """

    path: Path
    card: RunCard
    predictor: Predictor
    reference: tuple[Float32Array, npt.NDArray[np.int64]]
    preludes: Any | None = None

    @property
    def name(self) -> str:
        return NAMES[self.card.settings.model]


def load_run(path: str | Path) -> Run:
    """The predictor of a run's folder. InputError where it is none, unfinished or damaged."""
    folder = Path(path)
    card = read_card(folder)
    if card is None:
        raise InputError(f"{folder}: not a run (no {CARD_FILE} in it); make one with `cosim train`")
    if not card.complete:
        raise InputError(f"{folder}: training is not finished; run the same `cosim train` again to finish it")
    return open_run(folder, card)


def open_run(folder: Path, card: RunCard) -> Run:
    """The run in a folder whose card is known. InputError where it is damaged."""
    try:
        predictor = _load_predictor(folder, card)
        with np.load(folder / REFERENCE_FILE, allow_pickle=False) as stored:
            reference = (stored["features"], stored["label"])
        preludes = _read_trees(folder / PRELUDES_FILE) if (folder / PRELUDES_FILE).exists() else None
    except DAMAGE as error:
        reason = str(error).partition("\n")[0]
        raise InputError(f"{folder}: the run is damaged ({reason}); train it again") from None
    return Run(folder, card, predictor, reference, preludes)


def build_network(card: RunCard) -> WindowNetwork:
    """The untrained network of a run."""
    settings, n_classes = card.settings, len(card.classes)
    if settings.model == "aligned":
        return Aligned(settings.aligned, n_classes)
    if settings.model == "castformer":
        return Castformer(
            settings.castformer, n_classes, card.tv_length, card.uv_length, card.tv_rate_hz, card.uv_rate_hz
        )
    streams: dict[Model, Streams] = {"tv-alone": "tv", "uv-alone": "uv"}
    return AsiBip(settings.asi_bip, n_classes, card.tv_length, card.uv_length, streams.get(settings.model, "both"))


def among_known(said: Array, taught: npt.NDArray[np.integer]) -> Array:
    """Logits (n, G) of all known intentions from those (n, G') of the ones taught; the others are all but ruled out."""
    logits = np.repeat(said.min(axis=1, keepdims=True) + np.log(LEAST_PROBABILITY), len(KNOWN), axis=1)
    logits[:, taught] = said
    return logits


def read_card(folder: Path) -> RunCard | None:
    """A folder's `run.json`, or None where it has none. InputError where it is damaged or of another version."""
    return read_json(RunCard, folder / CARD_FILE)


def write_card(folder: Path, card: RunCard) -> None:
    """Write `run.json`."""
    write_json(folder / CARD_FILE, card.model_dump(mode="json"))


def _load_predictor(folder: Path, card: RunCard) -> Predictor:
    if card.settings.model == "trees":
        return _load_trees(folder)
    if card.settings.model == "rule":
        return RulePredictor(RuleSettings.model_validate_json((folder / RULE_FILE).read_bytes()))
    if card.settings.model == "minirocket":
        return RocketPredictor(read_rocket(folder / ROCKET_FILE, (card.tv_length, card.uv_length)))
    network = _load_network(folder, card)
    return EnsemblePredictor(network, _load_trees(folder)) if card.settings.model == "ensemble" else network


def _load_network(folder: Path, card: RunCard) -> NetworkPredictor:
    network = build_network(card)
    state: dict[str, torch.Tensor] = torch.load(folder / WEIGHTS_FILE, map_location="cpu", weights_only=True)
    nn.Module.load_state_dict(network, state)
    return NetworkPredictor(network.eval())


def _load_trees(folder: Path) -> TreesPredictor:
    return TreesPredictor(_read_trees(folder / TREES_FILE))


def _read_trees(path: Path) -> Any:
    found = skops.io.load(path, trusted=list(TRUSTED))
    if not isinstance(found, HistGradientBoostingClassifier):
        raise ValueError(f"{path.name} holds no trees")
    return found
