"""Trees with a seventh answer, "none", trained on running traffic, where most windows hold no maneuver.

A predictor that was trained on maneuvers alone always has to name one of them, and before onset it is confidently
wrong. These trees learn from the streams of the development seeds. Their inputs are the features of the predictor and
its six log-probabilities; their output is seven probabilities.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import sklearn
from sklearn.ensemble import HistGradientBoostingClassifier

from isac_cosim.base.arrays import Array, BoolArray, Float32Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.files import remove_partial
from isac_cosim.base.stored.errors import READ_ERRORS, reason_of
from isac_cosim.evaluation.in_traffic.alarms.alarms import LEAST_PROBABILITY, NEVER
from isac_cosim.evaluation.in_traffic.settings import BackgroundSettings
from isac_cosim.evaluation.in_traffic.streams.predictions import Answers
from isac_cosim.evaluation.in_traffic.streams.store import RUN, LiveEpisode
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.labeling.streams.events import LiveEvent
from isac_cosim.models.trees.boosting import boosted_trees, fitted
from isac_cosim.models.trees.stored_trees import read_trees, write_trees

NONE = len(KNOWN)
"""The number of the answer "none"."""
IGNORED = -1
"""The label of windows that are left out of the training."""
TREES_FOLDER = "trees"
"""In the folder of an evaluation."""
SUFFIX = ".skops"


@dataclass
class KeptTrees:
    """Trains trees, or reads them from a folder where the same ones have been trained before.

    folder: where they are kept; None keeps none.
    """

    folder: Path | None = None
    _wanted: set[str] = field(default_factory=set, init=False)

    def trained(
        self, features: Float32Array, label: IntArray, weight: Array, settings: BackgroundSettings
    ) -> HistGradientBoostingClassifier:
        """Return trees trained on windows. features: (n, F). label, weight: (n,).

        Raises OutputError where they cannot be written, InputError where a file of trees is damaged.
        """
        trees = boosted_trees(settings)
        if self.folder is None:
            return fitted(trees, features, label, weight)
        path = self.folder / (_digest(trees, features, label, weight) + SUFFIX)
        self._wanted.add(path.name)
        if path.is_file():
            return _read(path, features.shape[1], np.unique(label).tolist())
        fitted(trees, features, label, weight)
        self.folder.mkdir(exist_ok=True)
        write_trees(path, trees)
        return trees

    def remove_others(self) -> None:
        """Delete from the folder what nobody has asked for, such as trees of other development seeds."""
        if self.folder is None or not self.folder.is_dir():
            return
        remove_partial(self.folder, f"*{SUFFIX}")
        for path in self.folder.glob(f"*{SUFFIX}"):
            if path.name not in self._wanted:
                path.unlink()


NOT_KEPT = KeptTrees()
"""Trains trees every time."""


def _read(path: Path, n_features: int, classes: Sequence[int]) -> HistGradientBoostingClassifier:
    try:
        trees = read_trees(path, n_features, classes)
        if trees.classes_.tolist() != classes:
            raise ValueError(f"classes_: are not {classes}")
        return trees
    except READ_ERRORS as error:
        reason = reason_of(error)
        raise InputError(f"{path}: is damaged ({reason}); delete it, and the trees are trained again") from None


def _digest(trees: HistGradientBoostingClassifier, features: Float32Array, label: IntArray, weight: Array) -> str:
    digest = hashlib.sha256(repr((sklearn.__version__, features.shape, sorted(trees.get_params().items()))).encode())
    for values in (features, label, weight):
        digest.update(np.ascontiguousarray(values).data)
    return digest.hexdigest()


@dataclass(frozen=True)
class BackgroundTrees:
    """Trained trees. Their classes are the numbers of the known intentions, and NONE.

    predictor: name, in the episodes, of the predictor whose answers they take.
    """

    trees: HistGradientBoostingClassifier
    predictor: str = RUN

    @classmethod
    def fit(
        cls,
        episodes: Sequence[LiveEpisode],
        settings: BackgroundSettings,
        before_onset_s: float,
        predictor: str = RUN,
        kept: KeptTrees = NOT_KEPT,
    ) -> BackgroundTrees | None:
        """Train trees on episodes with features; None if the episodes hold no event, or nothing but events.

        before_onset_s: how early before onset an alarm may come, s. Windows that end in this time are left out, except
        those just before onset that already count as the maneuver (`BackgroundSettings.before_onset_s`). kept: where
        the same trees may be already.
        """
        episodes = [episode for episode in episodes if len(episode.time_s)]
        if not episodes:
            return None
        rows = [training_rows(episode, settings, before_onset_s) for episode in episodes]
        label = np.concatenate([labels for _, labels, _ in rows])
        weight = np.concatenate([weights for _, _, weights in rows])
        if len(np.unique(label)) < 2 or not (label == NONE).any():
            return None
        features = np.concatenate(
            [inputs(episode.answers[predictor])[chosen] for episode, (chosen, _, _) in zip(episodes, rows, strict=True)]
        )
        return cls(kept.trained(features, label, weight, settings), predictor)

    def levels(self, episode: LiveEpisode) -> Float32Array:
        """Return the log-odds of every intention at each prediction of an episode with features, (n, 6)."""
        return self.levels_of(episode.answers[self.predictor])

    def levels_of(self, answers: Answers) -> Float32Array:
        """Return the log-odds of every intention for answers with features, (n, 6)."""
        level = np.full((len(answers.score), len(KNOWN)), NEVER, np.float32)
        if not len(level):
            return level
        probabilities = np.clip(self.trees.predict_proba(inputs(answers)), LEAST_PROBABILITY, 1 - LEAST_PROBABILITY)
        for column, known in enumerate(self.trees.classes_.tolist()):
            if known != NONE:
                level[:, known] = np.log(probabilities[:, column] / (1 - probabilities[:, column]))
        return level


def inputs(answers: Answers) -> Float32Array:
    """Return the inputs of the trees: F features of the predictor and six log-probabilities, (n, F + 6)."""
    return np.concatenate([answers.features, np.log(np.maximum(answers.probabilities, 1e-12))], axis=1)


def training_rows(
    episode: LiveEpisode, settings: BackgroundSettings, before_onset_s: float
) -> tuple[IntArray, IntArray, Array]:
    """Return the numbers of the predictions to train on, their labels and their weights, each (m,).

    All windows of events are taken. Of the others every s-th is taken, with the weight s of those it stands for.
    """
    label = window_labels(episode, settings, before_onset_s)
    stride = max(1, round(settings.background_every_s / episode.facts.decision_s))
    number = np.rint(episode.time_s / episode.facts.decision_s).astype(np.int64)
    background = (label == NONE) & (number % stride == 0)
    chosen = np.flatnonzero(background | ((label != NONE) & (label != IGNORED)))
    return chosen, label[chosen], np.where(label[chosen] == NONE, float(stride), 1.0)


def window_labels(episode: LiveEpisode, settings: BackgroundSettings, before_onset_s: float) -> IntArray:
    """Return the right answer to each prediction of an episode, or IGNORED, (n,).

    Three kinds of window are ignored: those that end shortly before onset, where an alarm is allowed but nothing may be
    visible yet, those after the commit, unless the settings say otherwise, and those within neutral events.
    """
    label = np.full(len(episode.time_s), NONE, dtype=np.int64)
    number = {name: k for k, name in enumerate(episode.names)}
    counted = [event for event in episode.facts.events if event.left_out is None]
    neutral = [event for event in episode.facts.events if event.left_out is not None]

    def within(event: LiveEvent, lead_s: float, until_s: float) -> BoolArray:
        time = episode.time_s
        of_vehicle = episode.vehicle == number.get(event.vehicle, -1)
        return np.asarray(of_vehicle & (time >= event.onset - lead_s - 1e-9) & (time <= until_s + 1e-9))

    for event in (*counted, *neutral):
        label[within(event, before_onset_s, event.end)] = IGNORED
    for event in counted:
        until_s = event.commit if settings.until == "commit" else event.end
        label[within(event, settings.before_onset_s, until_s)] = KNOWN.index(Intention[event.intention.upper()])
    return label


def out_of_fold(
    episodes: Sequence[LiveEpisode],
    settings: BackgroundSettings,
    before_onset_s: float,
    predictor: str = RUN,
    kept: KeptTrees = NOT_KEPT,
) -> list[Float32Array] | None:
    """Return the levels of each episode, from trees trained on other episodes; None if trees cannot be trained."""
    folds = min(settings.folds, len(episodes))
    if folds < 2:
        return None
    levels: list[Float32Array] = [np.empty((0, 0), np.float32)] * len(episodes)
    for fold in range(folds):
        others = [episode for k, episode in enumerate(episodes) if k % folds != fold]
        background = BackgroundTrees.fit(others, settings, before_onset_s, predictor, kept)
        if background is None:
            return None
        for k in range(fold, len(episodes), folds):
            levels[k] = background.levels(episodes[k])
    return levels
