"""The same bytes on one core and on two, whatever `OMP_NUM_THREADS` says."""

from __future__ import annotations

import functools
import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from isac_cosim.evaluation.in_traffic.alarms.background import KeptTrees
from isac_cosim.evaluation.in_traffic.settings import BackgroundSettings
from isac_cosim.evaluation.on_windows.evaluation import evaluate
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.models.runs.run import load_run
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.training import train
from tests.support.made_up_dataset import write_dataset

QUICK = {"windows": {"window_s": 1.2}, "pre_onset": {"rounds": 3}, "optimiser": {"epochs": 1}, "trees": {"rounds": 3}}
VARIABLE = "OMP_NUM_THREADS"


def work(folder: Path, out: Path) -> None:
    """What a test process does: train trees, evaluate a network, and keep trees as an evaluation in traffic does."""
    dataset = Dataset.open(folder / "data")
    trees = train(dataset, out / "trees", TrainSettings.model_validate({**QUICK, "model": "trees"}))
    evaluate(load_run(folder / "network"), dataset, out / "evaluation")
    features, label = trees.reference
    KeptTrees(out / "kept").trained(features, label, label + 1.0, BackgroundSettings(rounds=3))


def digests(out: Path) -> dict[str, str]:
    return {
        str(path.relative_to(out)): hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(out.rglob("*.*"))
    }


@pytest.mark.slow
@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="needs two cores")
def test_the_same_bytes_whatever_the_cores(tmp_path: Path) -> None:
    """Of a network with attention, whose sums a second thread splits, and of trees, which noted their threads."""
    dataset = write_dataset(tmp_path / "data", seeds=3, per_class=1)
    train(dataset, tmp_path / "network", TrainSettings.model_validate({**QUICK, "model": "castformer"}))
    two = sorted(os.sched_getaffinity(0))[:2]
    results = []
    for number, (cores, threads) in enumerate(((two[:1], None), (two, None), (two, "1"))):
        environment = {name: value for name, value in os.environ.items() if name != VARIABLE}
        environment |= {} if threads is None else {VARIABLE: threads}
        out = tmp_path / f"out-{number}"
        words = [sys.executable, "-m", __name__, str(tmp_path), str(out)]
        # Before the process begins: libraries count the cores when they are imported.
        confined = functools.partial(os.sched_setaffinity, 0, cores)
        subprocess.run(words, env=environment, check=True, cwd=Path(__file__).parents[2], preexec_fn=confined)
        results.append(digests(out))
    assert {"evaluation/predictions.parquet", "trees/trees.skops", "trees/pre_onset.skops"} <= results[0].keys()
    assert any(name.startswith("kept/") for name in results[0])
    assert results == results[:1] * 3


if __name__ == "__main__":
    work(Path(sys.argv[1]), Path(sys.argv[2]))
