"""A threshold for each intention: how a budget of false alarms is shared out between the intentions.

Every group of intentions that share a threshold has its own trade of predicted events for false alarms. False alarms
of the groups add up, and so do predicted events. The thresholds of the most predicted events within a budget are those
of a multiple-choice knapsack, which dynamic programming over the whole numbers of false alarms solves exactly
(Kellerer, Pferschy & Pisinger, Knapsack Problems, 2004, section 11.5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isacsim.arrays import Array, IntArray
from labeling.intentions import KNOWN

SILENT = -1
"""The choice of a group that raises no alarm."""


def groups_of(events: IntArray, least_events: int) -> list[tuple[int, ...]]:
    """Return the groups of intentions that share a threshold, as numbers in KNOWN.

    events: number of development events of each intention, (6,). An intention with at least `least_events` is a group
    of its own; the others, whose own curves would say little, form one group.
    """
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
