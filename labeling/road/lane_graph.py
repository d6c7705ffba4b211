"""How the lanes of a network hang together: which continues which, and what lies beside what."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

from isacsim.scenarios.lane import Lane

MAX_SKIPPED = 6
"""Lanes that a vehicle may pass within one step: junction lanes can be centimetres long."""


@dataclass(frozen=True)
class LaneStep:
    """How a vehicle got from one lane to another between two rows.

    shift_m: how far left the new centre line lies of the old one, m. levels: markings crossed, left positive.
    """

    shift_m: float
    levels: int


class LaneGraph:
    """Successors, predecessors and neighbours of lanes, by their position in the recording's list."""

    def __init__(self, lanes: Sequence[Lane]) -> None:
        self.lanes = lanes
        number = {lane.id: k for k, lane in enumerate(lanes)}
        self.successors = [tuple(number[s] for s in lane.successors if s in number) for lane in lanes]
        self.predecessors: list[list[int]] = [[] for _ in lanes]
        for k, following in enumerate(self.successors):
            for s in following:
                self.predecessors[s].append(k)
        self.on_edge: dict[str, list[int]] = {}
        for k, lane in enumerate(lanes):
            self.on_edge.setdefault(lane.edge, []).append(k)
        for beside in self.on_edge.values():
            beside.sort(key=lambda k: lanes[k].index)
        self.steps = lru_cache(maxsize=None)(self._steps)

    def across(self, a: int, b: int) -> float:
        """Distance from the centre line of lane a to that of lane b of the same edge, m, left positive."""
        beside = self.on_edge[self.lanes[a].edge]
        i, j = beside.index(a), beside.index(b)
        low, high = min(i, j), max(i, j)
        widths = [self.lanes[k].width_m for k in beside[low : high + 1]]
        distance = sum(widths) - (widths[0] + widths[-1]) / 2
        return distance if j >= i else -distance

    def chain(self, a: int, b: int) -> float | None:
        """Length of the lanes between the end of lane a and the start of lane b downstream, m; None if unconnected."""
        reached: dict[int, float] = {a: 0.0}
        for _ in range(MAX_SKIPPED):
            onward: dict[int, float] = {}
            for k, length in reached.items():
                if b in self.successors[k]:
                    return length
                for s in self.successors[k]:
                    onward.setdefault(s, length + self.lanes[s].length_m)
            reached = onward
        return None

    def link(self, a: int, b: int) -> float | None:
        """As `chain`, from any lane of a's edge to any of b's."""
        pairs = ((i, j) for i in self.on_edge[self.lanes[a].edge] for j in self.on_edge[self.lanes[b].edge])
        return next((length for i, j in pairs if (length := self.chain(i, j)) is not None), None)

    def _steps(self, a: int, b: int) -> tuple[LaneStep, ...]:
        """The ways to get from lane a to lane b in one step, fewest markings first; none if they are unconnected.

        On one edge: across the markings between. Onto another edge: straight on along a's successors, or with a change
        of lane at the same instant, before the edge's end or after it.
        """
        lane_a, lane_b = self.lanes[a], self.lanes[b]
        if lane_a.edge == lane_b.edge:
            return (LaneStep(self.across(a, b), lane_b.index - lane_a.index),)
        found = set(self._onward(a, b))
        return tuple(sorted(found, key=lambda step: (abs(step.levels), step.shift_m)))

    def _onward(self, a: int, b: int) -> Iterator[LaneStep]:
        if self.chain(a, b) is not None:
            yield LaneStep(0.0, 0)
        for beside in self.on_edge[self.lanes[a].edge]:
            if beside != a and self.chain(beside, b) is not None:
                yield LaneStep(self.across(a, beside), self.lanes[beside].index - self.lanes[a].index)
        for beside in self.on_edge[self.lanes[b].edge]:
            if beside != b and self.chain(a, beside) is not None:
                yield LaneStep(self.across(beside, b), self.lanes[b].index - self.lanes[beside].index)
