"""How many threads numerical libraries use. A sum that is split over threads differs in its last digits.

Every number that is stored is computed inside `limited`, so that it is the same on any number of cores, and whatever
`OMP_NUM_THREADS` says.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import joblib
from threadpoolctl import ThreadpoolController

VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
"""Environment variables that numerical libraries read once, when they are loaded."""


@contextmanager
def limited(count: int = 1) -> Iterator[None]:
    """Let numerical libraries use exactly so many threads inside the `with` block, also with fewer cores than that.

    That holds for torch, too, where it is imported only inside the block. It is not imported here, because it takes
    longer than everything else that generating needs.
    """
    before, libraries = _threads_of_torch(), ThreadpoolController()
    known = {library.filepath for library in libraries.lib_controllers}
    try:
        with libraries.limit(limits=count), told_to_libraries(count):
            _set_threads_of_torch(count)
            yield
    finally:
        for library in ThreadpoolController().lib_controllers:
            if library.filepath not in known:
                library.set_num_threads(before)
        # Last, because a library that gets its own number of threads back may set that of torch, too: they can share
        # one OpenMP runtime.
        _set_threads_of_torch(before)


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Let torch use so many threads inside the `with` block; what other libraries use stays as it is."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _threads_of_torch() -> int:
    """Return how many threads torch uses, or about as many as it will use where it is not imported yet."""
    if "torch" in sys.modules:
        import torch

        return torch.get_num_threads()
    told = os.environ.get(VARIABLES[0], "")
    return int(told) if told.isdecimal() and int(told) else int(joblib.cpu_count())


def _set_threads_of_torch(count: int) -> None:
    if "torch" in sys.modules:
        import torch

        torch.set_num_threads(count)


@contextmanager
def told_to_libraries(count: int) -> Iterator[None]:
    """Let libraries that are loaded inside the block, or by processes started in it, find a number of threads."""
    # MKL would take no more threads than there are cores.
    told = {**dict.fromkeys(VARIABLES, str(count)), "MKL_DYNAMIC": "FALSE"}
    before = {name: os.environ.get(name) for name in told}
    os.environ.update(told)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
