"""How far long work of several steps has come, and about how long the rest will take."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import psutil

from isac_cosim.base.feedback import Feedback, spoken_time
from isac_cosim.base.workers.engine import cpu_count

SURE_S = 60.0
"""After so much work, the time that steps took counts as much as the time expected of them, s."""


class Steps:
    """Reports each step as it starts, with an estimate of the time that all the remaining ones will take.

    expected_s: expected time of all steps together on an idle machine, s. slowdown: how many times as long other work
    on the machine makes them take, as it looks at the beginning. The estimate is scaled by that, and more and more by
    how much longer or shorter than expected the steps took that were done so far.
    """

    def __init__(self, feedback: Feedback, expected_s: float, slowdown: float = 1.0) -> None:
        self.feedback, self.left_s, self.slowdown = feedback, expected_s, slowdown
        self.took_s = self.expected_s = 0.0

    def skip(self, expected_s: float) -> None:
        """Pass over a step that an earlier command finished; expected_s: what it was expected to take, s."""
        self.left_s -= expected_s

    @contextmanager
    def step(self, title: str, expected_s: float, standing: bool) -> Iterator[None]:
        """Report a step, and time the work inside the `with` block.

        expected_s: what the step is expected to take, s. standing: whether an earlier command finished it; it then is
        neither reported nor timed.
        """
        began = time.monotonic()
        if not standing:
            left_s = self.left_s * (self.took_s + SURE_S * self.slowdown) / (self.expected_s + SURE_S)
            self.feedback.message(f"{title}; about {spoken_time(left_s)} left")
        try:
            yield
        finally:
            self.left_s -= expected_s
            if not standing:
                self.took_s += time.monotonic() - began
                self.expected_s += expected_s


def slowdown_now(workers: int) -> float:
    """Return how many times as long work takes beside what else this machine does at the moment; 1 if it is idle.

    workers: processor cores that the work would use. The other work is the load average of the last minute, of which
    the cores that this process may use are taken to have their share.
    """
    cores = cpu_count()
    try:
        others = float(psutil.getloadavg()[0]) * cores / (psutil.cpu_count() or cores)
    except OSError:
        return 1.0
    return max(1.0, (min(workers, cores) + others) / cores)
