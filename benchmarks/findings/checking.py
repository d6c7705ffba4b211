"""What it costs to check what is read: the share of `train` and of `evaluate` that digests and checks of content take.

    python -m isac_cosim.benchmarks.findings.checking DATASET [--model trees]

trains a predictor on a dataset and evaluates it as the commands do, in a temporary folder. Times are of the processor,
with what it takes to start.
"""

from __future__ import annotations

import argparse
import pkgutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

from isac_cosim.base.files import json_text
from isac_cosim.evaluation.on_windows.evaluation import evaluate
from isac_cosim.evaluation.report.report import write_report
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.models.runs.run import load_run
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.training import train

CHECKS = (
    "isac_cosim.base.files._digest_of",
    "isac_cosim.base.settings._check_seal",
    "isac_cosim.labeling.dataset.dataset.check_rows",
    "isac_cosim.labeling.dataset.dataset.Dataset._check_numbers",
    "isac_cosim.base.stored.arrays.check_archive",
    "isac_cosim.base.stored.arrays._check_claim",
    "isac_cosim.models.networks.checkpoints.check_archive",
    "isac_cosim.models.networks.checkpoints._check_weights",
    "isac_cosim.models.trees.stored_trees.check_archive",
    "isac_cosim.models.trees.stored_trees._types_in",
    "isac_cosim.models.trees.stored_trees._node_faults",
)
"""The functions that check, none of which calls another one of them."""


def main() -> None:
    """Read the arguments, measure, and print the shares."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--model", default="trees")
    arguments = parser.parse_args()
    print(json_text(measured(arguments.dataset, arguments.model), 1))


def measured(dataset: Path, model: str) -> dict[str, Any]:
    """Return the processor times of training and evaluation, s, and the shares of the checks."""
    start_s = time.process_time()
    with tempfile.TemporaryDirectory() as name:
        run, out = Path(name) / "run", Path(name) / "out"

        def evaluation() -> None:
            opened = Dataset.open(dataset)
            write_report(evaluate(load_run(run), opened, out), opened, out)

        settings = TrainSettings.model_validate({"model": model})
        trained = _timed(lambda: train(Dataset.open(dataset), run, settings), start_s)
        evaluated = _timed(evaluation, start_s)
    return {"samples": len(Dataset.open(dataset)), "model": model, "train": trained, "evaluate": evaluated}


def _timed(work: Callable[[], object], start_s: float) -> dict[str, float]:
    """Return what some work takes with its start, s, and what of it the checks take."""
    spent: list[float] = []
    began = time.process_time()
    with ExitStack() as stack:
        for name in CHECKS:
            stack.enter_context(_counted(name, spent))
        work()
    whole_s = start_s + time.process_time() - began
    return {"seconds": round(whole_s, 2), "checks_s": round(sum(spent), 3), "share": round(sum(spent) / whole_s, 4)}


@contextmanager
def _counted(name: str, spent: list[float]) -> Iterator[None]:
    """Add the processor time of each call of a function to a list; not of those that it makes to itself."""
    running = False
    plain = pkgutil.resolve_name(name)

    def counted(*arguments: Any, **options: Any) -> Any:
        nonlocal running
        if running:
            return plain(*arguments, **options)
        running, began = True, time.process_time()
        try:
            result = plain(*arguments, **options)
            return list(result) if isinstance(result, Iterator) else result
        finally:
            running = False
            spent.append(time.process_time() - began)

    with mock.patch(name, counted):
        yield


if __name__ == "__main__":
    main()
