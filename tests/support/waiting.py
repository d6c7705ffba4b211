"""Waiting for what other processes do, at whatever speed they do it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

Value = TypeVar("Value")

HANGING_S = 900.0
"""A process that shows nothing for so long hangs; the slowest of machines takes less, s."""


def wait_until(condition: Callable[[], Value], running: Callable[[], object] = lambda: True) -> Value:
    """Return the value of a condition as soon as it is true.

    running: whether it can still become true. Fails where it no longer can, or where everything hangs.
    """
    begin = time.monotonic()
    while not (value := condition()):
        assert running() or condition(), "the process ended before the condition became true"
        assert time.monotonic() < begin + HANGING_S, f"nothing happened within {HANGING_S:.0f} s"
        time.sleep(0.02)
    return value
