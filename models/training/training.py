"""One training loop: a dataset and settings to a run's folder, resumable after any epoch."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import lightning
import numpy as np
import numpy.typing as npt
import skops.io
import torch
from lightning.pytorch.callbacks import Callback, EarlyStopping, ModelCheckpoint
from threadpoolctl import threadpool_limits

from isacsim.errors import InputError
from isacsim.feedback import SILENT, Feedback
from isacsim.files import claim, replace_file
from isacsim.versions import OF_RUNS, versions
from labeling.intentions import KNOWN, Intention
from models.data.windows import Records, batches, cut, draw_ends, lengths, split
from models.predictors.floors import fit_trees, statistics
from models.predictors.losses import inverse_frequency
from models.predictors.minirocket import fit_rocket, rocket_kind, write_rocket
from models.predictors.reject_option import fit_preludes, holds_preludes, prelude_windows
from models.predictors.rule import Drive, drive, fitted
from models.run import (
    CARD_FILE,
    CHECKPOINTS,
    HISTORY_FILE,
    PRELUDES_FILE,
    REFERENCE_FILE,
    ROCKET_FILE,
    RULE_FILE,
    TREES_FILE,
    WEIGHTS_FILE,
    NetworkPredictor,
    Outputs,
    Predictor,
    RocketPredictor,
    RulePredictor,
    Run,
    RunCard,
    TrainSettings,
    TreesPredictor,
    build_network,
    load_run,
    open_run,
    read_card,
    write_card,
)
from models.scores import open_set
from models.scores.calibration import fit_temperature
from models.training.checkpoints import Checkpoints, read_tensors, write_tensors
from models.training.lightning_module import MONITOR, History, Lesson, WindowData, torch_seed
from models.training.progress import EpochProgress

if TYPE_CHECKING:
    from labeling.dataset.dataset import Dataset

REFERENCE_WINDOWS = 4000


def train(dataset: Dataset, out: str | Path, settings: TrainSettings, feedback: Feedback = SILENT) -> Run:
    """Train a predictor on a dataset's known intentions, or go on with the same training where it stopped.

    out: a new or empty folder, or one of the same training. feedback: where progress is reported.
    InputError where the folder holds something else, the dataset has too few seeds, or no window fits.
    """
    made_of = {"digest": dataset.digest, "study": dataset.meta.study}
    return train_records(Records.of(dataset), made_of, out, settings, feedback)


def train_records(
    records: Records,
    made_of: dict[str, Any],
    out: str | Path,
    settings: TrainSettings,
    feedback: Feedback = SILENT,
    sides: dict[str, list[str]] | None = None,
) -> Run:
    """`train` on records in memory; made_of: what the run's card says of the dataset, `digest` among it.

    sides: the scenario seeds to train, validate and test on, as `split` gives them, where they are settled already.
    """
    if settings.model == "minirocket":
        rocket_kind()
    folder = Path(out)
    card = _card(records, made_of, settings, sides or split(records, settings.split))
    with claim(folder, CARD_FILE, "run"):
        if not _begin(folder, card):
            with _threads(settings.optimiser.threads):
                _fill(records, folder, card, feedback)
    return load_run(folder)


def _fill(records: Records, folder: Path, card: RunCard, feedback: Feedback) -> None:
    """Train what a claimed folder is for, and put it there."""
    settings = card.settings
    known = records.take(_taught(records, settings))
    training = known.take(np.isin(known.groups, card.split["train"]))
    validation = known.take(np.isin(known.groups, card.split["validation"]))
    if settings.model in ("trees", "ensemble"):
        _train_trees(training, folder, card)
    if settings.model == "rule":
        _train_rule(training, folder, card)
    elif settings.model == "minirocket":
        _train_rocket(training, folder, card)
    elif settings.model != "trees":
        card = _train_network(training, validation, folder, card, feedback)
    _learn_preludes(training, folder, card)
    card = card.model_copy(update={"complete": True})
    write_card(folder, card.model_copy(update=_choose_on_validation(records, folder, card)))


def _taught(records: Records, settings: TrainSettings) -> npt.NDArray[np.bool_]:
    """Which records are of an intention that is trained."""
    return np.asarray(np.isin(records.label, [i for i in KNOWN if i is not settings.left_out]))


def _choose_on_validation(records: Records, folder: Path, card: RunCard) -> dict[str, Any]:
    """For the card: the score that tells `following` apart best on the validation seeds, its threshold, temperature."""
    run = open_run(folder, card)
    offered = _taught(records, card.settings) | (records.label == Intention.FOLLOWING)
    validation = records.take(offered & np.isin(records.groups, card.split["validation"]))
    windows = card.settings.windows
    ends = draw_ends(validation, windows, "validation", card.settings.seed, per_record=card.settings.validation_ends)
    parts = [run.predictor(w) for w in batches(validation, ends, windows, 64)]
    outputs = Outputs(np.concatenate([p.logits for p in parts]), np.concatenate([p.features for p in parts]))
    known = np.isin(validation.label[ends.row], KNOWN)
    value = {name: score(outputs) for name, score in open_set.of_run(run).items()}
    areas = {name: open_set.auroc(v[known], v[~known]) for name, v in value.items()}
    found = {name: area for name, area in areas.items() if area is not None}
    best = max(found, key=lambda name: found[name], default=open_set.PLAIN)
    threshold = open_set.threshold_at_recall(value[best][known]) if known.any() else None
    temperature = fit_temperature(outputs.logits[known], validation.label[ends.row][known])
    return {
        "unknown_score": best, "unknown_threshold": threshold, "validation_auroc": found, "temperature": temperature,
    }  # fmt: skip


def _card(records: Records, made_of: dict[str, Any], settings: TrainSettings, sides: dict[str, list[str]]) -> RunCard:
    n_tv, n_uv = lengths(records, settings.windows)
    side = np.isin(records.groups, sides["train"])
    label = records.label[side & (_taught(records, settings) | (records.label == Intention.FOLLOWING))]
    if len(np.intersect1d(label, KNOWN)) < 2:
        raise InputError("the dataset's training seeds hold fewer than two known intentions: generate more seeds")
    return RunCard(
        complete=False, settings=settings, classes=tuple(i.text for i in KNOWN), split=sides,
        counts={i.text: int((label == i).sum()) for i in KNOWN}, tv_length=n_tv, uv_length=n_uv,
        tv_rate_hz=records.tv_rate_hz, uv_rate_hz=records.uv_rate_hz, dataset=made_of, versions=versions(OF_RUNS),
    )  # fmt: skip


def _begin(folder: Path, card: RunCard) -> bool:
    """Make a held folder this training's. Returns whether it is finished; InputError where it is another's."""
    before = read_card(folder)
    if before is None:
        write_card(folder, card)
        return False
    if (before.settings, before.dataset.get("digest"), before.split) != (
        card.settings,
        card.dataset.get("digest"),
        card.split,
    ):
        raise InputError(f"{folder}: holds a run of other settings or another dataset; choose a new folder")
    return before.complete


def _train_rule(training: Records, folder: Path, card: RunCard) -> None:
    settings, rule = card.settings, card.settings.rule
    if rule.fit:
        ends = draw_ends(training, settings.windows, "train", settings.seed, 0, per_record=settings.ends_per_record)
        seen = Drive.joined([drive(w, rule.smooth_s) for w in batches(training, ends, settings.windows, 256)])
        rule = fitted(seen, training.label[ends.row], rule)
    replace_file(folder / RULE_FILE, lambda path: path.write_text(rule.model_dump_json(indent=1) + "\n"))
    _write_reference(training, RulePredictor(rule), folder, card)


def _train_rocket(training: Records, folder: Path, card: RunCard) -> None:
    settings, chosen = card.settings, card.settings.minirocket
    ends = draw_ends(training, settings.windows, "train", settings.seed, 0, per_record=chosen.ends_per_record)
    windows = cut(training, ends, settings.windows)
    rocket = fit_rocket(windows, training.label[ends.row], chosen, settings.seed)
    replace_file(folder / ROCKET_FILE, lambda path: write_rocket(rocket, path))
    _write_reference(training, RocketPredictor(rocket), folder, card)


def _train_trees(training: Records, folder: Path, card: RunCard) -> None:
    settings = card.settings
    ends = draw_ends(training, settings.windows, "train", settings.seed, 0, per_record=settings.trees.ends_per_record)
    features = np.concatenate([statistics(w) for w in batches(training, ends, settings.windows, 256)])
    label = training.label[ends.row]
    trees = fit_trees(features, label, settings.trees, settings.seed)
    replace_file(folder / TREES_FILE, lambda path: skops.io.dump(trees, path))
    _write_reference(training, TreesPredictor(trees), folder, card)


def _learn_preludes(training: Records, folder: Path, card: RunCard) -> None:
    """The reject option, where it is wanted and the records reach far enough back."""
    settings = card.settings
    wanted, windows = settings.preludes, settings.windows
    if not wanted.use or not holds_preludes(training, windows, wanted):
        return
    predictor, features = open_run(folder, card).predictor, []
    for purpose, seen in (("maneuvers", windows), ("preludes", prelude_windows(windows, wanted))):
        ends = draw_ends(training, seen, purpose, settings.seed, per_record=wanted.ends_per_record)
        parts = [predictor(w).features for w in batches(training, ends, seen, 64)]
        features.append(np.concatenate(parts).astype(np.float32))
    trees = fit_preludes(features[0], features[1], wanted, settings.seed)
    replace_file(folder / PRELUDES_FILE, lambda path: skops.io.dump(trees, path))


def _train_network(training: Records, validation: Records, folder: Path, card: RunCard, feedback: Feedback) -> RunCard:
    torch.manual_seed(torch_seed("weights", card.settings.seed))
    network = build_network(card)
    data = WindowData(training, validation, card.settings)
    network.fit_scale(*data.first_windows())
    alpha = inverse_frequency(training.label, len(card.classes)) if card.settings.loss.class_weights else None
    best = _fit(Lesson(network, card.settings, alpha), data, folder, card, feedback)
    network.load_state_dict(
        {k.removeprefix("network."): v for k, v in best["state_dict"].items() if k.startswith("network.")}
    )
    write_tensors(folder / WEIGHTS_FILE, {name: value.clone() for name, value in network.state_dict().items()})
    _write_reference(training, NetworkPredictor(network.eval()), folder, card)
    score = float(next(v for k, v in best["callbacks"].items() if k.startswith("ModelCheckpoint"))["current_score"])
    return card.model_copy(
        update={"best_epoch": int(best["epoch"]), MONITOR: score, "parameters": network.parameter_count}
    )


def _fit(lesson: Lesson, data: WindowData, folder: Path, card: RunCard, feedback: Feedback) -> dict[str, Any]:
    """Train to the end; returns the checkpoint of the best epoch."""
    optimiser, checkpoints = card.settings.optimiser, folder / CHECKPOINTS
    keeper = ModelCheckpoint(
        checkpoints,
        "best",
        monitor=MONITOR,
        mode="max",
        save_last=True,
        enable_version_counter=False,
        save_on_train_epoch_end=True,
    )
    callbacks: list[Callback] = [
        History(folder / HISTORY_FILE),
        EarlyStopping(MONITOR, mode="max", patience=optimiser.patience),
        keeper,
        EpochProgress(feedback, card.settings.model, MONITOR),
    ]
    last = checkpoints / "last.ckpt"
    with _quiet():
        trainer = lightning.Trainer(
            accelerator="cpu", max_epochs=optimiser.epochs, callbacks=callbacks,
            gradient_clip_val=optimiser.clip_norm or None, logger=False,
            num_sanity_val_steps=0, enable_progress_bar=False, enable_model_summary=False, default_root_dir=folder,
            plugins=[Checkpoints()],
        )  # fmt: skip
        try:
            trainer.fit(lesson, datamodule=data, ckpt_path=last if last.exists() else None, weights_only=True)
        except SystemExit:
            # Lightning turns Ctrl-C into an exit of its own.
            raise KeyboardInterrupt from None
    return read_tensors(Path(keeper.best_model_path))


def _write_reference(training: Records, predictor: Predictor, folder: Path, card: RunCard) -> None:
    """Features of one window of each training record, of at most REFERENCE_WINDOWS."""
    ends = draw_ends(training, card.settings.windows, "reference", card.settings.seed)[:REFERENCE_WINDOWS]
    features = np.concatenate([predictor(w).features for w in batches(training, ends, card.settings.windows, 64)])
    label = training.label[ends.row]
    replace_file(
        folder / REFERENCE_FILE,
        lambda path: np.savez_compressed(path, features=features.astype(np.float32), label=label),
    )


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """What numerical libraries may use inside it."""
    before = torch.get_num_threads()
    try:
        with threadpool_limits(count):
            torch.set_num_threads(count)
            yield
    finally:
        # Last: a library that is given its own number back may set torch's, whose OpenMP it has found loaded.
        torch.set_num_threads(before)


@contextmanager
def _quiet() -> Iterator[None]:
    """Lightning's hints (devices, workers, data loaders) mean nothing to someone who trains here."""
    loggers = [logging.getLogger(name) for name in ("lightning.pytorch", "lightning.fabric", "lightning")]
    levels = [each.level for each in loggers]
    try:
        for each in loggers:
            each.setLevel(logging.ERROR)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module=r"lightning.*|torch\..*")
            yield
    finally:
        for each, level in zip(loggers, levels, strict=True):
            each.setLevel(level)
