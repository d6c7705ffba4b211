"""How well a predictor recognises intentions that it was not trained on: each known one is held out in turn.

Run: python -m isac_cosim.benchmarks.findings.held_out DATASET OUT [--model trees] [--epochs N] [--seed S]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console

from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.progress import ConsoleFeedback
from isac_cosim.base.settings import checked
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.models import FLOOR
from isac_cosim.models.data.windows import Records
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.studies.held_out import HeldOutResult, hold_out_each, table


def run(dataset: Path, out: Path, settings: TrainSettings, feedback: Feedback = SILENT) -> HeldOutResult:
    """Run `studies.held_out.hold_out_each` on a dataset, and return its result."""
    opened = Dataset.open(dataset)
    made_of = {"digest": opened.digest, "study": opened.meta.study}
    return hold_out_each(Records.of(opened), made_of, out, settings, feedback=feedback)


def main() -> None:
    """Read the arguments, train and evaluate, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--model", default=FLOOR)
    parser.add_argument("--epochs", type=int)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    optimiser = {} if arguments.epochs is None else {"epochs": arguments.epochs}
    content = {"model": arguments.model, "seed": arguments.seed, "optimiser": optimiser}
    feedback = ConsoleFeedback(Console(stderr=True))
    result = run(arguments.dataset, arguments.out, checked(TrainSettings, content, "arguments"), feedback)
    Console(width=180).print(table(result))


if __name__ == "__main__":
    main()
