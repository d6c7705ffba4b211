"""The checkout of the tests: a folder with the tiny plan."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.benchmarks.findings.figures.tiny_plan import PAGE, PLAN, SCORES


@pytest.fixture
def root(tmp_path: Path) -> Path:
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "page.md").write_text(PAGE)
    (tmp_path / "docs" / "scores.py").write_text(SCORES)
    (tmp_path / "plan.toml").write_text(PLAN)
    return tmp_path
