"""Measures predictors on the episodes of an evaluation: alarms chosen on development seeds, measured on the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isacsim.arrays import Float32Array
from isacsim.seeding import stream
from labeling.intentions import KNOWN
from models.live import scoring
from models.live.alarms import Alarms, Levels, alarms, confirmed, duty_cycle, reject_levels
from models.live.background import Background, out_of_fold
from models.live.results import AlarmResult, EventScores
from models.live.scoring import Outcome, Sweep, Truth
from models.live.settings import AlarmSettings, ChoiceSettings, LiveSettings
from models.live.store import LiveEpisode


@dataclass(frozen=True)
class Chosen:
    """Alarm settings chosen on the development seeds.

    quiet: whether they keep to the rate of false alarms there; otherwise they have the highest F1. score: their recall,
    or F1.
    """

    alarms: AlarmSettings
    quiet: bool
    score: float

    @property
    def rank(self) -> tuple[bool, float]:
        """What the better settings have more of."""
        return self.quiet, self.score


@dataclass(frozen=True)
class Measured:
    """What a predictor with one kind of alarm measured.

    outcomes, alarms: of each measured episode. sweep: its curve, None if its alarms have no threshold.
    """

    result: AlarmResult
    outcomes: tuple[Outcome, ...]
    alarms: tuple[Alarms, ...]
    sweep: Sweep | None


def choose_reject(truths: Sequence[Truth], predictor: str, choice: ChoiceSettings) -> Chosen | None:
    """Choose the settings of alarms by the unknown score; None if no vehicle was watched."""
    options = []
    for least in choice.least_probabilities:
        levels = [reject_levels(truth.episode.answers[predictor], least) for truth in truths]
        template = AlarmSettings(method="reject", threshold=0.0, least_probability=least)
        options += _options(truths, levels, template, choice)
    return max(options, key=lambda option: option.rank, default=None)


def choose_background(truths: Sequence[Truth], predictor: str, settings: LiveSettings) -> Chosen | None:
    """Choose the settings of alarms by the trees that know "none"; None if the development seeds do not suffice."""
    episodes = [truth.episode for truth in truths]
    levels = out_of_fold(episodes, settings.background, settings.scoring.before_onset_s, predictor)
    if levels is None:
        return None
    options = _options(truths, levels, AlarmSettings(method="background", threshold=0.0), settings.choice)
    return max(options, key=lambda option: option.rank, default=None)


def measure_methods(
    development: Sequence[Truth], measured: Sequence[Truth], predictor: str, live: LiveSettings, name: str
) -> dict[str, Measured]:
    """Measure both kinds of alarm of a predictor with features, the better one on the development seeds first.

    predictor: in the episodes. name: in the result. A kind that cannot be chosen is left out.
    """
    episodes = [truth.episode for truth in development]
    background = Background.fit(episodes, live.background, live.scoring.before_onset_s, predictor)
    options = {"reject": choose_reject(development, predictor, live.choice)}
    if background is not None:
        options["background"] = choose_background(development, predictor, live)
    chosen = {method: option for method, option in options.items() if option is not None}
    return {
        method: measure(
            measured, levels_of(measured, predictor, chosen[method].alarms, background), chosen[method], live, name
        )
        for method in sorted(chosen, key=lambda method: chosen[method].rank, reverse=True)
    }


def _options(
    truths: Sequence[Truth], levels: Sequence[Float32Array], template: AlarmSettings, choice: ChoiceSettings
) -> list[Chosen]:
    """Return the best threshold for each confirmation; that of the highest F1 where none is quiet enough."""
    options = []
    for k, n in choice.confirmations:
        of_episodes = [
            confirmed(Levels.of(truth.episode, level), k, n) for truth, level in zip(truths, levels, strict=True)
        ]
        sweep = Sweep.of(truths, of_episodes, choice.refractory_s, choice.thresholds)
        if not len(sweep.thresholds):
            continue
        best = sweep.best(choice.false_alarms_per_vehicle_hour)
        scores = sweep.recalls() if best is not None else sweep.f1()
        row = int(scores.argmax()) if best is None else best
        update = {"threshold": float(sweep.thresholds[row]), "k": k, "n": n, "refractory_s": choice.refractory_s}
        options.append(Chosen(template.model_copy(update=update), best is not None, float(scores[row])))
    return options


def levels_of(
    truths: Sequence[Truth], predictor: str, settings: AlarmSettings, background: Background | None
) -> list[Levels]:
    """Return the levels of each episode for alarms of some settings, not confirmed."""
    levels = []
    for truth in truths:
        if settings.method == "background":
            assert background is not None
            level = background.levels(truth.episode)
        else:
            level = reject_levels(truth.episode.answers[predictor], settings.least_probability)
        levels.append(Levels.of(truth.episode, level))
    return levels


def measure(
    truths: Sequence[Truth], levels: Sequence[Levels], chosen: Chosen, live: LiveSettings, name: str
) -> Measured:
    """Measure alarms of frozen settings on episodes. levels: not confirmed. name: of the predictor."""
    settings = chosen.alarms
    raised = [alarms(level, settings) for level in levels]
    outcomes = [truth.outcome(episode_alarms) for truth, episode_alarms in zip(truths, raised, strict=True)]
    steady = [confirmed(level, settings.k, settings.n) for level in levels]
    sweep = Sweep.of(truths, steady, settings.refractory_s, live.choice.thresholds)
    shares = [(duty_cycle(level, settings) or 0.0, len(level.time_s)) for level in levels]
    total = sum(count for _, count in shares)
    duty = sum(share * count for share, count in shares) / total if total else None
    result = result_of(truths, outcomes, chosen, live, name, sweep, duty)
    return Measured(result, tuple(outcomes), tuple(raised), sweep)


def measure_random(truths: Sequence[Truth], like: Measured, live: LiveSettings) -> Measured:
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
    result = result_of(truths, outcomes, None, live, "random alarms", None, None)
    return Measured(result, tuple(outcomes), tuple(raised), None)


def result_of(
    truths: Sequence[Truth],
    outcomes: Sequence[Outcome],
    chosen: Chosen | None,
    live: LiveSettings,
    name: str,
    sweep: Sweep | None,
    duty: float | None,
) -> AlarmResult:
    """Return the scores of the outcomes of episodes."""
    every = scoring.group_scores(outcomes, live.scoring, name)
    km = sum(truth.episode.facts.covered_km for truth in truths)
    rates = live.scoring.false_alarms_per_vehicle_hour
    return AlarmResult(
        name=name,
        alarms=None if chosen is None else chosen.alarms,
        alarms_keep_to_rate=None if chosen is None else chosen.quiet,
        over_all=every.over_all,
        macro_recall=_macro_recall(list(every.by_intention.values())),
        by_intention=every.by_intention,
        natural=scoring.group_scores(outcomes, live.scoring, name, "natural"),
        reaction=scoring.group_scores(outcomes, live.scoring, name, "reaction"),
        commanded=scoring.group_scores(outcomes, live.scoring, name, "commanded"),
        recall_at=[] if sweep is None else [sweep.point(rate, live.scoring, name) for rate in rates],
        recall_by_time_to_commit=scoring.by_time_to_commit(outcomes),
        false_alarms_per_100_km=100 * every.over_all.false_alarms / km if km else None,
        duty_cycle=duty,
    )


def no_alarms(truths: Sequence[Truth], live: LiveSettings, name: str) -> Measured:
    """Return what a predictor measures that never raises an alarm, for want of any threshold."""
    no_rows = np.empty(0, np.int64)
    nothing = Alarms(no_rows, no_rows, no_rows, np.empty(0))
    outcomes = [truth.outcome(nothing) for truth in truths]
    result = result_of(truths, outcomes, None, live, name, None, None)
    return Measured(result, tuple(outcomes), (nothing,) * len(truths), None)


def _macro_recall(scores: Sequence[EventScores]) -> float | None:
    """Return the mean recall of the intentions that have an event."""
    recalls = [score.recall for score in scores if score.recall is not None]
    return float(np.mean(recalls)) if recalls else None


def truths_of(episodes: Sequence[LiveEpisode], before_onset_s: float) -> list[Truth]:
    """Return the truth of each episode."""
    return [Truth.of(episode, before_onset_s) for episode in episodes]
