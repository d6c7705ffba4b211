"""Trees with a seventh answer, "none", trained on running traffic, where most windows hold no maneuver.

A predictor that was trained on maneuvers alone always has to name one of them, and before onset it is confidently
wrong. These trees learn from the streams of the development seeds. Their inputs are the features of the predictor and
its six log-probabilities; their output is seven probabilities.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from sklearn.ensemble import HistGradientBoostingClassifier

from isacsim.arrays import Array, BoolArray, Float32Array, IntArray
from labeling.intentions import KNOWN, Intention
from models.live.alarms import NEVER
from models.live.events import LiveEvent
from models.live.kept_trees import NOT_KEPT, KeptTrees
from models.live.predictions import Answers
from models.live.settings import BackgroundSettings
from models.live.store import RUN, LiveEpisode

NONE = len(KNOWN)
"""The number of the answer "none"."""
IGNORED = -1
"""The label of windows that are left out of the training."""
LEAST_PROBABILITY = 1e-6


@dataclass(frozen=True)
class Background:
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
    ) -> Background | None:
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
        background = Background.fit(others, settings, before_onset_s, predictor, kept)
        if background is None:
            return None
        for k in range(fold, len(episodes), folds):
            levels[k] = background.levels(episodes[k])
    return levels
