"""How long work will take beside what else the machine does."""

from __future__ import annotations

import pytest

from isac_cosim.models.training import progress
from isac_cosim.models.training.progress import Steps, slowdown_now
from tests.support.recorded_feedback import RecordedFeedback


@pytest.mark.parametrize(
    ("load", "workers", "cores", "all_cores", "expected"),
    [
        (0.0, 2, 2, 2, 1.0),
        (0.5, 1, 2, 2, 1.0),
        (4.0, 2, 2, 2, 3.0),
        (4.0, 8, 2, 2, 3.0),
        (16.0, 2, 2, 16, 2.0),
    ],
)
def test_other_work_has_its_share_of_the_cores(
    load: float, workers: int, cores: int, all_cores: int, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody else, room for both, twice as many as cores, more workers than cores, a share of a larger machine."""
    monkeypatch.setattr(progress.psutil, "getloadavg", lambda: (load, 0.0, 0.0))
    monkeypatch.setattr(progress.psutil, "cpu_count", lambda: all_cores)
    monkeypatch.setattr(progress, "cpu_count", lambda: cores)
    assert slowdown_now(workers) == expected


def test_a_system_that_does_not_say_its_load_counts_as_idle(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown() -> None:
        raise OSError

    monkeypatch.setattr(progress.psutil, "getloadavg", unknown)
    assert slowdown_now(2) == 1.0


def test_the_estimate_counts_other_work_from_the_first_step_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """And forgets it as the steps show that it has ended."""
    clock = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    feedback = RecordedFeedback()
    steps = Steps(feedback, 1200.0, slowdown=5.0)
    for k in range(2):
        with steps.step(f"step {k}", 600.0, False):
            clock[0] += 600.0
    assert feedback.messages[0] == "step 0; about 1.7 h left"
    assert feedback.messages[1] == f"step 1; about {600 * (600 + 300) / 660 / 60:.0f} min left"
