"""How well intentions that a predictor was never trained on are told from those it was, each held out in turn.

Run: python -m benchmarks.held_out DATASET OUT [--model trees] [--epochs N] [--seed S]
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from rich.console import Console

from command_line.progress import ConsoleFeedback
from isacsim.feedback import SILENT, Feedback
from isacsim.settings import checked
from labeling.dataset.dataset import Dataset
from models.data.windows import Records
from models.predictors.castformer import PAPER_OPTIMISER
from models.run import TrainSettings
from models.studies.held_out import hold_out_each, table


def run(dataset: Path, out: Path, settings: TrainSettings, feedback: Feedback = SILENT) -> dict[str, Any]:
    """`models.studies.held_out.hold_out_each` on a dataset."""
    opened = Dataset.open(dataset)
    made_of = {"digest": opened.digest, "study": opened.meta.study}
    return hold_out_each(Records.of(opened), made_of, out, settings, feedback=feedback)


def main() -> None:
    """Read the arguments, train and evaluate, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--model", default="trees")
    parser.add_argument("--epochs", type=int)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    optimiser = PAPER_OPTIMISER if given.model == "castformer" else {}
    optimiser = optimiser if given.epochs is None else optimiser | {"epochs": given.epochs}
    said = {"model": given.model, "seed": given.seed, "optimiser": optimiser}
    console = Console(stderr=True)
    found = run(given.dataset, given.out, checked(TrainSettings, said, "arguments"), ConsoleFeedback(console))
    Console(width=180).print(table(found))


if __name__ == "__main__":
    main()
