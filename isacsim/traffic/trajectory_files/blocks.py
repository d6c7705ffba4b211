"""A long file cut into blocks with gaps between them: each is an episode of its own, with a number as its seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import BoolArray, IntArray
from isac_cosim.isacsim.traffic.trajectory_files.observed import FileStates


@dataclass(frozen=True)
class Block:
    """A span of steps, both included."""

    first: int
    last: int


PAUSE_S = 60.0
"""Where nobody is on the road for longer, a file holds several stretches of time, s."""


def blocks(observed: FileStates, block_s: float, gap_s: float) -> list[Block]:
    """Return the blocks of a file: of equal length in each stretch of time, about `block_s`, with `gap_s` between them.

    Between two stretches nobody is on the road for longer than `PAUSE_S` and `gap_s`, as between recordings of
    different hours in one file.
    """
    cut: list[Block] = []
    for first, last in _stretches(observed.step, max(PAUSE_S, gap_s) / observed.period_s):
        total, block, gap = last - first + 1, block_s / observed.period_s, gap_s / observed.period_s
        count = max(1, round((total + gap) / (block + gap)))
        length = (total - (count - 1) * gap) / count
        starts = [first + round(k * (length + gap)) for k in range(count)]
        cut += [
            Block(start, min(last, start + int(length) - 1) if k < count - 1 else last)
            for k, start in enumerate(starts)
        ]
    return cut


def _stretches(step: IntArray, pause: float) -> list[tuple[int, int]]:
    """Return the first and last step of each stretch of time, with pauses of more than so many steps between them."""
    first = int(step.min())
    seen = np.zeros(int(step.max()) - first + 1, bool)
    seen[step - first] = True
    present = np.flatnonzero(seen)
    pauses = np.flatnonzero(np.diff(present) > pause)
    starts, stops = np.concatenate([[0], pauses + 1]), np.append(pauses, len(present) - 1)
    return [(first + int(present[a]), first + int(present[b])) for a, b in zip(starts, stops, strict=True)]


def seen_before(observed: FileStates, cut: list[Block], number: int) -> BoolArray:
    """Return which vehicles are on the road in a block before the one with this number (from 0), shape (v,)."""
    seen = np.zeros(len(observed.vehicles), bool)
    for earlier in cut[:number]:
        inside = (observed.step >= earlier.first) & (observed.step <= earlier.last)
        seen |= np.logical_or.reduceat(inside, observed.starts[:-1])  # `observed` leaves out vehicles without states
    return seen
