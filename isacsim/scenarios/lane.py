"""One lane of a road network."""

from __future__ import annotations

from dataclasses import dataclass

from isacsim.arrays import Array


@dataclass(frozen=True)
class Lane:
    """One lane of the network, junction-internal ones included.

    index: 0 is the rightmost lane of its edge. shape: centre line, (n, 2), m, in the scenario's plane.
    successors: ids of the lanes that continue this one (through junctions: the internal lane first).
    """

    id: str
    edge: str
    index: int
    width_m: float
    length_m: float
    shape: Array
    successors: tuple[str, ...]
