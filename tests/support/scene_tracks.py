"""What a network knows of the vehicles of a recording, made up instead of sensed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from isac_cosim.isacsim.scene.scores import SceneScores
from isac_cosim.isacsim.scene.tracks import SceneTracks, TrackedInstant
from isac_cosim.isacsim.traffic import motion
from isac_cosim.isacsim.traffic.recordings.recording import Recording

OFF_M = 0.05
COUNTS = ("instants", "vehicle_fixes", "track_fixes", "matched_fixes")
SCORES = dict.fromkeys(COUNTS, 1) | {"rms_m": OFF_M, "idf1": 0.99, "gospa_parts_m2": (0.0, 0.0, 0.0)}


def tracks_of(recording: Recording, hz: float) -> SceneTracks:
    """A network that knows everybody from 1 s on, to 5 cm; the vehicles are on the road throughout."""
    known = SceneTracks(hz, scores=SceneScores.model_validate(SCORES))
    names = tuple(recording.tracks)
    for fix in range(round(hz), round(recording.lasts_s * hz) - 1):
        at = np.array([fix / hz])
        driven = [motion.states(recording, track, at, motion.MotionSettings()) for track in recording.tracks.values()]
        state, number, whole = np.stack(driven)[:, :, 0], np.arange(1, len(names) + 1), np.full(len(names), 4)
        state[:, 1] += OFF_M
        covariance = np.tile(OFF_M**2 * np.eye(2), (len(names), 1, 1))
        known.instants[fix] = TrackedInstant(number, state, covariance, whole, whole, whole * 3.0, names)
    return known


def altered(
    tracks: SceneTracks, from_s: float, to_s: float, number: Mapping[str, int | None], after: Mapping[str, int | None]
) -> SceneTracks:
    """The tracks with other numbers for those of some vehicles, or without them: over a span of time, s, and after."""
    instants = {}
    for fix, instant in tracks.instants.items():
        time_s = fix / tracks.fixes_hz
        named = number if from_s <= time_s < to_s else after if time_s >= to_s else {}
        numbers = [named.get(str(of), own) for of, own in zip(instant.vehicle, instant.number.tolist(), strict=True)]
        rows = sorted((new, row) for row, new in enumerate(numbers) if new is not None)
        kept = [row for _, row in rows]
        arrays = {name: getattr(instant, name)[kept] for name in ("state", "covariance", "looked", "found", "snr_db")}
        vehicles = tuple(instant.vehicle[row] for row in kept)
        instants[fix] = TrackedInstant(np.array([new for new, _ in rows], np.int64), vehicle=vehicles, **arrays)
    return SceneTracks(tracks.fixes_hz, instants, tracks.scores)
