"""The base of predictors trained on streams: from hazards to the log-odds of every intention."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator
from torch import nn

from isac_cosim.base.arrays import Array, BoolArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.files import replace_file
from isac_cosim.base.settings import Settings, read_json
from isac_cosim.labeling.intentions import KNOWN, LANE_CHANGES, Intention
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.windows import Windows, WindowSettings
from isac_cosim.models.hazards.answers import IGNORED, WITH_HAZARD
from isac_cosim.models.hazards.settings import Horizon, StreamFitSettings
from isac_cosim.models.hazards.sight import without_uv
from isac_cosim.models.networks.checkpoints import read_weights, write_weights
from isac_cosim.models.predictors.network_predictor import WEIGHTS_FILE
from isac_cosim.models.predictors.protocol import FitSummary, FitTask, Outputs, Predictor, WindowShape

if TYPE_CHECKING:
    from isac_cosim.models.hazards.decisions import StreamSide

HAZARDS_FILE = "hazards.json"
NEVER = -20.0
"""The log-odds of what is never named."""
LEAST_TO_CALIBRATE = 50
"""Fewest positive validation decisions on which log-odds are calibrated."""


class PlattScaling(Settings):
    """What makes calibrated log-odds of raw ones: `slope` times them, plus `offset` (Platt 1999)."""

    slope: float = Field(1.0, gt=0)
    offset: float = 0.0


class HazardFacts(Settings):
    """What a predictor trained on streams is, besides its weights.

    horizons_s: ends of the intervals, s. learned: the intentions that had enough events; the others are never named.
    passing: whether it was learned if a pull-out passes. change_out: the change of lane that pull-outs are. uv, lanes:
    whether the predictor sees the UV's reports and the lanes. windows: how windows are cut. calibration: of each
    learned intention. decision_s: time between two decisions of the streams, s.
    """

    horizons_s: tuple[Horizon, ...] = Field(min_length=1)
    learned: tuple[str, ...]
    passing: bool
    change_out: str
    uv: bool
    lanes: bool
    windows: WindowSettings
    calibration: dict[str, PlattScaling] = Field(default_factory=dict)
    decision_s: Annotated[float, Field(gt=0)]
    hours: Annotated[float, Field(ge=0)]
    events: dict[str, Annotated[int, Field(ge=0)]]

    @model_validator(mode="after")
    def _is_of_asked(self) -> Self:
        asked = [intention.text for intention in WITH_HAZARD]
        if unknown := {*self.learned, *self.calibration} - set(asked):
            raise ValueError(f"learned or calibration: {min(unknown)} is not one of {', '.join(asked)}")
        if self.change_out not in [change.text for change in LANE_CHANGES]:
            raise ValueError(f"change_out: {self.change_out} is not a change of lane")
        return self

    @property
    def is_learned(self) -> BoolArray:
        """Which of WITH_HAZARD are learned, (5,)."""
        return np.array([intention.text in self.learned for intention in WITH_HAZARD])


@dataclass(frozen=True)
class Hazards:
    """What a predictor says of n windows, as log-odds.

    intervals: that an intention of WITH_HAZARD begins within each interval, if not in an earlier one, (n, 5, H).
    passing: that a pull-out, if it is one, passes the UV, (n,).
    """

    intervals: Array
    passing: Array


@dataclass(frozen=True)
class StreamTask:
    """What a predictor is fitted on: decisions to learn from, and others to choose and calibrate on.

    fit: settings of the training, of which `settings` are those that concern streams. folder: of the run.
    """

    training: StreamSide
    validation: StreamSide
    settings: StreamFitSettings
    fit: FitSettings
    shape: WindowShape
    change_out: Intention
    folder: Path

    def facts(self) -> HazardFacts:
        """Return what the predictor will be, not calibrated yet. Raises InputError if no intention can be learned."""
        events, least = self.training.events(), self.settings.least_events
        learned = tuple(intention.text for intention in WITH_HAZARD if events[intention] >= least)
        if not learned:
            raise InputError(
                f"{self.training.streams.path}: no intention has {least} events on the training seeds; generate more "
                "streams"
            )
        return HazardFacts(
            horizons_s=self.settings.horizons_s,
            learned=learned,
            passing=least <= events[Intention.OVERTAKE] <= events[self.change_out] - least,
            change_out=self.change_out.text,
            uv=self.settings.uv,
            lanes=self.settings.lanes,
            windows=self.fit.windows,
            decision_s=self.training.facts[0].decision_s,
            hours=round(self.training.hours, 6),
            events={intention.text: events[intention] for intention in KNOWN},
        )


class HazardPredictor(Predictor):
    """Answers windows with the log-odds that each intention is under way or begins within the longest horizon.

    The odds of an overtake are those of a pull-out that passes; those of the change of lane, of one that does not. The
    features are the hazards.

    A subclass implements `fit_streams`, `hazards`, and `save` and `load` by `save_facts` and `load_facts`.
    """

    needs_lanes: ClassVar[bool] = False
    """Whether there is nothing to see for it without the lanes."""

    def __init__(self, facts: HazardFacts, shape: WindowShape) -> None:
        self.facts = facts
        self.shape = shape

    @classmethod
    def fit(cls, task: FitTask, feedback: Feedback) -> Self:
        raise InputError(f"{cls.display_name}: is trained on streams; make them with `cosim generate --streams`")

    @classmethod
    @abstractmethod
    def fit_streams(cls, task: StreamTask, feedback: Feedback) -> Self:
        """Return a predictor fitted on decisions of streams; as `Predictor.fit`."""

    @abstractmethod
    def hazards(self, windows: Windows) -> Hazards:
        """Return what the predictor says of windows, before calibration."""

    def seen(self, windows: Windows) -> Windows:
        """Return what the predictor may see of windows. Raises InputError where the lanes that it needs are unknown."""
        if windows.on_map is None and (self.facts.lanes or not self.facts.uv):
            raise InputError(
                f"{self.display_name}: looks at windows on their roads, which come without: give the lanes"
            )
        if not self.facts.uv:
            windows = without_uv(windows, self.facts.windows, self.shape)
        return windows

    def __call__(self, windows: Windows) -> Outputs:
        return self.answered(self.hazards(self.seen(windows)))

    def answered(self, hazards: Hazards) -> Outputs:
        """Return the calibrated answer that hazards make."""
        begins = within_horizons(hazards.intervals)[:, :, -1]
        for column, intention in enumerate(WITH_HAZARD):
            scale = self.facts.calibration.get(intention.text, PlattScaling())
            begins[:, column] = scale.slope * begins[:, column] + scale.offset
        begins[:, ~self.facts.is_learned] = NEVER
        features = np.concatenate([hazards.intervals.reshape(len(begins), -1), hazards.passing[:, None]], axis=1)
        return Outputs(self._with_overtakes(begins, hazards.passing), features, exclusive=False)

    def calibrated(self, validation: StreamSide) -> Self:
        """Return the predictor with log-odds that fit the decisions of the validation seeds."""
        parts = [
            (within_horizons(self.hazards(self.seen(batch.windows)).intervals)[:, :, -1], batch)
            for batch in validation.batches()
        ]
        if not parts:
            return self
        odds = np.concatenate([odds for odds, _ in parts])
        interval = np.concatenate([batch.targets.interval for _, batch in parts])
        weight = np.concatenate([batch.weight for _, batch in parts])
        fitted = {}
        for column, intention in enumerate(WITH_HAZARD):
            judged = interval[:, column] != IGNORED
            begins = interval[judged, column] < len(self.facts.horizons_s)
            if intention.text in self.facts.learned and begins.sum() >= LEAST_TO_CALIBRATE and not begins.all():
                fitted[intention.text] = _platt(odds[judged, column], begins, weight[judged])
        self.facts = self.facts.model_copy(update={"calibration": fitted})
        return self

    def save_facts(self, folder: Path) -> None:
        """Write HAZARDS_FILE."""
        content = self.facts.model_dump_json(indent=1) + "\n"
        replace_file(folder / HAZARDS_FILE, lambda path: path.write_text(content))

    @staticmethod
    def load_facts(folder: Path) -> HazardFacts:
        """Read HAZARDS_FILE. Raises one of READ_ERRORS."""
        facts = read_json(HazardFacts, folder / HAZARDS_FILE)
        if facts is None:
            raise FileNotFoundError(f"{HAZARDS_FILE}: is missing")
        return facts

    def _with_overtakes(self, begins: Array, passing: Array) -> Array:
        """Return the log-odds of KNOWN, (n, 6). begins: those of WITH_HAZARD, (n, 5). passing: of a pull-out, (n,)."""
        log_odds = np.full((len(begins), len(KNOWN)), NEVER)
        log_odds[:, [KNOWN.index(intention) for intention in WITH_HAZARD]] = begins
        change = KNOWN.index(Intention[self.facts.change_out.upper()])
        pulls_out = log_odds[:, change].copy()
        log_odds[:, KNOWN.index(Intention.OVERTAKE)] = both(pulls_out, passing)
        log_odds[:, change] = both(pulls_out, -passing)
        return log_odds


class NetworkOnStreams(HazardPredictor):
    """A network whose logits are those of `hazards_of`. A subclass implements `built`, `fit_streams` and `hazards`."""

    is_network = True

    def __init__(
        self, facts: HazardFacts, shape: WindowShape, network: nn.Module, fit_summary: FitSummary | None = None
    ) -> None:
        super().__init__(facts, shape)
        self.network = network
        self.fit_summary = fit_summary or FitSummary()

    @classmethod
    @abstractmethod
    def built(cls, facts: HazardFacts, settings: FitSettings, shape: WindowShape) -> nn.Module:
        """Return the untrained network."""

    def save(self, folder: Path) -> None:
        self.save_facts(folder)
        write_weights(folder / WEIGHTS_FILE, self.network)

    @classmethod
    def load(cls, folder: Path, settings: FitSettings, shape: WindowShape) -> Self:
        facts = cls.load_facts(folder)
        network = read_weights(folder / WEIGHTS_FILE, lambda: cls.built(facts, settings, shape))
        return cls(facts, shape, network.eval())


def n_logits(facts: HazardFacts) -> int:
    """Return how many logits make the hazards of a window, 5 H + 1."""
    return len(WITH_HAZARD) * len(facts.horizons_s) + 1


def hazards_of(logits: Array, facts: HazardFacts) -> Hazards:
    """Return the hazards in a network's logits, (n, 5 H + 1): of each intention and interval, then of passing."""
    intervals = logits[:, :-1].reshape(len(logits), len(WITH_HAZARD), len(facts.horizons_s)).copy()
    intervals[:, ~facts.is_learned] = NEVER
    return Hazards(intervals, logits[:, -1] if facts.passing else np.full(len(logits), NEVER))


