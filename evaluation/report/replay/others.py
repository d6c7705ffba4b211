"""The other vehicles around the records of an episode. They are not in a dataset: the episode is simulated again."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.workers.engine import Engine
from isac_cosim.base.workers.threads import limited
from isac_cosim.evaluation.report.replay.content import LENGTH_M, NEAR_M, STEP_S, WIDTH_M, VehicleNear
from isac_cosim.evaluation.report.replay.scene import SceneView, scene_views
from isac_cosim.isacsim.sensing.sensors import SCENE
from isac_cosim.isacsim.traffic import motion
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.labeling.dataset.dataset import Dataset, Sample, Shard
from isac_cosim.labeling.dataset.finding import of_one
from isac_cosim.labeling.dataset.record_point import in_plane
from isac_cosim.labeling.generation.recorded_again import Recorder

WHY = "the other vehicles are only known if the episode is recorded again"
REMEDY = "generate the dataset anew"
Size = tuple[float, float]


@dataclass(frozen=True)
class Around:
    """What is around one record: the sizes of its TV and UV, m, and the other vehicles."""

    sizes: tuple[Size, Size]
    others: list[VehicleNear]


Whole = tuple[list[Around], list[SceneView] | None]
"""What is around each record of an episode, and what a scene holds there, if the episode is one."""


def around(dataset: Dataset, shard: Shard, engine: Engine, feedback: Feedback) -> tuple[Whole | None, str]:
    """Simulate the episode of a shard again, and return what is around each of its records, in their order.

    Where that cannot be done, or where the TV of a record then drives otherwise than it is stored, by a single bit:
    None, and the reason in a sentence without the dataset's path.
    """
    try:
        recorder = Recorder.of(dataset, WHY, REMEDY)
        alone = replace(dataset, path=dataset.path.absolute(), meta=of_one(dataset, shard).meta)
        task = partial(_recorded, recorder, alone)
        with feedback.bar("simulating the episode") as move, closing(engine.run(task, [shard])) as outcomes:
            move(0, 1)
            outcome = next(iter(outcomes))
            move(1, 1)
    except InputError as error:
        return None, str(error).removeprefix(f"{dataset.path}: ")
    if outcome.result is None:
        return None, f"{WHY}, and that failed ({outcome.error})"
    return outcome.result, ""


@limited()
def _recorded(recorder: Recorder, alone: Dataset, shard: Shard) -> Whole:
    """Record the episode of a shard, and sense it where it is a scene; runs in a worker."""
    stored, scenario = alone.samples(shard), shard.episode.scenario
    recording = recorder.record(scenario, shard.episode.seed, stored)
    beside = [_around(recording, sample, alone.meta.tv_rate_hz, recorder.study.motion) for sample in stored]
    if not any(sample.sensor == SCENE for sample in stored):
        return beside, None
    return beside, scene_views(recorder.study, recorder.scenario(scenario), recording, stored)


def _around(recording: Recording, sample: Sample, rate_hz: float, settings: motion.MotionSettings) -> Around:
    """Return what is around a record."""
    truth = in_plane(sample.tv_truth, sample.x0, sample.y0)[:2]
    times = sample.t_start + np.arange(truth.shape[1]) / rate_hz
    return around_path(recording, (sample.tv_id, sample.uv_id), times, truth, settings)


def around_path(
    recording: Recording, ids: tuple[str, str], times: Array, path: Array, settings: motion.MotionSettings
) -> Around:
    """Return what is around a TV on its path, m, (2, n). ids: of the TV and the UV. times: s, (n,)."""
    step_s = recording.step_s
    every = max(1, round(STEP_S / step_s))
    steps = np.arange(round(times[0] / step_s), round(times[-1] / step_s) + 1, every)
    target = np.stack([np.interp(steps * step_s, times, axis) for axis in path])
    others = []
    for track in recording.tracks.values():
        inside = (steps >= track.first_step) & (steps < track.first_step + len(track))
        if track.vehicle in ids or inside.sum() < 2:
            continue
        rows = steps[inside] - track.first_step
        if np.hypot(track.x[rows] - target[0, inside], track.y[rows] - target[1, inside]).min() > NEAR_M:
            continue
        places = motion.positions(recording, track, steps[inside], settings)
        from_s = float(steps[inside][0] * step_s - times[0])
        others.append(
            VehicleNear(track.vehicle, track.kind, track.length_m, track.width_m, from_s, every * step_s, places)
        )
    sizes = [_size(recording.tracks.get(vehicle)) for vehicle in ids]
    return Around((sizes[0], sizes[1]), others)


def _size(track: Track | None) -> Size:
    return (LENGTH_M, WIDTH_M) if track is None else (round(track.length_m, 2), round(track.width_m, 2))
