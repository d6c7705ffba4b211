"""How the lanes of a network are connected: which lane continues which, and which lie side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.trajectory_files.lane_places import LanePlaces

MAX_SKIPPED = 6
"""Maximum number of lanes that a vehicle passes within one step: junction lanes can be centimetres long."""


@dataclass(frozen=True)
class LaneStep:
    """How a vehicle gets from one lane to another between two rows of its track.

    shift_m: offset of the new centre line from the old one, m, left positive. levels: markings crossed, left
    positive.
    """

    shift_m: float
    levels: int


class LaneGraph:
    """Successors, predecessors and neighbours of lanes; a lane is named by its position in the given list.

    lefthand: whether traffic keeps left, so that lanes are numbered from the left.
    """

    def __init__(self, lanes: Sequence[Lane], lefthand: bool = False) -> None:
        self.lanes = lanes
        self.places = LanePlaces(lanes)
        self._leftward = -1 if lefthand else 1
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
        """Return the offset of the centre line of lane b from that of lane a on the same edge, m, left positive."""
        beside = self.on_edge[self.lanes[a].edge]
        i, j = beside.index(a), beside.index(b)
        low, high = min(i, j), max(i, j)
        widths = [self.lanes[k].width_m for k in beside[low : high + 1]]
        distance = sum(widths) - (widths[0] + widths[-1]) / 2
        return self._leftward * (distance if j >= i else -distance)

    def levels(self, a: int, b: int) -> int:
        """Return how many markings lane b lies to the left of lane a on the same edge."""
        return self._leftward * (self.lanes[b].index - self.lanes[a].index)

    def chain(self, a: int, b: int) -> float | None:
        """Return the length of the lanes from the end of lane a to the start of lane b, m; None if unconnected."""
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
        """Return the same as `chain`, from any lane on the edge of a to any lane on the edge of b."""
        pairs = ((i, j) for i in self.on_edge[self.lanes[a].edge] for j in self.on_edge[self.lanes[b].edge])
        return next((length for i, j in pairs if (length := self.chain(i, j)) is not None), None)

    def _steps(self, a: int, b: int) -> tuple[LaneStep, ...]:
        """Return the possible steps from lane a to lane b, fewest markings first; none if they are unconnected.

        On one edge: across the markings in between. Onto another edge: straight on along the successors of a, or with
        a lane change in the same step, before or after the end of the edge.
        """
        if self.lanes[a].edge == self.lanes[b].edge:
            return (LaneStep(self.across(a, b), self.levels(a, b)),)
        steps = set(self._onward(a, b))
        return tuple(sorted(steps, key=lambda step: (abs(step.levels), step.shift_m)))

    def _onward(self, a: int, b: int) -> Iterator[LaneStep]:
        if self.chain(a, b) is not None:
            yield LaneStep(0.0, 0)
        for beside in self.on_edge[self.lanes[a].edge]:
            if beside != a and self.chain(beside, b) is not None:
                yield LaneStep(self.across(a, beside), self.levels(a, beside))
        for beside in self.on_edge[self.lanes[b].edge]:
            if beside != b and self.chain(a, beside) is not None:
                yield LaneStep(self.across(beside, b), self.levels(beside, b))
