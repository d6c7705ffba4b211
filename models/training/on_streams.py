"""From a dataset of streams and settings to a run's folder."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np

from isac_cosim.base.arrays import Float32Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.files import claim, replace_file
from isac_cosim.base.seeding import stream
from isac_cosim.base.versions import OF_RUNS, versions
from isac_cosim.base.workers.threads import limited
from isac_cosim.labeling.intentions import KNOWN, Intention, outward
from isac_cosim.labeling.streams.dataset import Streams
from isac_cosim.models.data.split import SplitSettings
from isac_cosim.models.hazards.answers import WITH_HAZARD
from isac_cosim.models.hazards.decisions import StreamSide
from isac_cosim.models.hazards.predictor import HazardPredictor, StreamTask
from isac_cosim.models.hazards.registry import STREAM_PREDICTORS
from isac_cosim.models.runs.run import (
    CARD_FILE,
    REFERENCE_FILE,
    Run,
    RunCard,
    begin_run,
    digests_of,
    files_written,
    load_run,
    write_card,
)
from isac_cosim.models.runs.settings import TrainSettings

REFERENCE_WINDOWS = 1000
"""At most so many decisions before or within events are kept with the run."""


def train_on_streams(streams: Streams, out: str | Path, settings: TrainSettings, feedback: Feedback = SILENT) -> Run:
    """Train a predictor on streams; a finished one is opened.

    out: a new or empty folder, or one of the same training. settings: with a section `streams`.
    Raises InputError if the folder holds something else, the streams are damaged, too short, or of too few seeds, or
    hold too few events.
    """
    assert settings.streams is not None, "a training on streams has settings for it"
    folder = Path(out)
    card = _card(streams, settings)
    with claim(folder, CARD_FILE, "run"):
        if not begin_run(folder, card):
            with limited(settings.optimiser.threads):
                _fill(streams, folder, card, feedback)
    return load_run(folder)


def _fill(streams: Streams, folder: Path, card: RunCard, feedback: Feedback) -> None:
    task = _task(streams, folder, card)
    predictor = STREAM_PREDICTORS[card.settings.model].fit_streams(task, feedback)
    names = files_written(folder, lambda: predictor.save(folder))
    features, label = _reference(predictor, task.training)
    replace_file(folder / REFERENCE_FILE, lambda path: np.savez_compressed(path, features=features, label=label))
    update = {
        **asdict(predictor.fit_summary),
        "complete": True,
        "files": digests_of(folder, names),
        "unknown_score": "max_logit",
    }
    write_card(folder, card.model_copy(update=update))
    for line in _remarks(task):
        feedback.message(line)


def _task(streams: Streams, folder: Path, card: RunCard) -> StreamTask:
    """Return what a predictor is fitted on. Raises InputError if traffic keeps left and right in the same streams."""
    settings, shape = card.settings, card.shape
    of_streams = settings.streams
    assert of_streams is not None
    sides = [
        StreamSide(streams, frozenset(card.split[side]), of_streams, shape, settings.windows, settings.seed)
        for side in ("train", "validation")
    ]
    lefthand = {sides[0].lane_maps(scenario.name).lefthand for scenario in streams.meta.scenarios}
    if len(lefthand) > 1:
        raise InputError(
            f"{streams.path}: traffic keeps left in some scenarios and right in others; train on one kind at a time"
        )
    return StreamTask(sides[0], sides[1], of_streams, settings, shape, outward(lefthand.pop()), folder)


def _card(streams: Streams, settings: TrainSettings) -> RunCard:
    """Return the card of a training that is about to begin. Raises InputError if the streams do not allow it."""
    assert settings.streams is not None
    kind = STREAM_PREDICTORS[settings.model]
    if kind.needs_lanes and not settings.streams.lanes:
        raise InputError(f"model {settings.model}: sees the lanes alone; leave out --no-lanes, or choose another model")
    record, window_s = streams.meta.study["record"], settings.windows.window_s
    rates = record["tv_rate_hz"], record["uv_rate_hz"]
    longest_s = streams.meta.settings.window_s
    if window_s > longest_s + 1e-9:
        raise InputError(
            f"windows.window_s {window_s:g}: the streams hold windows of {longest_s:g} s; shorten it, or generate them "
            "with longer ones"
        )
    facts = {f"{of.scenario}-{of.seed}": of for of in streams.facts()}
    sides = _split(sorted(facts), settings.split)
    counts = {
        side: {
            known.text: sum(
                event.intention == known.text and event.left_out is None
                for name in sides[side]
                for event in facts[name].events
            )
            for known in KNOWN
        }
        for side in ("train", "validation")
    }
    return RunCard(
        complete=False, settings=settings, classes=tuple(known.text for known in KNOWN), split=sides,
        counts=counts["train"], validation_counts=counts["validation"],
        tv_length=round(window_s * rates[0]), uv_length=round(window_s * rates[1]),
        tv_rate_hz=rates[0], uv_rate_hz=rates[1],
        dataset={"digest": streams.digest, "study": streams.meta.study}, versions=versions(OF_RUNS),
    )  # fmt: skip


def _split(episodes: list[str], settings: SplitSettings) -> dict[str, list[str]]:
    """Split episodes into those to train on and those to calibrate on. Live evaluations test on seeds of their own."""
    if len(episodes) < 2:
        raise InputError(
            f"the streams have {len(episodes)} episode(s): training and validation need one each; add seeds"
        )
    drawn = stream("split of streams", settings.seed).permutation(episodes).tolist()
    count = min(max(1, round(settings.validation * len(drawn))), len(drawn) - 1)
    training = drawn[count:]
    used = max(1, round(settings.training_share * len(training)))
    sides = {"train": sorted(training[:used]), "validation": sorted(drawn[:count]), "test": []}
    return sides | ({"unused": sorted(training[used:])} if used < len(training) else {})


def _reference(predictor: HazardPredictor, side: StreamSide) -> tuple[Float32Array, IntArray]:
    """Return the features and the intention of decisions before or within events, (n, F) and (n,)."""
    features, label, horizons = list[Float32Array](), list[IntArray](), len(side.settings.horizons_s)
    number = np.array([intention.value for intention in WITH_HAZARD])
    for batch in side.batches():
        positive = batch.targets.positive(horizons)
        if positive.any():
            features.append(predictor(batch.windows).finite(side.streams.path).features[positive].astype(np.float32))
            interval = np.where(batch.targets.interval < 0, horizons, batch.targets.interval)
            label.append(number[interval[positive].argmin(axis=1)])
        if sum(map(len, label)) >= REFERENCE_WINDOWS:
            break
    return np.concatenate(features)[:REFERENCE_WINDOWS], np.concatenate(label)[:REFERENCE_WINDOWS]


def _remarks(task: StreamTask) -> list[str]:
    """Return what is not learned, a line."""
    events, least = task.training.events(), task.settings.least_events
    few = [f"{known.text} {events[known]}" for known in WITH_HAZARD if events[known] < least]
    if events[Intention.OVERTAKE] < least:
        few.append(f"overtake {events[Intention.OVERTAKE]}")
    return [f"too few events to learn from: {', '.join(few)}; {least} are needed"] if few else []
