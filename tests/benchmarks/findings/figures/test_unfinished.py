"""What is finished of an unfinished stage is kept, and gone on from where it still holds."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from isac_cosim.benchmarks.findings.figures import record
from isac_cosim.benchmarks.findings.figures.record import PRESENT
from isac_cosim.isacsim.scenarios import demand
from tests.benchmarks.findings.figures.tiny_plan import PLAN, run, state

PIECES = (
    PLAN
    + """
[stage.pieces]
question = "what do two long runs say?"
commands = [
    "mkdir -p $FIGURES/pieces/out",
    "test -e $FIGURES/pieces/out/first || { echo ran >> runs; echo 1 > $FIGURES/pieces/out/first; }",
    "test ! -e stop",
    "cp $FIGURES/pieces/out/first docs/pieces.json",
]
results = ["docs/pieces.json"]
kept = ["out/*"]
cost_min = 9
cost_is = "made up"
parts = ["traffic"]
"""
)


@pytest.fixture
def kept(root: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    """A checkout in which the first of two long runs was kept, and the work was lost."""
    (root / "plan.toml").write_text(PIECES)
    (root / "stop").touch()
    assert run(root, "pieces") == 1
    assert run(root, "keep") == 0
    assert "pieces: 1 files kept in docs/unfinished/pieces; commit them" in capsys.readouterr().out
    shutil.rmtree(root / "results")
    (root / "stop").unlink()
    return root


def times_run(root: Path) -> int:
    return len((root / "runs").read_text().split())


def test_a_run_goes_on_from_what_was_kept_of_a_lost_one(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(kept, "pieces") == 0
    assert "goes on from" in capsys.readouterr().err
    assert (times_run(kept), state(kept, "pieces")) == (1, PRESENT)
    assert not (kept / "docs/unfinished/pieces").exists()


def test_what_other_settings_or_versions_left_is_not_gone_on_from(
    kept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(demand, "HEADWAY_S", 9.5)
    assert run(kept, "pieces") == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "is of other settings: traffic (isacsim.scenarios.demand.HEADWAY_S); begins anew" in said
    assert times_run(kept) == 2


def test_another_version_begins_anew(
    kept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(record, "versions", lambda _: {"torch": "9.9"})
    assert run(kept, "pieces") == 0
    assert "install that to go on from it; begins anew" in " ".join(capsys.readouterr().err.split())
    assert times_run(kept) == 2


def test_a_kept_file_that_was_changed_is_refused(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (kept / "docs/unfinished/pieces/out/first").write_text("2")
    assert run(kept, "pieces") == 1
    assert "out/first: is not the file that was kept" in " ".join(capsys.readouterr().err.split())
    assert times_run(kept) == 1


def test_less_than_before_is_not_kept(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (kept / "stop").touch()
    run(kept, "pieces")
    (kept / "results/figures/pieces/out/first").rename(kept / "results/figures/pieces/out/second")
    assert run(kept, "keep") == 2
    assert "docs/unfinished/pieces/out/first: is not in" in capsys.readouterr().err


def test_what_is_begun_with_other_settings_is_not_kept(
    kept: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (kept / "stop").touch()
    run(kept, "pieces")
    monkeypatch.setattr(demand, "HEADWAY_S", 9.5)
    assert run(kept, "keep") == 0
    assert "was begun with other settings: traffic" in capsys.readouterr().out


def test_nothing_is_kept_of_what_is_finished(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (root / "plan.toml").write_text(PIECES)
    run(root)
    assert run(root, "keep") == 0
    assert capsys.readouterr().out == "nothing is finished of an unfinished stage\n"
