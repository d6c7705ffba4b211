"""From a dataset and settings to a run's folder; an interrupted training resumes where it stopped."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isac_cosim.base.arrays import Float32Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import SILENT, Feedback, Foreword
from isac_cosim.base.files import claim, replace_file
from isac_cosim.base.versions import OF_RUNS, versions
from isac_cosim.base.workers.threads import limited
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.models.data.sides import dependence_of_test, is_taught, on_side, taught, warning
from isac_cosim.models.data.split import split
from isac_cosim.models.data.windows import Records, batches, draw_ends, lengths
from isac_cosim.models.predictors.protocol import FitTask, Outputs, Predictor
from isac_cosim.models.predictors.reject_option import fit_reject_option
from isac_cosim.models.runs.run import (
    CARD_FILE,
    REFERENCE_FILE,
    REJECT_OPTION_FILE,
    Run,
    RunCard,
    begin_run,
    digests_of,
    files_written,
    load_run,
    open_run,
    write_card,
)
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.scores import open_set
from isac_cosim.models.scores.calibration import fit_temperature
from isac_cosim.models.trees.stored_trees import write_trees

if TYPE_CHECKING:
    from isac_cosim.labeling.dataset.dataset import Dataset

REFERENCE_WINDOWS = 4000
"""At most so many training windows are kept as a reference for the unknown scores."""
BATCH = 64
"""Windows that a predictor answers at a time."""


def train(
    dataset: Dataset,
    out: str | Path,
    settings: TrainSettings,
    feedback: Feedback = SILENT,
    warns: bool = True,
    logs: bool = False,
) -> Run:
    """Train a predictor on the known intentions of a dataset, or resume the same training where it stopped.

    out: a new or empty folder, or one of the same training. feedback: where progress is reported. warns: whether test
    samples that depend on those trained on are told; to measure them, the whole dataset is read. logs: whether the
    curves of a network are also written for TensorBoard.
    Raises InputError if the folder holds something else, the dataset has too few seeds, or no window fits.
    """
    made_of = {"digest": dataset.digest, "study": dataset.meta.study}
    records = Records.of(dataset)
    sides = split(records, settings.split)
    line = warning(dependence_of_test(dataset, records, sides, settings.split)) if warns else None
    foreword = Foreword(feedback, [line] if line else [])
    run = train_records(records, made_of, out, settings, foreword, sides, logs)
    foreword.say()
    return run


def train_records(
    records: Records,
    made_of: dict[str, Any],
    out: str | Path,
    settings: TrainSettings,
    feedback: Feedback = SILENT,
    sides: dict[str, list[str]] | None = None,
    logs: bool = False,
) -> Run:
    """Do what `train` does, on records in memory.

    made_of: what the run's card says of the dataset; `digest` is part of it. sides: the scenario seeds to train,
    validate and test on, as `split` returns them, if they are already decided. logs: see `train`.
    """
    settings.predictor_class.check_requirements()
    folder = Path(out)
    card = _card(records, made_of, settings, sides or split(records, settings.split))
    with claim(folder, CARD_FILE, "run"):
        if not begin_run(folder, card):
            with limited(settings.optimiser.threads):
                _fill(records, folder, card, feedback, logs)
    return load_run(folder)


def _fill(records: Records, folder: Path, card: RunCard, feedback: Feedback, logs: bool) -> None:
    """Train the predictor of a claimed folder, and write everything that belongs to the run."""
    training, validation = (taught(records, card.split, side, card.settings) for side in ("train", "validation"))
    task = FitTask(training, validation, card.settings, card.shape, folder, logs)
    predictor = card.settings.predictor_class.fit(task, feedback)
    names = files_written(folder, lambda: predictor.save(folder))
    _write_reference(folder, _reference(predictor, task))
    reject_option = fit_reject_option(predictor, task)
    if reject_option is not None:
        write_trees(folder / REJECT_OPTION_FILE, reject_option)
    files = digests_of(folder, names)
    card = card.model_copy(update={"complete": True, "files": files, **asdict(predictor.fit_summary)})
    write_card(folder, card.model_copy(update=_choose_on_validation(records, open_run(folder, card))))


def run_in_memory(
    predictor: Predictor, records: Records, made_of: dict[str, Any], settings: TrainSettings, folder: Path
) -> Run:
    """Return the run of a predictor that is fitted already, without a file: what `train_records` adds to a predictor.

    That is the split of the records, the features of training windows, the reject option, and what is chosen on the
    validation seeds. folder: names the run in messages. Raises InputError if the records are too few to split.
    """
    card = _card(records, made_of, settings, split(records, settings.split))
    training, validation = (taught(records, card.split, side, settings) for side in ("train", "validation"))
    task = FitTask(training, validation, settings, card.shape, folder)
    with limited(settings.optimiser.threads):
        # It stays incomplete: it has no files.
        card = card.model_copy(update=asdict(predictor.fit_summary))
        run = Run(folder, card, predictor, _reference(predictor, task), fit_reject_option(predictor, task))
        return replace(run, card=card.model_copy(update=_choose_on_validation(records, run)))


def _choose_on_validation(records: Records, run: Run) -> dict[str, Any]:
    """Return what the card says of the choices made on the validation seeds.

    These are the score that best separates `following` from the known intentions, its threshold, and the temperature.
    """
    card = run.card
    offered = is_taught(records, card.settings) | (records.label == Intention.FOLLOWING)
    validation = records.take(offered & on_side(records, card.split, "validation", card.settings.split))
    windows = card.settings.windows
    ends = draw_ends(validation, windows, "validation", card.settings.seed, per_record=card.settings.validation_ends)
    parts = [run.answer(batch) for batch in batches(validation, ends, windows, BATCH)]
    outputs = Outputs(np.concatenate([p.logits for p in parts]), np.concatenate([p.features for p in parts]))
    known = np.isin(validation.label[ends.row], KNOWN)
    values = {name: score(outputs) for name, score in open_set.of_run(run).items()}
    areas = {name: open_set.auroc(value[known], value[~known]) for name, value in values.items()}
    measured = {name: area for name, area in areas.items() if area is not None}
    best = max(measured, key=lambda name: measured[name], default=open_set.PLAIN)
    threshold = open_set.threshold_at_recall(values[best][known]) if known.any() else None
    temperature = fit_temperature(outputs.logits[known], validation.label[ends.row][known])
    return {
        "unknown_score": best,
        "unknown_threshold": threshold,
        "validation_auroc": measured,
        "temperature": temperature,
    }


def _card(records: Records, made_of: dict[str, Any], settings: TrainSettings, sides: dict[str, list[str]]) -> RunCard:
    """Return the card of a training that is about to begin. Raises InputError if there is too little to train on."""
    n_tv, n_uv = lengths(records, settings.windows)
    side = on_side(records, sides, "train", settings.split)
    label = records.label[side & (is_taught(records, settings) | (records.label == Intention.FOLLOWING))]
    validated = records.label[np.isin(records.groups, sides["validation"]) & is_taught(records, settings)]
    if len(np.intersect1d(label, KNOWN)) < 2:
        shared = " of vehicles that no other side has" if settings.split.by == "vehicle" else ""
        raise InputError(
            f"the dataset's training seeds hold fewer than two known intentions{shared}: generate more seeds"
        )
    return RunCard(
        complete=False, settings=settings, classes=tuple(i.text for i in KNOWN), split=sides,
        counts={i.text: int((label == i).sum()) for i in KNOWN},
        validation_counts={i.text: int((validated == i).sum()) for i in KNOWN}, tv_length=n_tv, uv_length=n_uv,
        tv_rate_hz=records.tv_rate_hz, uv_rate_hz=records.uv_rate_hz, dataset=made_of, versions=versions(OF_RUNS),
    )  # fmt: skip


def _reference(predictor: Predictor, task: FitTask) -> tuple[Float32Array, IntArray]:
    """Return features and label of a window of each training record, of at most REFERENCE_WINDOWS."""
    ends = draw_ends(task.training, task.settings.windows, "reference", task.settings.seed)[:REFERENCE_WINDOWS]
    features = np.concatenate([predictor(batch).finite(task.folder).features for batch in task.batches(ends, BATCH)])
    return features.astype(np.float32), task.training.label[ends.row]


def _write_reference(folder: Path, reference: tuple[Float32Array, IntArray]) -> None:
    features, label = reference
    replace_file(folder / REFERENCE_FILE, lambda path: np.savez_compressed(path, features=features, label=label))