def within_horizons(intervals: Array) -> Array:
    """Return the log-odds that something begins by the end of each interval, (..., H), from hazards' log-odds.

    With hazards h_1, h_2, ..., it has not begun by the end of interval j with probability (1 - h_1) ... (1 - h_j).
    """
    log_none = -np.cumsum(np.logaddexp(0.0, intervals), axis=-1)
    return _log_odds_of_not(log_none)


def both(first: Array, second: Array) -> Array:
    """Return the log-odds that two independent things are true, from their log-odds."""
    log_both = -np.logaddexp(0.0, -first) - np.logaddexp(0.0, -second)
    return -_log_odds_of_not(log_both)


def _log_odds_of_not(log_probability: Array) -> Array:
    """Return the log-odds of the opposite of what has a probability, given its logarithm; at most 20 either way."""
    log_probability = np.minimum(log_probability, -1e-12)
    return np.clip(np.log(-np.expm1(log_probability)) - log_probability, NEVER, -NEVER)


def _platt(log_odds: Array, true: BoolArray, weight: Array) -> PlattScaling:
    from sklearn.linear_model import LogisticRegression  # loaded only here, because it takes long

    line = LogisticRegression(C=1e6).fit(log_odds[:, None], true.astype(np.int64), sample_weight=weight)
    slope = float(line.coef_[0, 0])
    # A line that falls says that the predictor knows nothing of the validation seeds, which calibration cannot mend.
    return PlattScaling(slope=slope, offset=float(line.intercept_[0])) if slope > 0 else PlattScaling()
