"""What an agent observes: the connected vehicles that follow a sensed TV, as the network knows both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array, Float32Array
from isac_cosim.evaluation.closed_loop.mobile_network import Knowledge
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.labeling.samples.uv_choice import PairSettings, connected

FEATURES = ("present", "speed", "distance", "closing", "tv_speed", "tv_acceleration", *(known.text for known in KNOWN))
"""What is observed of each vehicle, in m, m/s and m/s2: whether the slot is taken; its reported speed; the distance to
the front of the TV ahead of it, and how fast it closes; the TV's sensed speed and acceleration along its way; the
probabilities of the TV's intentions, zero without a predictor or answer."""
FASTEST_MPS = 70.0
"""No vehicle on a public road is faster (252 km/h)."""
HARDEST_MPS2 = 10.0
"""No tyre on a dry road brakes or pushes harder, as its friction coefficient is about 1. Sensed accelerations overshoot
it at times, and are observed at the bound then."""
LONGEST_M = 40.0
"""No vehicle on a public road is longer. The range of a pair is a gap; the front of the TV is its length ahead."""


def bounds(slots: int, pairs: PairSettings) -> tuple[Float32Array, Float32Array]:
    """Return the least and the most that is observed, (slots, FEATURES) each. What lies outside is clipped."""
    farthest_m = pairs.range_m + LONGEST_M
    least = [0.0, 0.0, 0.0, -FASTEST_MPS, 0.0, -HARDEST_MPS2, *[0.0] * len(KNOWN)]
    most = [1.0, FASTEST_MPS, farthest_m, FASTEST_MPS, FASTEST_MPS, HARDEST_MPS2, *[1.0] * len(KNOWN)]
    return np.tile(np.array(least, np.float32), (slots, 1)), np.tile(np.array(most, np.float32), (slots, 1))


@dataclass(frozen=True)
class Observation:
    """What an agent observes at an instant. vehicles: in the slots that are taken. features: (slots, FEATURES)."""

    vehicles: tuple[str, ...]
    features: Float32Array

    @classmethod
    def of(cls, knowledge: Knowledge | None, slots: int, pairs: PairSettings) -> Observation:
        """Observe what the network knows; the vehicle that would reach its TV first is in the first slot.

        knowledge: None after the end of an episode; then all slots are free.
        """
        least, most = bounds(slots, pairs)
        features = np.zeros_like(least)
        followers = [] if knowledge is None else _followers(knowledge, pairs)
        rows = sorted(followers, key=lambda row: (_urgency(row[1]), row[0]))[:slots]
        for k, (_, row) in enumerate(rows):
            features[k] = row
        return cls(tuple(vehicle for vehicle, _ in rows), np.clip(features, least, most))


def _followers(knowledge: Knowledge, pairs: PairSettings) -> list[tuple[str, Array]]:
    """Return the connected vehicles that follow a sensed TV, with their features."""
    recording, place = knowledge.surroundings.recording, {tv: k for k, tv in enumerate(knowledge.tv)}
    rows = []
    for vehicle, track in recording.tracks.items():
        leader = knowledge.surroundings.leader(vehicle, knowledge.time_s, pairs.range_m)
        if leader is None or leader.vehicle not in place or vehicle not in knowledge.reported:
            continue
        if connected(recording, track, pairs):
            row = place[leader.vehicle]
            answers = knowledge.answers
            probabilities = np.zeros(len(KNOWN)) if answers is None else answers.probabilities[row]
            state = knowledge.windows[0][row, :, -1]
            rows.append((vehicle, features_of(knowledge.reported[vehicle], state, probabilities)))
    return rows


def features_of(reported: Array, tv: Array, probabilities: Array | Float32Array) -> Array:
    """Return the features of a vehicle. reported: its own state, (6,). tv: of the TV ahead, (6,)."""
    speed, ahead = float(np.hypot(*reported[2:4])), tv[:2] - reported[:2]
    distance = float(np.hypot(*ahead))
    # Noise turns the direction of a vehicle that stands: the TV is ahead of it.
    along = reported[2:4] / speed if speed > 0.1 else ahead / max(distance, 1e-9)
    return np.array(
        [1.0, speed, distance, speed - float(tv[2:4] @ along), float(np.hypot(*tv[2:4])), float(tv[4:6] @ along),
         *np.asarray(probabilities).tolist()]
    )  # fmt: skip


def _urgency(features: Array) -> float:
    """Return the time in which the distance to the TV closes, s; infinite where it does not."""
    distance, closing = features[2], features[3]
    return float(distance / closing) if closing > 0.0 else np.inf
