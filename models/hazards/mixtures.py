"""The lane-change predictor of Schlechtriemen et al. on streams: naive Bayes with mixtures of normal distributions.

Source: J. Schlechtriemen, A. Wedel, J. Hillenbrand, G. Breuel and K.-D. Kuhnert, A lane change detection approach using
feature ranking with maximized predictive power, IEEE Intelligent Vehicles Symposium, 2014. It takes three features: the
distance from the centre of the lane, the speed across it, and the speed relative to the vehicle ahead. What differs
here: the vehicle ahead is the UV; each change of lane is asked for by itself, in each interval before onset; and the
log-odds are calibrated on validation seeds, like those of all predictors on streams.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from isac_cosim.base.arrays import Array, BoolArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.files import replace_file
from isac_cosim.base.seeding import stream
from isac_cosim.base.settings import Settings, read_json
from isac_cosim.labeling.intentions import LANE_CHANGES
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.situation import FEATURES
from isac_cosim.models.data.windows import Windows
from isac_cosim.models.hazards.answers import IGNORED, WITH_HAZARD
from isac_cosim.models.hazards.predictor import NEVER, HazardFacts, HazardPredictor, Hazards, StreamTask
from isac_cosim.models.hazards.settings import MixturesSettings
from isac_cosim.models.hazards.sight import situation_of
from isac_cosim.models.predictors.protocol import WindowShape
from isac_cosim.models.predictors.rule import IN_LANE

MIXTURES_FILE = "mixtures.json"
SEEN = ("offset", "aside_0", "closing")
"""The features, by their names in the situation."""
LEAST_DECISIONS = 2
"""Fewest decisions that a mixture is fitted to."""
COLUMNS = [IN_LANE + FEATURES.index(name) for name in SEEN]


class Mixture(Settings):
    """A density of one feature: normal distributions with their shares."""

    share: tuple[float, ...] = Field(min_length=1)
    mean: tuple[float, ...]
    sd: tuple[float, ...]

    @model_validator(mode="after")
    def _is_a_density(self) -> Self:
        if not len(self.share) == len(self.mean) == len(self.sd):
            raise ValueError("share, mean and sd: are not of one length")
        if not np.isfinite([*self.share, *self.mean, *self.sd]).all() or min(*self.share, *self.sd) <= 0:
            raise ValueError("share, mean and sd: must be finite, shares and sd above 0")
        return self

    @classmethod
    def fitted(cls, values: Array, settings: MixturesSettings, seed: int) -> Self:
        """Return the density of values (n,): as many normal distributions as Schwarz's criterion is least for."""
        from sklearn.mixture import GaussianMixture  # loaded only here, because it takes long

        most = min(settings.most_components, len(np.unique(values)))
        mixtures = [GaussianMixture(count, random_state=seed).fit(values[:, None]) for count in range(1, most + 1)]
        best = min(mixtures, key=lambda mixture: mixture.bic(values[:, None]))
        return cls(
            share=tuple(np.maximum(best.weights_, 1e-12).tolist()),
            mean=tuple(best.means_[:, 0].tolist()),
            sd=tuple(np.sqrt(best.covariances_[:, 0, 0]).tolist()),
        )

    def log_density(self, values: Array) -> Array:
        """Return the logarithm of the density at values, (n,)."""
        share, mean, sd = np.array(self.share), np.array(self.mean), np.array(self.sd)
        exponent = -(((values[:, None] - mean) / sd) ** 2) / 2
        return np.asarray(np.logaddexp.reduce(exponent + np.log(share / sd / np.sqrt(2 * np.pi)), axis=1))


class Hypotheses(Settings):
    """Whether a change begins within an interval: odds before anything is seen, and densities of SEEN either way."""

    log_odds: float = Field(ge=-50, le=50)
    begins: tuple[Mixture, ...] = Field(min_length=len(SEEN), max_length=len(SEEN))
    does_not: tuple[Mixture, ...] = Field(min_length=len(SEEN), max_length=len(SEEN))

    def after(self, values: Array) -> Array:
        """Return the log-odds once values (n, 3) are seen, (n,), as if they were independent."""
        pairs = zip(self.begins, self.does_not, values.T, strict=True)
        evidence = [begins.log_density(seen) - does_not.log_density(seen) for begins, does_not, seen in pairs]
        return np.asarray(np.clip(self.log_odds + np.sum(evidence, axis=0), NEVER, -NEVER))


class FittedMixtures(Settings):
    """The content of MIXTURES_FILE: what each learned change of lane has for each interval."""

    intervals: dict[str, tuple[Hypotheses, ...]] = Field(min_length=1)


