"""Boosted trees on streams: one set an intention, on statistics of the window, on the situation, or on both."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from isac_cosim.base.arrays import Array, Float32Array, IntArray
from isac_cosim.base.feedback import Feedback
from isac_cosim.models.data.fit_settings import FitSettings
from isac_cosim.models.data.statistics import recent_motion, statistics
from isac_cosim.models.data.windows import Windows
from isac_cosim.models.hazards.answers import IGNORED, WITH_HAZARD
from isac_cosim.models.hazards.predictor import NEVER, HazardFacts, HazardPredictor, Hazards, StreamTask
from isac_cosim.models.hazards.settings import HazardTreesSettings
from isac_cosim.models.hazards.sight import situation_of
from isac_cosim.models.predictors.protocol import WindowShape
from isac_cosim.models.trees.boosting import boosted_trees, fitted
from isac_cosim.models.trees.stored_trees import read_trees, write_trees

if TYPE_CHECKING:
    from sklearn.ensemble import HistGradientBoostingClassifier

    from isac_cosim.models.hazards.targets import Targets

PASSING = "passing"


class SituationTrees(HazardPredictor):
    """Trees on the situation alone: the TV in its lane, where lanes go on, and how it stands to the UV."""

    display_name = "situation trees"
    summary = "boosted trees on the TV in its lane, the lanes ahead and the UV"
    needs_lanes: ClassVar[bool] = True

    def __init__(
        self, facts: HazardFacts, shape: WindowShape, trees: dict[str, HistGradientBoostingClassifier]
    ) -> None:
        super().__init__(facts, shape)
        self.trees = trees

    @classmethod
    def features(cls, windows: Windows, facts: HazardFacts, shape: WindowShape) -> Array:
        """Return what the trees see of windows, (n, F)."""
        return situation_of(windows)

    @classmethod
    def fit_streams(cls, task: StreamTask, feedback: Feedback) -> Self:
        from isac_cosim.models.hazards.decisions import gathered  # loaded only here, because it takes long

        facts, settings = task.facts(), task.settings.trees
        untrained = cls(facts, task.shape, {})

        def features(windows: Windows) -> Array:
            return cls.features(untrained.seen(windows), facts, task.shape)

        values, targets, weight = gathered(task.training, features, feedback, "reading streams")
        names = [*facts.learned, *([PASSING] if facts.passing else [])]
        trees: dict[str, HistGradientBoostingClassifier] = {}
        with feedback.bar(f"training {cls.display_name}", "intentions") as move:
            for name in names:
                rows, columns, label, stands_for = _rows_of(name, targets, len(facts.horizons_s))
                inputs = values[rows] if columns is None else _with_interval(values[rows], columns)
                trees[name] = _fitted(inputs, label, weight[rows] * stands_for, settings, task.fit.seed)
                move(len(trees), len(names))
        return cls(facts, task.shape, trees).calibrated(task.validation)

    def save(self, folder: Path) -> None:
        self.save_facts(folder)
        for name, trees in self.trees.items():
            write_trees(folder / _file_name(name), trees)

    @classmethod
    def load(cls, folder: Path, settings: FitSettings, shape: WindowShape) -> Self:
        facts = cls.load_facts(folder)
        names = [*facts.learned, *([PASSING] if facts.passing else [])]
        trees = {name: read_trees(folder / _file_name(name), None, (0, 1)) for name in names}
        widths = {name: of_name.n_features_in_ - (name != PASSING) for name, of_name in trees.items()}
        if len(set(widths.values())) > 1:
            raise ValueError(f"{_file_name(min(widths))}: takes other features than the other trees")
        return cls(facts, shape, trees)

    def hazards(self, windows: Windows) -> Hazards:
        values = self.features(windows, self.facts, self.shape).astype(np.float32)
        n, horizons = len(values), len(self.facts.horizons_s)
        intervals = np.full((n, len(WITH_HAZARD), horizons), NEVER)
        repeated = _with_interval(np.repeat(values, horizons, axis=0), np.tile(np.arange(horizons), n))
        for column, intention in enumerate(WITH_HAZARD):
            if intention.text in self.trees:
                odds = self.trees[intention.text].decision_function(repeated)
                intervals[:, column] = odds.reshape(n, horizons)
        passing = self.trees[PASSING].decision_function(values) if PASSING in self.trees else np.full(n, NEVER)
        return Hazards(intervals, np.asarray(passing))


class StreamTrees(SituationTrees):
    """Trees on statistics of the window and recent motion, and on the situation unless they may not see the lanes."""

    display_name = "stream trees"
    summary = "boosted trees on statistics of the window, recent motion and the situation"
    needs_lanes: ClassVar[bool] = False

    @classmethod
    def features(cls, windows: Windows, facts: HazardFacts, shape: WindowShape) -> Array:
        parts = [statistics(windows), recent_motion(windows, shape.tv_rate_hz)]
        if facts.lanes:
            parts.append(situation_of(windows).astype(np.float32))
        return np.concatenate(parts, axis=1)


def _rows_of(name: str, targets: Targets, horizons: int) -> tuple[IntArray, IntArray | None, IntArray, Array]:
    """Return the rows that the trees of a name learn from, the interval and the label of each, and its weight.

    A decision is asked once an interval, until the intention has begun. Where none begins, the answers are all the
    same: it is asked for one interval, in turn, with the weight of all.
    """
    if name == PASSING:
        judged = np.flatnonzero(targets.passing != IGNORED)
        return judged, None, targets.passing[judged], np.ones(len(judged))
    answer = targets.interval[:, [intention.text for intention in WITH_HAZARD].index(name)]
    interval, number = np.arange(horizons), np.arange(len(answer))[:, None]
    begins, in_turn = (answer < horizons)[:, None], number % horizons == interval
    asked = np.where(begins, answer[:, None] >= interval, in_turn) & (answer != IGNORED)[:, None]
    rows, intervals = np.nonzero(asked)
    stands_for = np.where(begins[rows, 0], 1.0, float(horizons))
    return rows, intervals, (answer[rows] == intervals).astype(np.int64), stands_for


def _with_interval(values: Float32Array, interval: IntArray) -> Float32Array:
    return np.concatenate([values, interval[:, None].astype(np.float32)], axis=1)


def _fitted(
    values: Float32Array, label: IntArray, weight: Array, settings: HazardTreesSettings, seed: int
) -> HistGradientBoostingClassifier:
    trees = boosted_trees(settings, seed)
    trees.set_params(min_samples_leaf=settings.least_leaf, max_features=settings.feature_share)
    return fitted(trees, values, label, weight)


def _file_name(name: str) -> str:
    return f"hazard_{name}.skops"
