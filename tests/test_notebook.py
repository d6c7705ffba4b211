"""The notebook of first steps runs from its first cell to its last, on less data."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

import cosim

NOTEBOOK = Path(cosim.__file__).parent / "docs" / "first_steps.ipynb"
TRAFFIC = "straight_road --source kinematic --seeds 1:3 --snr 0:10"


@pytest.mark.slow
def test_it_goes_from_nothing_to_scores_and_to_a_predictor_of_ones_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"])))
    monkeypatch.setenv("FIRST_STEPS_TRAFFIC", TRAFFIC)
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert (tmp_path / "first_steps" / "result" / "index.html").is_file()
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    drawn = [output.get("data", {}) for cell in code for output in cell.outputs]
    assert any("image/png" in data for data in drawn)
    assert 0.0 <= float(code[-1].outputs[-1]["data"]["text/plain"]) <= 1.0


def test_it_is_stored_without_what_it_printed() -> None:
    for cell in nbformat.read(NOTEBOOK, as_version=4).cells:
        assert cell.cell_type != "code" or not (cell.outputs or cell.execution_count)
