"""One lane of a road network."""

from __future__ import annotations

from dataclasses import dataclass

from isacsim.arrays import Array


@dataclass(frozen=True)
class Lane:
    """One lane of the network, which may lie inside a junction.

    index: 0 is the outermost lane of its edge: the rightmost one, or the leftmost one where traffic keeps left.
    shape: centre line in the scenario's plane, m, (n, 2).
    successors: ids of the lanes that continue this one; at a junction, those inside it.
    """

    id: str
    edge: str
    index: int
    width_m: float
    length_m: float
    shape: Array
    successors: tuple[str, ...]
