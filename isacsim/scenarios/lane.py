"""One lane of a road network."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from isac_cosim.base.arrays import Array, ComplexArray


@dataclass(frozen=True)
class Lane:
    """One lane of the network, which may lie inside a junction.

    index: 0 is the outermost lane of its edge: the rightmost one, or the leftmost one where traffic keeps left.
    shape: centre line in the scenario's plane, m, (n, 2).
    successors: ids of the lanes that continue this one; at a junction, those inside it.
    uneven: whether its width varies, of which `width_m` is the mean.
    """

    id: str
    edge: str
    index: int
    width_m: float
    length_m: float
    shape: Array
    successors: tuple[str, ...]
    uneven: bool = False

    @cached_property
    def segments(self) -> tuple[Array, ComplexArray]:
        """The straight segments of the centre line: where each ends, m along the lane, and its direction, both (k,).

        Directions are complex unit vectors. SUMO stretches the shape of a lane to the lane's length. Segments without
        extent are left out, so that a lane without any extent has none.
        """
        steps = np.diff(self.shape @ np.array([1.0, 1.0j]))
        lengths = np.abs(steps)
        steps, lengths = steps[lengths > 0], lengths[lengths > 0]
        ends = np.cumsum(lengths)
        return ends * (self.length_m / ends[-1] if len(ends) else 1.0), steps / lengths
