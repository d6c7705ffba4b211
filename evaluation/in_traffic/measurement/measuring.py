"""Measures predictors on the episodes of an evaluation: alarms chosen on development seeds, measured on the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import get_args

import numpy as np

from isac_cosim.base.arrays import Float32Array
from isac_cosim.base.seeding import stream
from isac_cosim.evaluation.in_traffic.alarms.alarms import (
    Alarms,
    Levels,
    confirmed,
    duty_cycle,
    hazard_levels,
    raised,
    reject_levels,
)
from isac_cosim.evaluation.in_traffic.alarms.background import NOT_KEPT, BackgroundTrees, KeptTrees
from isac_cosim.evaluation.in_traffic.measurement.choosing import (
    AlarmCandidate,
    Chosen,
    Options,
    background_candidates,
    hazard_candidates,
    options_of,
    reject_candidates,
)
from isac_cosim.evaluation.in_traffic.scores import scoring
from isac_cosim.evaluation.in_traffic.scores.curves import ThresholdSweep, candidate_thresholds
from isac_cosim.evaluation.in_traffic.scores.results import AlarmResult, EventScores, FrozenPoint
from isac_cosim.evaluation.in_traffic.scores.scoring import AlarmOutcome, Truth
from isac_cosim.evaluation.in_traffic.settings import AlarmSettings, LiveSettings, Method, ScoringSettings, Sharing
from isac_cosim.evaluation.in_traffic.streams.store import LiveEpisode, without_near_misses
from isac_cosim.labeling.intentions import KNOWN

OF_RECORDS: tuple[Method, ...] = ("reject", "background")
OF_STREAMS: tuple[Method, ...] = ("hazard",)
"""The kinds of alarm of runs that were trained on records, and on streams."""


@dataclass(frozen=True)
class MeasuredAlarms:
    """What a predictor with one kind of alarm measured.

    outcomes, alarms: of each measured episode. sweep: its curve. chosen: its settings. Both are None if its alarms have
    no threshold.
    """

    result: AlarmResult
    outcomes: tuple[AlarmOutcome, ...]
    alarms: tuple[Alarms, ...]
    sweep: ThresholdSweep | None = None
    chosen: Chosen | None = None


@dataclass(frozen=True)
class AnswerLevels:
    """The answers of a predictor in several episodes, and their levels.

    predictor: its name in the episodes. background: the trees that know "none", for alarms of that method.
    """

    truths: Sequence[Truth]
    predictor: str
    background: BackgroundTrees | None = None
    # Of all intentions, by the settings that they depend on: several questions are asked of the same levels.
    _answered: dict[tuple[str, float], list[Levels]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    _confirmed: dict[tuple[str, float, int, int], list[Levels]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def asking(self, intentions: Sequence[int], after_commit_s: float = 0.0) -> AnswerLevels:
        """Return the same for alarms of some intentions alone, as `Truth.asking`."""
        asked = replace(self, truths=[truth.asking(intentions, after_commit_s) for truth in self.truths])
        vars(asked).update(_answered=self._answered, _confirmed=self._confirmed)
        return asked

    def levels(self, settings: AlarmSettings) -> list[Levels]:
        """Return the levels of each episode for alarms of some settings, not confirmed."""
        return self._asked(self._of_all(settings))

    def confirmed(self, settings: AlarmSettings) -> list[Levels]:
        """Return the confirmed levels of each episode."""
        key = (settings.method, settings.least_probability, settings.k, settings.n)
        if key not in self._confirmed:
            self._confirmed[key] = [confirmed(level, settings.k, settings.n) for level in self._of_all(settings)]
        return self._asked(self._confirmed[key])

    def _of_all(self, settings: AlarmSettings) -> list[Levels]:
        key = (settings.method, settings.least_probability)
        if key not in self._answered:
            self._answered[key] = [Levels.of(truth.episode, self._level(truth, settings)) for truth in self.truths]
        return self._answered[key]

    def _asked(self, levels: Sequence[Levels]) -> list[Levels]:
        return [level.asking(truth.asked) for truth, level in zip(self.truths, levels, strict=True)]

    def alarms(self, settings: AlarmSettings) -> list[Alarms]:
        """Return the alarms of each episode."""
        return [
            raised(level, settings.thresholds, settings.refractory_s, settings.rise)
            for level in self.confirmed(settings)
        ]

    def outcomes(self, raised: Sequence[Alarms]) -> list[AlarmOutcome]:
        """Return what comes of the alarms of each episode."""
        return [truth.outcome(of_episode) for truth, of_episode in zip(self.truths, raised, strict=True)]

    def sweep(self, chosen: Chosen, live: LiveSettings) -> ThresholdSweep:
        """Return the curve: with a threshold for each intention along the path that the development seeds chose."""
        settings, thresholds = chosen.alarms, chosen.path
        steady = self.confirmed(settings)
        if thresholds is None:
            shared = candidate_thresholds(steady, live.choice.thresholds)
            thresholds = np.tile(shared[:, None], len(KNOWN))
        return ThresholdSweep.of(self.truths, steady, thresholds, settings.refractory_s, settings.rise)

    def duty_cycle(self, settings: AlarmSettings) -> float | None:
        """Return the share of predictions at which some intention reaches its threshold; None without any."""
        levels = self.levels(settings)
        total = sum(len(level.time_s) for level in levels)
        return (
            sum((duty_cycle(level, settings) or 0.0) * len(level.time_s) for level in levels) / total if total else None
        )

    def _level(self, truth: Truth, settings: AlarmSettings) -> Float32Array:
        if settings.method == "background":
            assert self.background is not None, "the method `background` needs its trees"
            return self.background.levels(truth.episode)
        if settings.method == "hazard":
            return hazard_levels(truth.episode.answers[self.predictor])
        return reject_levels(truth.episode.answers[self.predictor], settings.least_probability)


@dataclass(frozen=True)
class Prepared:
    """A predictor with one kind of alarm: its levels, which do not depend on the intentions that it is asked for.

    development, candidates: the episodes on which its alarms are chosen, and the levels there. streams: the measured
    episodes.
    """

    development: Sequence[Truth]
    candidates: Sequence[AlarmCandidate]
    streams: AnswerLevels

    @classmethod
    def of(
        cls,
        development: Sequence[Truth],
        measured: Sequence[Truth],
        predictor: str,
        live: LiveSettings,
        method: Method,
        kept: KeptTrees = NOT_KEPT,
    ) -> Prepared | None:
        """Return a predictor with features, by its name in the episodes; None if there is nothing to choose among.

        kept: where the trees of this evaluation are kept.
        """
        background = None
        if method == "background":
            episodes = [truth.episode for truth in development]
            background = BackgroundTrees.fit(episodes, live.background, live.scoring.before_onset_s, predictor, kept)
            if background is None:
                return None
            candidates = background_candidates(development, predictor, live, kept)
        elif method == "hazard":
            candidates = hazard_candidates(development, predictor, live.choice)
        else:
            candidates = reject_candidates(development, predictor, live.choice)
        return cls(development, candidates, AnswerLevels(measured, predictor, background))

    def asking(self, intentions: Sequence[int], after_commit_s: float = 0.0) -> Prepared:
        """Return the same for alarms of some intentions alone, as `Truth.asking`."""
        development = [truth.asking(intentions, after_commit_s) for truth in self.development]
        return Prepared(development, self.candidates, self.streams.asking(intentions, after_commit_s))

    def options(self, live: LiveSettings) -> Options:
        """Return the alarm settings that the development seeds choose among."""
        return options_of(self.development, self.candidates, live.choice)

    def measure(self, live: LiveSettings, name: str = "") -> MeasuredAlarms | None:
        """Choose alarms, and measure them; None if there is nothing to choose. name: in the result."""
        return measure(self.streams, self.options(live), live, name)


def measure_methods(
    development: Sequence[Truth],
    measured: Sequence[Truth],
    predictor: str,
    live: LiveSettings,
    name: str,
    methods: Sequence[Method] = OF_RECORDS,
    kept: KeptTrees = NOT_KEPT,
) -> dict[Method, MeasuredAlarms]:
    """Measure kinds of alarm of a predictor with features, the better one on the development seeds first.

    predictor: its name in the episodes. name: in the result. A kind that cannot be chosen is left out. kept: where the
    trees of this evaluation are kept.
    """
    of_methods = {method: Prepared.of(development, measured, predictor, live, method, kept) for method in methods}
    measurements = {method: of.measure(live, name) for method, of in of_methods.items() if of is not None}
    results = [(method, result) for method, result in measurements.items() if result is not None]
    return dict(sorted(results, key=lambda item: _rank(item[1]), reverse=True))


def measure(streams: AnswerLevels, options: Options, live: LiveSettings, name: str) -> MeasuredAlarms | None:
    """Choose alarms among options, and measure them; None if there is nothing to choose. name: of the predictor."""
    choice = live.choice
    chosen = options.choose(choice.false_alarms_per_vehicle_hour, choice.threshold)
    if chosen is None:
        return None
    raised = streams.alarms(chosen.alarms)
    outcomes = streams.outcomes(raised)
    sweep = streams.sweep(chosen, live)
    rates = live.scoring.false_alarms_per_vehicle_hour
    curve = {
        "alarms": chosen.alarms,
        "alarms_keep_to_rate": chosen.quiet,
        "recall_at": [sweep.point(rate, live.scoring) for rate in rates],
        "frozen_at": frozen_at(streams, options, live),
        "duty_cycle": streams.duty_cycle(chosen.alarms),
    }
    result = result_of(streams.truths, raised, live, name).model_copy(update=curve)
    return MeasuredAlarms(result, tuple(outcomes), tuple(raised), sweep, chosen)


def frozen_at(streams: AnswerLevels, options: Options, live: LiveSettings) -> dict[Sharing, list[FrozenPoint]]:
    """Measure the alarms chosen for each rate, with a threshold that all intentions share and with one for each."""
    points: dict[Sharing, list[FrozenPoint]] = {}
    for sharing in get_args(Sharing):
        of_sharing = points[sharing] = []
        for rate in live.scoring.false_alarms_per_vehicle_hour:
            chosen = options.choose(rate, sharing)
            if chosen is None:
                continue
            outcomes = streams.outcomes(streams.alarms(chosen.alarms))
            over_all = scoring.event_scores(outcomes, live.scoring)
            of_sharing.append(
                FrozenPoint(
                    false_alarms_per_vehicle_hour=rate,
                    alarms=chosen.alarms,
                    keeps_to_rate=chosen.quiet,
                    measured=over_all.false_alarms_per_vehicle_hour,
                    recall=over_all.recall,
                    recall_interval=over_all.recall_interval,
                    recall_with_detection=over_all.recall_with_detection,
                    median_lead_s=over_all.lead_time_s.median,
                    by_intention=scoring.recall_by_intention(outcomes),
                )
            )
    return points


def measure_random(truths: Sequence[Truth], like: MeasuredAlarms, live: LiveSettings) -> MeasuredAlarms:
    """Measure alarms at random instants: in each episode as many for each intention as another predictor raised."""
    raised = []
    for truth, episode_alarms in zip(truths, like.alarms, strict=True):
        episode = truth.episode
        rng = stream("random alarms", episode.facts.scenario, episode.facts.seed)
        drawn = [
            np.sort(rng.choice(len(episode.time_s), int((episode_alarms.intention == k).sum()), replace=False))
            for k in range(len(KNOWN))
        ]
        rows = np.concatenate(drawn).astype(np.int64)
        intention = np.repeat(np.arange(len(KNOWN)), [len(part) for part in drawn])
        raised.append(Alarms(intention, rows, episode.vehicle[rows], episode.time_s[rows]))
    outcomes = [truth.outcome(episode_alarms) for truth, episode_alarms in zip(truths, raised, strict=True)]
    return MeasuredAlarms(result_of(truths, raised, live, "random alarms"), tuple(outcomes), tuple(raised))


def no_alarms(truths: Sequence[Truth], live: LiveSettings, name: str) -> MeasuredAlarms:
    """Return what a predictor measures that never raises an alarm, for want of any threshold."""
    no_rows = np.empty(0, np.int64)
    nothing = Alarms(no_rows, no_rows, no_rows, np.empty(0))
    outcomes = [truth.outcome(nothing) for truth in truths]
    return MeasuredAlarms(
        result_of(truths, [nothing] * len(truths), live, name), tuple(outcomes), (nothing,) * len(truths)
    )


def result_of(truths: Sequence[Truth], raised: Sequence[Alarms], live: LiveSettings, name: str) -> AlarmResult:
    """Return the scores of the alarms of episodes, if they have no threshold."""
    pairs = list(zip(truths, raised, strict=True))
    outcomes = [truth.outcome(of_episode) for truth, of_episode in pairs]
    near: Counter[str] = Counter()
    for truth, of_episode in pairs:
        near += scoring.false_alarms_near(truth, of_episode, live.scoring.before_onset_s)
    scores = scoring.group_scores(outcomes, live.scoring)
    km = sum(truth.episode.facts.covered_km for truth in truths)
    return AlarmResult(
        name=name,
        alarms=None,
        alarms_keep_to_rate=None,
        over_all=scores.over_all,
        macro_recall=_macro_recall(list(scores.by_intention.values())),
        by_intention=scores.by_intention,
        natural=scoring.group_scores(outcomes, live.scoring, "natural"),
        reaction=scoring.group_scores(outcomes, live.scoring, "reaction"),
        commanded=scoring.group_scores(outcomes, live.scoring, "commanded"),
        recall_at=[],
        recall_by_time_to_commit=scoring.by_time_to_commit(outcomes),
        false_alarms_per_100_km=100 * scores.over_all.false_alarms / km if km else None,
        false_alarms_near=dict(sorted(near.items())),
        near_miss_alarms=sum(len(outcome.near_intention) for outcome in outcomes),
        duty_cycle=None,
    )


def _rank(measured: MeasuredAlarms) -> tuple[bool, float]:
    """Return the key by which the better kind of alarm comes first."""
    assert measured.chosen is not None
    return measured.chosen.rank


def _macro_recall(scores: Sequence[EventScores]) -> float | None:
    """Return the mean recall of the intentions that have an event."""
    recalls = [score.recall for score in scores if score.recall is not None]
    return float(np.mean(recalls)) if recalls else None


def truths_of(episodes: Sequence[LiveEpisode], settings: ScoringSettings) -> list[Truth]:
    """Return the truth of each episode; where near misses are not neutral, without them."""
    if settings.near_misses == "false":
        episodes = [without_near_misses(episode) for episode in episodes]
    return [Truth.of(episode, settings.before_onset_s) for episode in episodes]
