"""Runs a study without a sweep, from its scenarios to a report.

    OUT/study.json    the study, with all defaults filled in
    OUT/dataset/      the samples
    OUT/run/          the trained predictor
    OUT/floor/        the plain predictor that it is compared with
    OUT/report/       metrics.json, figures, index.html

Each part resumes where it stopped.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.files import claim, write_json
from isac_cosim.base.workers.engine import Engine
from isac_cosim.labeling.dataset.meta import Meta, read_description
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.models.runs.run import RunCard, read_card
from isac_cosim.models.training.progress import Steps, slowdown_now
from isac_cosim.studies.cost_estimate import estimate_study
from isac_cosim.studies.study import Study

if TYPE_CHECKING:
    from isac_cosim.evaluation.on_windows.results import EvaluationResult

STUDY_FILE = "study.json"
RUNS = ("run", "floor")
BUSY = 1.5
"""From this slowdown on it is said that the machine has other work."""


def run_study(study: Study, out: Path, engine: Engine, feedback: Feedback = SILENT) -> EvaluationResult:
    """Generate, train, evaluate and write the report; return the result of the evaluation.

    engine: what runs the episodes. feedback: where progress is reported.
    Raises InputError where the folder holds something else or another study.
    """
    cost = estimate_study(study)
    slowdown = slowdown_now(engine.workers)
    with claim_study(out, study):
        if slowdown > BUSY:
            feedback.message(f"the machine does other work: that makes this take about {slowdown:.1f} times as long")
        steps = Steps(feedback, cost.seconds(engine.workers), slowdown)
        generating_s = cost.generating_s(engine.workers)
        title = f"1 of 3: generating about {cost.samples} samples from {cost.episodes} episodes"
        with steps.step(title, generating_s, _is_complete(read_description(out / "dataset"))):
            dataset = generate(study.dataset, out / "dataset", engine, feedback)

        # Loaded only after the first line has said what will happen, because they take seconds.
        from isac_cosim.evaluation.on_windows.coverage import lacking
        from isac_cosim.evaluation.on_windows.evaluation import evaluate
        from isac_cosim.evaluation.report.report import write_report
        from isac_cosim.models.training.training import train

        for line in lacking(dataset, study.training, study.evaluation):
            feedback.message(f"warning: {line}")
        title = f"2 of 3: training {study.training.model}, and {study.floor.model} to compare it with"
        with steps.step(title, 0.8 * cost.training_s, all(_is_complete(read_card(out / run)) for run in RUNS)):
            trained = train(dataset, out / RUNS[0], study.training, feedback)
            # On the same split, of which the first training has said what there is to say.
            floor = train(dataset, out / RUNS[1], study.floor, feedback, warns=False)
        with steps.step("3 of 3: measuring both, and the report", 0.2 * cost.training_s, False):
            evaluation = evaluate(trained, dataset, out / "report", study.evaluation, against=[floor])
            write_report(evaluation, dataset, out / "report")
    return evaluation.result


def _is_complete(described: Meta | RunCard | None) -> bool:
    """Return whether an earlier command finished a dataset or a run, by what it says of itself."""
    return described is not None and described.complete


@contextmanager
def claim_study(out: Path, study: Study) -> Iterator[None]:
    """Hold a folder for a study, and write the study into it.

    Raises InputError where the folder belongs to another study, or to no study at all.
    """
    content = study.model_dump(mode="json")
    with claim(out, STUDY_FILE, "study's results"):
        if (out / STUDY_FILE).is_file():
            if _stored_content(out / STUDY_FILE) != content:
                raise InputError(f"{out}: holds the results of another study; choose another folder with -o")
        else:
            write_json(out / STUDY_FILE, content)
        yield


def _stored_content(path: Path) -> dict[str, object] | None:
    """Return the study that a file holds, under the current names of its keys, or None where it is damaged."""
    try:
        return Study.model_validate(json.loads(path.read_text(encoding="utf-8"))).model_dump(mode="json")
    except (RecursionError, ValueError):
        return None
