"""The main job: a study from its scenarios to a report.

    OUT/study.json    the study, all defaults filled in
    OUT/dataset/      the samples
    OUT/run/          the trained predictor
    OUT/floor/        the plain predictor it is compared with
    OUT/report/       metrics.json, figures, index.html

Every part resumes where it stopped.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console

from isacsim.errors import InputError
from labeling.dataset.dataset import Dataset
from models.evaluation.evaluation import evaluate
from models.report.report import write_report
from models.run import holds_other, replace
from models.studies.study import Study
from models.training.training import train

STUDY_FILE = "study.json"

Generate = Callable[[Path], Dataset]
"""Makes the study's dataset in the folder given."""


def run_study(study: Study, out: Path, generate: Generate, console: Console) -> dict[str, Any]:
    """Generate, train, evaluate and report; returns what `metrics.json` of the report holds.

    generate: makes the dataset; the command line puts a progress bar around it. console: where training draws its own.
    Raises InputError where the folder holds something else or another study.
    """
    claim(out, study)
    dataset = generate(out / "dataset")
    trained = train(dataset, out / "run", study.training, console)
    floor = train(dataset, out / "floor", study.floor, console)
    found = evaluate(trained, dataset, out / "report", study.evaluation, against=[floor])
    write_report(trained, dataset, out / "report")
    return found


def claim(out: Path, study: Study) -> None:
    """Make the folder this study's. Raises InputError where it is another's, or no study's."""
    written = study.model_dump(mode="json")
    mark = out / STUDY_FILE
    if mark.is_file():
        try:
            before = json.loads(mark.read_text())
        except (RecursionError, ValueError):
            before = None
        if before != written:
            raise InputError(f"{out}: holds the results of another study; choose another folder with -o")
        return
    if holds_other(out, STUDY_FILE):
        raise InputError(f"{out}: holds something that is no study's results; choose a new folder with -o")
    out.mkdir(parents=True, exist_ok=True)
    replace(mark, lambda path: path.write_text(json.dumps(written, indent=1) + "\n"))
