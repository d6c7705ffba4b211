"""What the network held of a scene around the records of an episode: its tracks, and its detections. Sensed again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.report.replay.content import NEAR_M, STEP_S, Detected, TrackPath
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.scene.episode import SceneSensing
from isac_cosim.isacsim.scene.tracks import SceneTracks
from isac_cosim.isacsim.scene.vehicles import instants
from isac_cosim.isacsim.sensing.sensors.scene import setup_of
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.dataset.dataset import Sample
from isac_cosim.labeling.dataset.record_point import in_plane, relative
from isac_cosim.labeling.generation.settings import DatasetStudy


@dataclass(frozen=True)
class SceneView:
    """The tracks near one record, and the detections of all panels there."""

    tracks: list[TrackPath]
    detected: Detected


def scene_views(
    study: DatasetStudy, scenario: Scenario, recording: Recording, stored: Sequence[Sample]
) -> list[SceneView] | None:
    """Sense a scene again, and return what is near each record; None where the network then holds other tracks of it.

    recording: of the episode. stored: its records.
    """
    setup = setup_of(study.sensing, study.motion)
    fixes_hz, rate_hz = setup.scene.fixes_hz, study.record.tv_rate_hz
    sensing = SceneSensing(setup, scenario.sites, recording.lanes, recording.scenario, recording.seed)
    panels, places = Panels.of(scenario.sites, setup.target_height_m), dict[int, Array]()
    for fix, present in instants(recording, fixes_hz, study.motion):
        sensing.step(fix, present)
        found = [of.places(panels, panel) for panel, of in enumerate(sensing.detections) if len(of)]
        places[fix] = np.concatenate([np.empty((0, 2)), *found])
    tracks = sensing.tracks
    if not all(_same(tracks, sample, rate_hz) for sample in stored):
        return None
    return [_view(tracks, places, sample, rate_hz) for sample in stored]


def _same(tracks: SceneTracks, sample: Sample, rate_hz: float) -> bool:
    """Return whether the track that stands for a TV is the stored one, to the bit."""
    followed = tracks.followed(sample.tv_id, sample.t_start + np.arange(sample.tv.shape[1]) / rate_hz)
    return (
        followed is not None
        and str(followed.track) == sample.track_id
        and np.array_equal(relative(followed.state, (sample.x0, sample.y0)), sample.tv)
    )


def _view(tracks: SceneTracks, places: dict[int, Array], sample: Sample, rate_hz: float) -> SceneView:
    fixes_hz, count = tracks.fixes_hz, sample.tv_truth.shape[1]
    every = max(1, round(STEP_S * fixes_hz))
    ends = sample.t_start + np.array([0, count - 1]) / rate_hz
    fixes = np.arange(np.ceil(ends[0] * fixes_hz - 1e-6), ends[1] * fixes_hz + 1e-6, every).astype(np.int64)
    truth, times = in_plane(sample.tv_truth, sample.x0, sample.y0)[:2], np.arange(count) / rate_hz
    target = np.stack([np.interp(fixes / fixes_hz - sample.t_start, times, axis) for axis in truth], axis=1)
    from_s, step_s = float(fixes[0] / fixes_hz - sample.t_start), every / fixes_hz
    near = []
    for fix, middle in zip(fixes.tolist(), target, strict=True):
        found = places.get(fix, np.empty((0, 2)))
        near.append(found[np.hypot(*(found - middle).T) < NEAR_M])
    paths = [
        TrackPath(number, from_s + first * step_s, step_s, path, spread)
        for number, first, path, spread in _paths(tracks, fixes.tolist(), target)
    ]
    return SceneView(paths, Detected(from_s, step_s, near))


def _paths(tracks: SceneTracks, fixes: Sequence[int], target: Array) -> Iterator[tuple[str, int, Array, Array]]:
    """Yield number, first instant, places (2, n) and covariances (3, n) of each stretch of a track near a TV."""
    begun: dict[int, list[tuple[int, Array, Array]]] = {}
    for k, fix in enumerate(fixes):
        instant = tracks.instants.get(fix)
        here: dict[int, list[tuple[int, Array, Array]]] = {}
        if instant is not None:
            close = np.hypot(*(instant.state[:, :2] - target[k]).T) < NEAR_M
            for row in np.flatnonzero(close).tolist():
                number = int(instant.number[row])
                spread = instant.covariance[row][[0, 0, 1], [0, 1, 1]]
                here[number] = [*begun.pop(number, []), (k, instant.state[row, :2], spread)]
        yield from map(_joined, begun.items())
        begun = here
    yield from map(_joined, begun.items())


def _joined(of: tuple[int, list[tuple[int, Array, Array]]]) -> tuple[str, int, Array, Array]:
    number, steps = of
    return str(number), steps[0][0], np.stack([at for _, at, _ in steps], 1), np.stack([sd for _, _, sd in steps], 1)
