"""What a person sees of long work, on a terminal and in a file."""

from __future__ import annotations

import io

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from isac_cosim.base.progress import ConsoleFeedback, Pace


@given(each_s=st.floats(0.01, 5000.0), done=st.integers(1, 60), left=st.integers(0, 60), wait=st.floats(0.0, 1.0))
def test_the_time_left_of_steady_work_is_what_it_takes(each_s: float, done: int, left: int, wait: float) -> None:
    """However long a unit takes, and while the next one is under way."""
    pace = Pace()
    for k in range(done + 1):
        pace.moved(7 + k, 100.0 + k * each_s)
    expected = max(left - wait, 0.0) * each_s
    assert pace.left_s(7 + done + left, 100.0 + (done + wait) * each_s) == pytest.approx(expected, abs=1e-6 * each_s)


def test_the_time_left_forgets_how_fast_work_was_long_ago() -> None:
    pace = Pace()
    for k in range(11):
        pace.moved(k, 10.0 * k)
    for k in range(1, 6):
        pace.moved(10 + k, 100.0 + 100.0 * k)
    assert pace.left_s(20, 600.0) == pytest.approx(500.0)
    assert len(pace.moves) == 4


def test_nothing_done_leaves_no_estimate() -> None:
    pace = Pace()
    assert pace.left_s(5, 0.0) is None
    pace.moved(3, 0.0)
    pace.moved(3, 400.0)
    assert pace.left_s(5, 500.0) is None


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [1000.0]
    monkeypatch.setattr("isac_cosim.base.progress.time.monotonic", lambda: now[0])
    return now


def test_in_a_file_a_line_says_now_and_then_how_far_the_work_is(clock: list[float]) -> None:
    """At once, a minute later at the earliest, and at the end."""
    console = Console(file=io.StringIO(), width=40)
    with ConsoleFeedback(console).bar("evaluating", "episodes") as move:
        move(0, 20)
        for done in range(1, 21):
            clock[0] += 24.0
            move(done, 20)
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert lines[0] == "evaluating: 0/20 episodes"
    assert lines[1] == "evaluating: 3/20 episodes, after 72 s, about 7 min left"
    assert lines[-1] == "evaluating: 20/20 episodes, after 8 min"
    assert len(lines) == 8


def test_in_a_file_interrupted_work_says_how_far_it_came(clock: list[float]) -> None:
    def interrupted() -> None:
        with ConsoleFeedback(console).bar("training") as move:
            move(40, 200, "epoch 1/5")
            clock[0] += 10.0
            move(60, 200, "epoch 2/5")
            raise KeyboardInterrupt

    console = Console(file=io.StringIO(), width=40)
    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert console.file.getvalue().splitlines() == [  # type: ignore[attr-defined]
        "training: 20 %, epoch 1/5",
        "training: 30 %, epoch 2/5, after 10 s, about 70 s left",
    ]


def test_what_is_refused_before_it_begins_says_nothing() -> None:
    console = Console(file=io.StringIO())
    with pytest.raises(ValueError, match="refused"), ConsoleFeedback(console).bar("training"):
        raise ValueError("refused")
    assert console.file.getvalue() == ""  # type: ignore[attr-defined]


def test_on_a_terminal_units_of_many_minutes_leave_an_estimate(clock: list[float]) -> None:
    console = Console(file=io.StringIO(), width=120, force_terminal=True, color_system=None)
    with ConsoleFeedback(console).bar("evaluating", "episodes") as move:
        move(2, 20)
        for done in (3, 4):
            clock[0] += 400.0
            move(done, 20)
    drawn = console.file.getvalue()  # type: ignore[attr-defined]
    assert "4/20 episodes" in drawn
    assert "left 1:46:40" in drawn
