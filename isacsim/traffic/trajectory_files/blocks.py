"""A long file cut into blocks with gaps between them: each is an episode of its own, with a number as its seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import BoolArray
from isac_cosim.isacsim.traffic.trajectory_files.observed import Observed


@dataclass(frozen=True)
class Block:
    """A span of steps, both included."""

    first: int
    last: int


def blocks(observed: Observed, block_s: float, gap_s: float) -> list[Block]:
    """Return the blocks of a file: of equal length, about `block_s`, with `gap_s` between them."""
    first, last = int(observed.step.min()), int(observed.step.max())
    total, block, gap = last - first + 1, block_s / observed.period_s, gap_s / observed.period_s
    count = max(1, round((total + gap) / (block + gap)))
    length = (total - (count - 1) * gap) / count
    starts = [first + round(k * (length + gap)) for k in range(count)]
    return [
        Block(start, min(last, start + int(length) - 1) if k < count - 1 else last) for k, start in enumerate(starts)
    ]


def seen_before(observed: Observed, cut: list[Block], number: int) -> BoolArray:
    """Return which vehicles are on the road in a block before the one with this number (from 0), shape (v,)."""
    seen = np.zeros(len(observed.vehicles), bool)
    for earlier in cut[:number]:
        inside = (observed.step >= earlier.first) & (observed.step <= earlier.last)
        counts = np.concatenate([[0], np.cumsum(inside)])
        seen |= counts[observed.starts[1:]] > counts[observed.starts[:-1]]
    return seen
