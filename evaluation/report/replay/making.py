"""Makes a replay of an episode of a dataset: its records, what is around them, and what a predictor answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.workers.engine import Engine
from isac_cosim.evaluation.on_windows.explained import is_explainable
from isac_cosim.evaluation.on_windows.predictions import check_rates
from isac_cosim.evaluation.report.replay.content import RATE_HZ, AnswersAlong, Maneuver, Moving, Replay, at_rate
from isac_cosim.evaluation.report.replay.inside import REMARK, inside_of
from isac_cosim.evaluation.report.replay.others import Around, around
from isac_cosim.evaluation.report.replay.scene import SceneView
from isac_cosim.isacsim.sensing.sensors import SCENE
from isac_cosim.labeling.dataset.dataset import Dataset, Sample, Shard, read_description
from isac_cosim.labeling.dataset.finding import find_episode, of_one
from isac_cosim.labeling.dataset.record_point import in_plane
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.data.windows import Ends, Records, cut, end_bounds, fitting
from isac_cosim.models.runs.run import Run, load_run, read_card

ROAD_REACH_M = 300.0
"""Lanes are on the page as far as this from the records, m."""
MOST_RECORDS = 1_000
"""Records on one page."""
MOST_BYTES = 6_500_000
"""Of the other vehicles and of scenes on one page, which then stays below 15 MB, with the library of its curves."""
ALONE = "TV and UV only: "
"""How the sentence begins that says why no other vehicle is shown."""
SCENE_SHOWN = (
    "A scene: an ellipse with a number is a track of the network, 95 % of where it holds a vehicle to be; the crosses "
    "are the detections of all panels at that time."
)
OTHER_TRACKS = "Tracks are not shown: the network holds others when the scene is sensed again with this version."
SIDES = {
    "train": "The predictor was trained on this episode: how well it answers here says nothing of unseen traffic.",
    "validation": "The predictor was chosen on this episode: how well it answers here says little of unseen traffic.",
    "unused": "The predictor's seeds include this episode, which was left unused: nothing was fitted to it.",
    "test": "The predictor was neither trained nor chosen on this episode.",
}


def replay_of(
    dataset: Dataset, shard: Shard, engine: Engine, run: Run | None = None, feedback: Feedback = SILENT
) -> Replay:
    """Return the replay of an episode, all its records in their order.

    engine: simulates the episode again, for the vehicles that the dataset does not hold. run: whose answers are shown.
    Raises InputError where the dataset is damaged, or the run made for other rates.
    """
    alone, rates = of_one(dataset, shard), dataset.meta
    records = Records.of(alone)
    if run is not None:
        check_rates(run, records)
    samples = dataset.samples(shard)[:MOST_RECORDS]
    whole, reason = around(dataset, shard, engine, feedback)
    found, views = (None, None) if whole is None else whole
    remarks = [] if found is not None else [f"{ALONE}{reason}."]
    if found is not None and samples[0].sensor == SCENE:
        remarks.append(SCENE_SHOWN if views is not None else OTHER_TRACKS)
    if found is not None and (full := _full_after(found, views)) < len(samples):
        found[full:] = [replace(beside, others=[]) for beside in found[full:]]
        views = None if views is None else views[:full]
        remarks.append(f"From record {full + 1} on, TV and UV only: the page would grow beyond 15 MB.")
    if len(samples) < shard.samples:
        remarks.append(f"These are the first {len(samples)} of the episode's {shard.samples} records.")
    moving = [
        _moving(
            sample,
            (rates.tv_rate_hz, rates.uv_rate_hz),
            None if found is None else found[row],
            None if views is None or row >= len(views) else views[row],
            None if run is None else _answers(run, records, row),
        )
        for row, sample in enumerate(samples)
    ]
    name = shard.file.removesuffix(".parquet")
    if run is not None:
        remarks += [SIDES[side] for side, groups in run.card.split.items() if name in groups][:1]
        if is_explainable(run):
            remarks.append(REMARK)
        if run.card.settings.held_out is not None:
            remarks.append(f"It never saw {run.card.settings.held_out.replace('_', ' ')}.")
    scenario = shard.episode.scenario
    return Replay(
        title=f"Episode {name}" if run is None else f"{run.name} in episode {name}",
        records=moving,
        lanes=lanes_near(dataset.roads(scenario), moving),
        sites=[(site.id, site.x, site.y, site.azimuth_deg) for site in dataset.sites(scenario)],
        classes=() if run is None else run.card.classes,
        remarks=remarks,
    )


def replay_of_test(folder: Path, run: Path, engine: Engine, feedback: Feedback = SILENT) -> Replay | None:
    """Return the replay of the first test episode of a predictor that has records, with the predictor's answers.

    folder: of the dataset. run: of the predictor. engine: as for `replay_of`. None where one of them is not finished;
    also None, with a warning, where the episode cannot be shown.
    """
    meta, card = read_description(folder), read_card(run)
    if meta is None or card is None or not (meta.complete and card.complete):
        return None
    try:
        dataset = Dataset.open(folder)
        shards = [find_episode(dataset, name, with_records=False) for name in card.split["test"]]
        shown = next((shard for shard in shards if shard.samples), None)
        return None if shown is None else replay_of(dataset, shown, engine, load_run(run), feedback)
    except (InputError, RunError) as error:
        feedback.message(f"warning: the page shows no episode in motion: {error}")
        return None


def _full_after(found: Sequence[Around], views: Sequence[SceneView] | None) -> int:
    """Return after how many records the vehicles around them, and what a scene holds there, fill a page."""
    sizes = np.array([sum(3 * vehicle.places.size + 150 for vehicle in beside.others) for beside in found])
    for row, view in enumerate(views or ()):
        numbers = sum(track.places.size + track.spread.size for track in view.tracks)
        numbers += sum(places.size for places in view.detected.places)
        sizes[row] += 3 * numbers + 150 * len(view.tracks) + 4 * len(view.detected.places)
    return int(np.searchsorted(np.cumsum(sizes), MOST_BYTES, side="right"))


def _moving(
    sample: Sample,
    rates_hz: tuple[float, float],
    beside: Around | None,
    view: SceneView | None,
    answers: AnswersAlong | None,
) -> Moving:
    """Return one record as it is replayed. rates_hz: of the TV's and of the UV's states."""
    columns = (sample.tv_truth, rates_hz[0]), (sample.tv, rates_hz[0]), (sample.uv, rates_hz[1])
    truth, sensed, uv = (at_rate(in_plane(states, sample.x0, sample.y0), rate_hz) for states, rate_hz in columns)
    intention = sample.intention.text
    moving = Moving(
        id=sample.sample_id,
        intention=intention,
        origin=sample.origin,
        tv_id=sample.tv_id,
        uv_id=sample.uv_id,
        start_s=sample.t_start,
        maneuvers=[Maneuver(intention, sample.t_onset - sample.t_start, sample.t_commit - sample.t_start)],
        truth=truth,
        sensed=sensed,
        uv=uv,
        answers=answers,
        tracks=() if view is None else view.tracks,
        detected=None if view is None else view.detected,
    )
    return moving if beside is None else replace(moving, sizes=beside.sizes, others=beside.others)


def _answers(run: Run, records: Records, row: int) -> AnswersAlong:
    """Return what a predictor answers on every window of a record that ends on the replay's grid."""
    windows, rate_hz = run.card.settings.windows, records.uv_rate_hz
    first, last = fitting(records, windows)
    every = max(1, round(rate_hz / RATE_HZ))
    steps = np.arange(first, last + 1, every)
    measured_first, measured_last = (int(bound[row]) for bound in end_bounds(records, windows))
    measured = measured_last >= measured_first
    asked = np.append(steps, measured_last if measured else last)
    probabilities = run.answer(cut(records, Ends(np.full(len(asked), row), asked), windows)).probabilities
    label = int(records.label[row])
    predicted = run.card.classes[int(probabilities[-1].argmax())] if measured else None
    trained = label in KNOWN and run.card.classes[label] != run.card.settings.held_out
    return AnswersAlong(
        from_s=first / rate_hz,
        step_s=every / rate_hz,
        probabilities=probabilities[:-1],
        predicted=predicted,
        wrong=predicted != run.card.classes[label] if measured and trained else None,
        inside=inside_of(run, records, Ends(np.full(len(steps), row), steps)),
    )


class AnyLane(Protocol):
    """A lane of a dataset or of a scenario. shape: centre line, m, (n, 2)."""

    @property
    def width_m(self) -> float: ...

    @property
    def shape(self) -> Array: ...


def lanes_near(lanes: Sequence[AnyLane], moving: Sequence[Moving]) -> list[tuple[float, Array]]:
    """Return width and line of the lanes that come near the records."""
    paths = np.concatenate([path for record in moving for path in (record.truth, record.uv)], axis=1)
    low, high = paths.min(axis=1) - ROAD_REACH_M, paths.max(axis=1) + ROAD_REACH_M
    return [
        (lane.width_m, lane.shape)
        for lane in lanes
        if (lane.shape.max(axis=0) >= low).all() and (lane.shape.min(axis=0) <= high).all()
    ]