class GaussianMixtures(HazardPredictor):
    """Naive Bayes with Gaussian mixtures, for changes of lane alone: it never names anything else."""

    display_name = "Gaussian mixtures"
    summary = "naive Bayes on offset, lateral speed and closing speed (Schlechtriemen 2014): changes of lane alone"
    needs_lanes: ClassVar[bool] = True

    def __init__(self, facts: HazardFacts, shape: WindowShape, fitted: FittedMixtures) -> None:
        super().__init__(facts, shape)
        self.fitted = fitted

    @classmethod
    def fit_streams(cls, task: StreamTask, feedback: Feedback) -> Self:
        from isac_cosim.models.hazards.decisions import gathered  # loaded only here, because it takes long

        facts = task.facts()
        changes = tuple(change.text for change in LANE_CHANGES if change.text in facts.learned)
        if not changes:
            raise InputError(
                f"{task.training.streams.path}: too few changes of lane to learn from; generate more streams"
            )
        facts = facts.model_copy(update={"learned": changes, "passing": False})
        nothing = FittedMixtures.model_construct(intervals={})
        untrained = cls(facts, task.shape, nothing)
        values, targets, weight = gathered(
            task.training, lambda windows: _seen(untrained.seen(windows)), feedback, "reading streams"
        )
        fitted: dict[str, tuple[Hypotheses, ...]] = {}
        for name in changes:
            answer = targets.interval[:, [intention.text for intention in WITH_HAZARD].index(name)]
            hypotheses = []
            for interval in range(len(facts.horizons_s)):
                at_risk = (answer != IGNORED) & (answer >= interval)
                begins = answer[at_risk] == interval
                key = (name, interval, task.fit.seed)
                hypotheses.append(
                    _hypotheses(
                        values[at_risk].astype(np.float64), begins, weight[at_risk], task.settings.mixtures, key
                    )
                )
            fitted[name] = tuple(hypotheses)
        return cls(facts, task.shape, FittedMixtures(intervals=fitted)).calibrated(task.validation)

    def save(self, folder: Path) -> None:
        self.save_facts(folder)
        content = self.fitted.model_dump_json(indent=1) + "\n"
        replace_file(folder / MIXTURES_FILE, lambda path: path.write_text(content))

    @classmethod
    def load(cls, folder: Path, settings: FitSettings, shape: WindowShape) -> Self:
        facts, fitted = cls.load_facts(folder), read_json(FittedMixtures, folder / MIXTURES_FILE)
        if fitted is None:
            raise FileNotFoundError(f"{MIXTURES_FILE}: is missing")
        if set(fitted.intervals) != set(facts.learned):
            raise ValueError(f"{MIXTURES_FILE}: is of other changes of lane than the run")
        if any(len(hypotheses) != len(facts.horizons_s) for hypotheses in fitted.intervals.values()):
            raise ValueError(f"{MIXTURES_FILE}: has other intervals than the run")
        return cls(facts, shape, fitted)

    def hazards(self, windows: Windows) -> Hazards:
        values = _seen(windows)
        intervals = np.full((len(values), len(WITH_HAZARD), len(self.facts.horizons_s)), NEVER)
        for column, intention in enumerate(WITH_HAZARD):
            for interval, hypotheses in enumerate(self.fitted.intervals.get(intention.text, ())):
                intervals[:, column, interval] = hypotheses.after(values)
        return Hazards(intervals, np.full(len(values), NEVER))


def _seen(windows: Windows) -> Array:
    """Return SEEN of windows whose roads are known, (n, 3)."""
    return np.asarray(situation_of(windows)[:, COLUMNS])


def _hypotheses(
    values: Array, begins: BoolArray, weight: Array, settings: MixturesSettings, key: tuple[str, int, int]
) -> Hypotheses:
    """Return what separates decisions at which a change begins from the others. weight: of each, (n,).

    With fewer than LEAST_DECISIONS on either side, nothing does: the answer is always that of the other side.
    """
    both = {"begins": np.flatnonzero(begins), "does not": np.flatnonzero(~begins)}
    few = [kind for kind, rows in both.items() if len(rows) < LEAST_DECISIONS]
    if few:
        nothing = (Mixture(share=(1.0,), mean=(0.0,), sd=(1.0,)),) * len(SEEN)
        return Hypotheses(log_odds=NEVER if "begins" in few else -NEVER, begins=nothing, does_not=nothing)
    densities = []
    for kind, rows in both.items():
        share = weight[rows] / weight[rows].sum()
        if len(rows) > settings.most_decisions or np.ptp(share) > 1e-12:
            # Mixtures take no weights: decisions are drawn by theirs.
            count = min(settings.most_decisions, len(rows))
            rows = stream("mixtures", *key, kind).choice(rows, count, p=share)
        densities.append(tuple(Mixture.fitted(column, settings, key[2]) for column in values[rows].T))
    log_odds = float(np.log(weight[begins].sum() / weight[~begins].sum()))
    return Hypotheses(log_odds=log_odds, begins=densities[0], does_not=densities[1])
