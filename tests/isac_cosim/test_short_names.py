"""`isac_cosim.open` and `isac_cosim.load`: what they load, and how what they return describes itself."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import isac_cosim
from isac_cosim.models.runs.run import Run
from tests.support.made_up_dataset import write_dataset

LIBRARIES = (
    "torch",
    "torch._dynamo",
    "lightning",
    "torchmetrics",
    "sklearn",
    "skops",
    "scipy",
    "pandas",
    "pyarrow",
    "matplotlib",
    "rich",
)
"""What takes long to import."""


def imported_by(line: str) -> set[str]:
    """The LIBRARIES that a line of Python imports in a fresh process."""
    script = f"import json, sys\n{line}\nprint(json.dumps([name for name in {LIBRARIES} if name in sys.modules]))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout))


@pytest.mark.parametrize(
    ("line", "libraries"),
    [
        ("import isac_cosim", set()),
        ("import isac_cosim.models.inference", {"torch"}),
        ("import isac_cosim.labeling.dataset.dataset", {"pyarrow"}),
    ],
)
def test_an_import_costs_what_it_uses(line: str, libraries: set[str]) -> None:
    assert imported_by(line) == libraries


def test_a_network_that_answers_needs_no_training(network_run: Run) -> None:
    libraries = imported_by(f"import isac_cosim\nisac_cosim.load({str(network_run.path)!r})")
    assert "torch" in libraries
    assert libraries.isdisjoint({"torch._dynamo", "lightning", "torchmetrics", "matplotlib"})


@pytest.mark.parametrize("deep", [False, True], ids=["here", "far away"])
def test_a_dataset_describes_itself_in_a_line(deep: bool, tmp_path: Path) -> None:
    folder = tmp_path / ("a long name, " * 9 if deep else "") / "data"
    folder.parent.mkdir(exist_ok=True)
    write_dataset(folder, seeds=2, per_class=1)
    text = repr(isac_cosim.open(folder))
    assert "14 samples from 2 episodes of 'toy'" in text
    assert text.startswith("<Dataset ")
    assert 60 < len(text) <= 120
    assert "\n" not in text


@pytest.mark.parametrize("kind", ["network_run", "trees_run"])
def test_a_predictor_describes_itself_in_a_line(kind: str, request: pytest.FixtureRequest) -> None:
    run: Run = request.getfixturevalue(kind)
    text = repr(isac_cosim.load(run.path))
    for word in (run.card.settings.model, "6 intentions", str(run.card.tv_length), str(run.card.uv_length)):
        assert word in text
    assert 60 < len(text) <= 120
    assert "\n" not in text
    assert len(repr(run)) <= 120
