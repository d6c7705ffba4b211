"""What version 0.2.0 wrote opens; what an older version wrote is refused by a line that names the version."""

from __future__ import annotations

import json
import tarfile
from pathlib import Path

import numpy as np
import pytest

import cosim
import isac_cosim
from isac_cosim.evaluation.on_windows.results import read_metrics

STORED = Path(__file__).parent / "support" / "stored" / "version_0_2_0.tar.xz"
"""A dataset of 28 samples at 10 Hz, trees of two rounds trained on it, and their evaluation. Version 0.2.0 wrote them,
from its own tests' made-up records."""
FILES = ("dataset/dataset.json", "run/run.json", "run/evaluation/metrics.json")


@pytest.fixture
def stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with what version 0.2.0 wrote in it."""
    with tarfile.open(STORED) as archive:
        archive.extractall(tmp_path, filter="data")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_dataset_of_version_0_2_0_opens(stored: Path) -> None:
    dataset = isac_cosim.open(stored / "dataset")
    dataset.verify()
    assert len(dataset) == 28
    assert dataset.meta.by_origin() == {"commanded": 12, "natural": 16}
    assert dataset.digest == read_metrics(stored / "run" / "evaluation").made_by.dataset.digest  # type: ignore[union-attr]


def test_a_run_of_version_0_2_0_answers(stored: Path) -> None:
    infer, states = isac_cosim.load(stored / "run"), isac_cosim.open(stored / "dataset").arrays("tv", "uv")
    windows = (states[name][:, :, -12:] for name in ("tv", "uv"))
    answers = infer(*windows)
    assert answers.probabilities.shape == (28, 6)
    np.testing.assert_allclose(answers.probabilities.sum(axis=1), 1.0)
    assert len(set(answers.intentions)) > 3


def test_a_run_of_version_0_2_0_is_evaluated_as_it_was_then(stored: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The whole way through the command, to the accuracy that version 0.2.0 measured."""
    then = json.loads((stored / FILES[2]).read_text())
    assert cosim.main(["evaluate", "run", "--data", "dataset", "-o", "anew", "--quiet", "--json"]) == 0
    now = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (now["n"], now["accuracy"]) == (then["n"], then["accuracy"])


@pytest.mark.parametrize(
    ("file", "command"),
    [
        (FILES[0], "inspect dataset"),
        (FILES[0], "train dataset -o anew --model trees"),
        (FILES[1], "evaluate run --data dataset -o anew"),
        (FILES[1], "evaluate run --traffic motorway -o anew"),
    ],
)
def test_what_an_older_version_wrote_is_refused(
    file: str, command: str, stored: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (stored / file).read_text()
    (stored / file).write_text(text.replace('"isac-cosim": "0.2.0"', '"isac-cosim": "0.1.0"'))
    assert cosim.main(command.split()) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert f"{file}: was written by version 0.1.0, which is read no longer; make it anew" in line
    assert not (stored / "anew").exists()
