"""Writes an episode, simulated again, or a record into a new folder for other programs."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.files import new_folder
from isac_cosim.base.workers.engine import Engine
from isac_cosim.base.workers.threads import limited
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.dataset.dataset import Dataset, Shard
from isac_cosim.labeling.dataset.finding import find_episode, find_sample, of_one, shard_of
from isac_cosim.labeling.export.floating_car_data import write_fcd
from isac_cosim.labeling.export.stretch import WHOLE, Span, write_single, write_stretch
from isac_cosim.labeling.export.tables import write_record, write_samples, write_sites, write_vehicles
from isac_cosim.labeling.generation.recorded_again import Recorder

STEP_S = 0.1
"""Time between exported states, unless another one is asked for, s."""
WHY = "the vehicles are only known if the episode is recorded again"
REMEDY = "generate the dataset anew"
Form = Literal["fcd", "csv", "mcap"]


@dataclass(frozen=True)
class Exported:
    """What was written.

    states: of all vehicles of an episode, or instants of a sample. left_out: vehicles that collided or teleported, of
    which nothing is recorded.
    """

    folder: Path
    states: int
    samples: int
    vehicles: int = 0
    left_out: int = 0


def export_episode(
    dataset: Dataset,
    episode: str,
    form: Form,
    out: Path,
    engine: Engine,
    step_s: float = STEP_S,
    feedback: Feedback = SILENT,
    span_s: Span = WHOLE,
) -> Exported:
    """Record an episode again, and write all its vehicles into a new folder.

    form: "fcd" for SUMO, "csv" for tables, "mcap" for Foxglove. step_s: time between states, a multiple of the
    recording's. span_s: first and last instant that "mcap" is to hold, s of simulation time.
    Raises InputError where there is no such episode, where it cannot be recorded as it was, by a single bit, or where
    `out` is not new; OutputError where it cannot be written. Then `out` is as it was.
    """
    shard = find_episode(dataset, episode, with_records=False)
    recorder = Recorder.of(dataset, WHY, REMEDY)
    alone = replace(dataset, path=dataset.path.absolute(), meta=of_one(dataset, shard).meta)
    with new_folder(out) as folder:
        task = partial(_written, recorder, alone, form, folder.absolute(), step_s, span_s)
        with feedback.bar("simulating the episode") as move, closing(engine.run(task, [shard])) as outcomes:
            move(0, 1)
            outcome = next(iter(outcomes))
            move(1, 1)
        if outcome.result is None:
            raise RunError(f"{dataset.path}: {episode} could not be recorded again ({outcome.error})")
    return replace(outcome.result, folder=out)


def export_sample(dataset: Dataset, sample_id: str, out: Path, form: Literal["csv", "mcap"] = "csv") -> Exported:
    """Write a sample into a new folder: its states, and what the dataset says of it.

    form: "csv" for tables, "mcap" for Foxglove. Raises InputError where there is no such sample, or `out` is not new;
    OutputError where it cannot be written.
    """
    shard, row = shard_of(dataset, find_sample(dataset, sample_id))
    alone = of_one(dataset, shard)
    sample = alone.samples(alone.meta.shards[0])[row]
    with new_folder(out) as folder:
        if form == "mcap":
            states = write_single(dataset, sample, folder)
        else:
            states = write_record(sample, (dataset.meta.tv_rate_hz, dataset.meta.uv_rate_hz), folder)
            write_samples(alone, folder, [row])
            write_sites(dataset.sites(sample.scenario), folder)
    return Exported(out, states, 1)


@limited()
def _written(
    recorder: Recorder, alone: Dataset, form: Form, folder: Path, step_s: float, span_s: Span, shard: Shard
) -> Exported:
    """Record the episode of a shard, and write it into a folder; runs in a worker."""
    scenario = recorder.scenario(shard.episode.scenario)
    stored = alone.samples(shard)
    recording = recorder.record(shard.episode.scenario, shard.episode.seed, stored)
    every = _every(recording, step_s)
    samples, vehicles = len(stored), len(recording.tracks)
    if form == "fcd":
        states = write_fcd(recording, scenario, folder, every)
    elif form == "mcap":
        rates_hz = alone.meta.tv_rate_hz, alone.meta.uv_rate_hz
        settings = recorder.study.motion
        states, vehicles, samples = write_stretch(
            recording, scenario, stored, rates_hz, settings, folder, every, span_s
        )
    else:
        states = write_vehicles(recording, folder, every)
        write_samples(alone, folder)
        write_sites(scenario.sites, folder)
    incidents = {*recording.incidents.collided, *recording.incidents.teleported}
    return Exported(folder, states, samples, vehicles, len(incidents))


def _every(recording: Recording, step_s: float) -> int:
    """Return of how many steps one is exported. Raises InputError where a step is no multiple of the recording's."""
    every = round(step_s / recording.step_s)
    if every < 1 or abs(every * recording.step_s - step_s) > 1e-9:
        raise InputError(f"--step {step_s:g}: is no multiple of the recording's step, {recording.step_s:g} s")
    return every
