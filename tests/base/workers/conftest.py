"""A folder with a command whose episodes never end by themselves."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.held_command import make_folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    make_folder(tmp_path)
    return tmp_path
