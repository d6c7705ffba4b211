"""Whether two recordings of the same traffic have the same events and the same motion."""

from dataclasses import dataclass

import numpy as np

from isac_cosim.isacsim.traffic import motion
from isac_cosim.isacsim.traffic.motion import MotionSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.detectors.events import Labels
from isac_cosim.labeling.intentions import Event

WITHIN_S = 0.05


@dataclass(frozen=True)
class Match:
    """Events of the first recording, how many of them the second has, and how many it has besides, by intention."""

    events: dict[str, int]
    matched: dict[str, int]
    surplus: dict[str, int]


def match_events(labels: Labels, others: Labels) -> Match:
    """Match events of the same vehicle and intention whose onset and commit are within `WITHIN_S`."""
    left: dict[tuple[str, str], list[Event]] = {}
    for event in others.events:
        left.setdefault((event.vehicle, event.intention.text), []).append(event)
    match = Match({}, {}, {})
    for event in labels.events:
        kind = event.intention.text
        match.events[kind] = match.events.get(kind, 0) + 1
        candidates = left.get((event.vehicle, kind), [])
        for other in candidates:
            if abs(other.onset - event.onset) <= WITHIN_S and abs(other.commit - event.commit) <= WITHIN_S:
                match.matched[kind] = match.matched.get(kind, 0) + 1
                candidates.remove(other)
                break
    for (_, kind), events in left.items():
        if events:
            match.surplus[kind] = match.surplus.get(kind, 0) + len(events)
    return match


AROUND_STAY_S = 5.0
"""SUMO moves a vehicle that parks aside at once. How that is rounded hangs on fractions of a millimetre, so the time
around a stay beside the road does not count, s."""


def conditioned_rms(recording: Recording, other: Recording, every: int = 7) -> tuple[float, float, float]:
    """Return the rms difference of conditioned positions, m, velocities, m/s, and accelerations, m/s2."""
    squares, count = np.zeros(3), 0
    for name, track in recording.tracks.items():
        times = recording.times(track)[100:-100:every]
        for first, after in recording.parked.get(name, ()):
            begin, end = first * recording.step_s - AROUND_STAY_S, after * recording.step_s + AROUND_STAY_S
            times = times[(times < begin) | (times > end)]
        if len(times):
            a, b = (motion.states(r, r.tracks[name], times, MotionSettings()) for r in (recording, other))
            squares += ((a - b) ** 2).reshape(3, -1).sum(axis=1)
            count += 2 * len(times)
    x, v, a = np.sqrt(squares / count).tolist()
    return x, v, a
