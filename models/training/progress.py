"""How far long work of several steps has come, and about how long the rest will take."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from isac_cosim.base.feedback import Feedback

SURE_S = 60.0
"""After so much work, the time that steps took counts as much as the time expected of them, s."""


class Steps:
    """Reports each step as it starts, with an estimate of the time that all the remaining ones will take.

    expected_s: expected time of all steps together, s. The estimate is scaled by how much longer or shorter than
    expected the steps took that were done so far.
    """

    def __init__(self, feedback: Feedback, expected_s: float) -> None:
        self.feedback, self.left_s = feedback, expected_s
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
            left_s = self.left_s * (self.took_s + SURE_S) / (self.expected_s + SURE_S)
            self.feedback.message(f"{title}; about {spoken_time(left_s)} left")
        try:
            yield
        finally:
            self.left_s -= expected_s
            if not standing:
                self.took_s += time.monotonic() - began
                self.expected_s += expected_s


def spoken_time(seconds: float) -> str:
    """Return a duration in the unit that suits it: `40 s`, `12 min`, `3.5 h`."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
