"""How many threads numerical libraries use. A sum that is split over threads differs in its last digits.

Every number that is stored is computed inside `limited`, so that it is the same on any number of cores, and whatever
`OMP_NUM_THREADS` says.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from threadpoolctl import threadpool_limits


@contextmanager
def limited(count: int = 1) -> Iterator[None]:
    """Let numerical libraries use exactly so many threads inside the `with` block, also with fewer cores than that."""
    before = torch.get_num_threads()
    try:
        with threadpool_limits(count):
            torch.set_num_threads(count)
            yield
    finally:
        # Last, because a library that gets its own number of threads back may set that of torch, too: they can share
        # one OpenMP runtime.
        torch.set_num_threads(before)
