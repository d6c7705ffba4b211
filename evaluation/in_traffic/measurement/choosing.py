"""Chooses the settings of alarms on the development seeds: how windows confirm each other, and the thresholds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.evaluation.in_traffic.alarms.alarms import Levels, confirmed, hazard_levels, reject_levels
from isac_cosim.evaluation.in_traffic.alarms.background import NOT_KEPT, KeptTrees, out_of_fold
from isac_cosim.evaluation.in_traffic.scores.curves import ThresholdSweep, candidate_thresholds
from isac_cosim.evaluation.in_traffic.scores.scoring import Truth
from isac_cosim.evaluation.in_traffic.settings import (
    AlarmSettings,
    ChoiceSettings,
    LiveSettings,
    Sharing,
    shown_threshold,
)
from isac_cosim.labeling.intentions import KNOWN

HIGHEST_RATE = 100.0
"""False alarms per vehicle-hour up to which budgets are shared out."""


@dataclass(frozen=True)
class Chosen:
    """Alarm settings chosen on the development seeds.

    quiet: whether they keep to the rate of false alarms there; otherwise they have the highest F1. score: their recall,
    or F1. path: the thresholds that the same seeds choose for growing budgets of false alarms, (t, 6); None if all
    intentions share a threshold.
    """

    alarms: AlarmSettings
    quiet: bool
    score: float
    path: Array | None = None

    @property
    def rank(self) -> tuple[bool, float]:
        """The key to compare settings by: the better ones have a greater key."""
        return self.quiet, self.score


@dataclass(frozen=True)
class Combination:
    """Settings of alarms without thresholds, with what they give on the development seeds at many thresholds.

    template: the settings. shared: the sweep of a threshold that all intentions share. allocation: how a budget of
    false alarms is best shared out, where each threshold counts one false alarm more than it has: a threshold that lies
    just above a false alarm is chosen for that, and has more in other traffic. groups, candidates: the intentions that
    share a threshold, and the thresholds of each group. hours, events: vehicle-hours, and events that count.
    thresholds: the most steps of a path.
    """

    template: AlarmSettings
    shared: ThresholdSweep
    allocation: Allocation
    groups: tuple[tuple[int, ...], ...]
    candidates: tuple[Array, ...]
    hours: float
    events: int
    thresholds: int

    @classmethod
    def of(
        cls, truths: Sequence[Truth], levels: Sequence[Levels], template: AlarmSettings, choice: ChoiceSettings
    ) -> Combination:
        """Try thresholds on the development seeds. levels: confirmed, one for each episode."""
        common = candidate_thresholds(levels, choice.thresholds)
        shared = ThresholdSweep.of(
            truths, levels, np.tile(common[:, None], len(KNOWN)), template.refractory_s, template.rise
        )
        events = sum((np.bincount(truth.table.intention, minlength=len(KNOWN)) for truth in truths), _no_events())
        asked = truths[0].asked if truths else None
        groups = groups_of(events, choice.least_events, asked)
        candidates = [candidate_thresholds(levels, choice.thresholds, group) for group in groups]
        # The columns are independent: one row holds the thresholds of all groups, and infinity where a group has fewer.
        table = np.full((max(map(len, candidates)), len(KNOWN)), np.inf)
        for group, values in zip(groups, candidates, strict=True):
            table[: len(values), list(group)] = values[:, None]
        # A single group has the thresholds that all intentions share.
        sweep = (
            shared
            if len(groups) == 1
            else ThresholdSweep.of(truths, levels, table, template.refractory_s, template.rise)
        )
        counts = sweep.by_intention.sum(axis=1).astype(np.int64)
        hours = float(sum(truth.episode.vehicle_hours for truth in truths))
        parts = [
            counts[: len(values), list(group)].sum(axis=1) for group, values in zip(groups, candidates, strict=True)
        ]
        # Above the level of the (m + 1)-th false alarm, other traffic gives m + 1 false alarms in the mean, not m.
        allocation = Allocation.of(
            [part[:, 0] for part in parts], [part[:, 1] + 1 for part in parts], _budget(HIGHEST_RATE, hours)
        )
        return cls(
            template, shared, allocation, tuple(groups), tuple(candidates), hours, int(events.sum()), choice.thresholds
        )

    def choose(self, rate: float, sharing: Sharing) -> Chosen | None:
        """Return the best thresholds at a rate of false alarms; None if the development seeds give no threshold.

        If no threshold is that quiet, the threshold of the highest F1 is returned. With `separate`, too, all intentions
        share a threshold if the development seeds do not suffice: no intention has enough events, or thresholds of
        their own predict no event within the budget.
        """
        if not len(self.shared.thresholds):
            return None
        if sharing == "separate" and (chosen := self._separate(rate)) is not None:
            return chosen
        best = self.shared.best(rate)
        scores = self.shared.recalls() if best is not None else self.shared.f1()
        row = int(scores.argmax()) if best is None else best
        return Chosen(self._with(self.shared.thresholds[row]), best is not None, float(scores[row]))

    def _separate(self, rate: float) -> Chosen | None:
        budget = min(_budget(rate, self.hours), len(self.allocation.predicted) - 1)
        predicted = int(self.allocation.predicted[budget])
        if not predicted or len(self.groups) == 1:
            return None
        steps = self.allocation.steps()
        ranks = np.unique(np.rint(np.geomspace(1, len(steps), self.thresholds)).astype(np.int64)) - 1
        path = np.stack([self._thresholds(step) for step in steps[ranks].tolist()])
        return Chosen(self._with(self._thresholds(budget)), True, predicted / self.events, path)

    def _thresholds(self, budget: int) -> Array:
        return combined(self.allocation.rows(budget), self.groups, self.candidates)

    def _with(self, thresholds: Array) -> AlarmSettings:
        return self.template.model_copy(update={"threshold": shown_threshold(thresholds)})


@dataclass(frozen=True)
class Options:
    """The combinations of alarm settings among which the development seeds choose, for one kind of alarm."""

    combinations: tuple[Combination, ...]

    def choose(self, rate: float, sharing: Sharing) -> Chosen | None:
        """Return the best settings at a rate of false alarms per vehicle-hour; None if no vehicle was predicted."""
        chosen = [combination.choose(rate, sharing) for combination in self.combinations]
        return max((option for option in chosen if option is not None), key=lambda option: option.rank, default=None)


@dataclass(frozen=True)
class AlarmCandidate:
    """Levels from which alarms of one kind are chosen.

    template: settings of these alarms, without thresholds. levels: not confirmed, of all intentions in each development
    episode.
    """

    template: AlarmSettings
    levels: Sequence[Levels]
    # Several questions are asked of the same levels.
    _confirmed: dict[tuple[int, int], list[Levels]] = field(default_factory=dict, init=False, repr=False, compare=False)

    def confirmed(self, k: int, n: int) -> list[Levels]:
        """Return the confirmed levels of each episode."""
        if (k, n) not in self._confirmed:
            self._confirmed[k, n] = [confirmed(level, k, n) for level in self.levels]
        return self._confirmed[k, n]


def reject_candidates(truths: Sequence[Truth], predictor: str, choice: ChoiceSettings) -> list[AlarmCandidate]:
    """Return the levels of alarms by the unknown score."""
    return [
        AlarmCandidate(
            AlarmSettings(method="reject", threshold=0.0, least_probability=least),
            [Levels.of(truth.episode, reject_levels(truth.episode.answers[predictor], least)) for truth in truths],
        )
        for least in choice.least_probabilities
    ]


def hazard_candidates(truths: Sequence[Truth], predictor: str, choice: ChoiceSettings) -> list[AlarmCandidate]:
    """Return the levels of alarms by the log-odds of a run that was trained on streams."""
    levels = [Levels.of(truth.episode, hazard_levels(truth.episode.answers[predictor])) for truth in truths]
    return [AlarmCandidate(AlarmSettings(method="hazard", threshold=0.0, rise=choice.rise), levels)]


def background_candidates(
    truths: Sequence[Truth], predictor: str, settings: LiveSettings, kept: KeptTrees = NOT_KEPT
) -> list[AlarmCandidate]:
    """Return the levels of alarms by the trees that know "none"; there are none if the seeds do not suffice."""
    episodes = [truth.episode for truth in truths]
    levels = out_of_fold(episodes, settings.background, settings.scoring.before_onset_s, predictor, kept)
    if levels is None:
        return []
    of_episodes = [Levels.of(episode, level) for episode, level in zip(episodes, levels, strict=True)]
    return [AlarmCandidate(AlarmSettings(method="background", threshold=0.0, rise=settings.choice.rise), of_episodes)]


def options_of(truths: Sequence[Truth], candidates: Sequence[AlarmCandidate], choice: ChoiceSettings) -> Options:
    """Return the alarm settings that the development seeds choose among: each candidate with each confirmation."""
    combinations = []
    for candidate in candidates:
        for k, n in choice.confirmations:
            steady = candidate.confirmed(k, n)
            levels = [level.asking(truth.asked) for truth, level in zip(truths, steady, strict=True)]
            template = candidate.template.model_copy(update={"k": k, "n": n, "refractory_s": choice.refractory_s})
            combinations.append(Combination.of(truths, levels, template, choice))
    return Options(tuple(combinations))


def _budget(rate: float, hours: float) -> int:
    """Return the whole number of false alarms that a rate per vehicle-hour allows."""
    return int(np.floor((rate + 1e-9) * hours + 1e-9))


def _no_events() -> IntArray:
    return np.zeros(len(KNOWN), np.int64)


SILENT = -1
"""The choice of a group that raises no alarm."""


def groups_of(events: IntArray, least_events: int, asked: Sequence[int] | None = None) -> list[tuple[int, ...]]:
    """Return the groups of intentions that share a threshold, as numbers in KNOWN.

    events: number of development events of each intention, (6,). An intention with at least `least_events` is a group
    of its own; the others, whose own curves would say little, form one group. asked: the intentions that alarms are
    raised for, all if None; a single one needs no group beside it.
    """
    if asked is not None and len(asked) == 1:
        return [tuple(range(len(KNOWN)))]
    frequent = np.flatnonzero(events >= least_events).tolist()
    rare = tuple(k for k in range(len(KNOWN)) if k not in frequent)
    return [*((k,) for k in frequent), *([rare] if rare else [])]


@dataclass(frozen=True)
class Allocation:
    """The best choice of every group for every budget up to some number of false alarms.

    predicted: the most predicted events within each budget, (budget + 1,). choices: of each group and budget, the row
    of its thresholds, or SILENT, (groups, budget + 1). costs: false alarms at each row of each group.
    """

    predicted: IntArray
    choices: IntArray
    costs: tuple[IntArray, ...]

    @classmethod
    def of(cls, predicted: Sequence[IntArray], false: Sequence[IntArray], budget: int) -> Allocation:
        """Solve the knapsack. predicted, false: counts at the thresholds of each group, strict to lenient, (t,) each.

        Of equal choices for a group, the strictest wins.
        """
        best = np.zeros(budget + 1, np.int64)
        choices = np.full((len(predicted), budget + 1), SILENT, np.int64)
        for group, (gains, costs) in enumerate(zip(predicted, false, strict=True)):
            before, best = best, best.copy()
            for row in np.flatnonzero(costs <= budget).tolist():
                total = before[: budget + 1 - costs[row]] + gains[row]
                better = total > best[costs[row] :]
                best[costs[row] :][better] = total[better]
                choices[group, costs[row] :][better] = row
        return cls(best, choices, tuple(np.asarray(costs, np.int64) for costs in false))

    def rows(self, budget: int) -> IntArray:
        """Return the row of thresholds of each group at a budget, or SILENT, (groups,).

        Of budgets that predict equally many events, the smallest counts.
        """
        left = int(np.searchsorted(self.predicted, self.predicted[budget]))
        rows = np.full(len(self.choices), SILENT, np.int64)
        for group in reversed(range(len(rows))):
            row = rows[group] = self.choices[group, left]
            left -= 0 if row == SILENT else int(self.costs[group][row])
        return rows

    def steps(self) -> IntArray:
        """Return the budgets at which more events are predicted than at any smaller one, rising."""
        return np.flatnonzero(np.diff(self.predicted, prepend=0) > 0)


def combined(rows: IntArray, groups: Sequence[Sequence[int]], candidates: Sequence[Array]) -> Array:
    """Return the threshold of each intention, infinite where it is silent, (6,).

    rows: of each group. candidates: the thresholds of each group, (t,) each.
    """
    thresholds = np.full(len(KNOWN), np.inf)
    for row, group, values in zip(rows.tolist(), groups, candidates, strict=True):
        if row != SILENT:
            thresholds[list(group)] = values[row]
    return thresholds
