"""Two vehicles for a minute, with known events, for scoring by hand."""

from __future__ import annotations

import numpy as np

from isac_cosim.evaluation.in_traffic.alarms.alarms import Alarms, Levels
from isac_cosim.evaluation.in_traffic.settings import ScoringSettings
from isac_cosim.evaluation.in_traffic.streams.predictions import Answers
from isac_cosim.evaluation.in_traffic.streams.store import RUN, EpisodeFacts, LiveEpisode
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.labeling.streams.events import GROUPS, LiveEvent

SETTINGS = ScoringSettings()
COUNT = 600
"""Predictions of each vehicle: one minute."""


def episode(seed: int, *events: LiveEvent) -> LiveEpisode:
    """One minute of two vehicles, a and b; b is under command in the second half."""
    facts = EpisodeFacts(
        fingerprint="", scenario="toy", seed=seed, decision_s=0.1, simulated_s=60.0, vehicles=2, instants=2 * COUNT,
        uncovered={}, covered_km=3.0, events=events,
    )  # fmt: skip
    time_s = np.tile(np.round(np.arange(COUNT) * 0.1, 9), 2)
    vehicle = np.repeat(np.arange(2), COUNT)
    rng = np.random.default_rng(seed)
    group = np.where((vehicle == 1) & (time_s >= 30), GROUPS.index("commanded"), 0)
    probabilities = rng.dirichlet(np.ones(len(KNOWN)), 2 * COUNT).astype(np.float32)
    answers = Answers(probabilities, probabilities.max(axis=1), rng.random((2 * COUNT, 3)).astype(np.float32))
    return LiveEpisode(facts, ("a", "b"), vehicle, time_s, group, {RUN: answers})


def event(vehicle: str, intention: str, onset: float, group: str = "natural", left_out: str | None = None) -> LiveEvent:
    return LiveEvent.model_validate(
        {"vehicle": vehicle, "intention": intention, "onset": onset, "commit": onset + 1, "end": onset + 3,
         "group": group, "left_out": left_out}
    )  # fmt: skip


def alarms(*rows: tuple[int, int, float]) -> Alarms:
    """Alarms as (vehicle, intention, time)."""
    vehicle, intention = (np.array([row[k] for row in rows], np.int64) for k in (0, 1))
    time_s = np.array([row[2] for row in rows], np.float64)
    return Alarms(intention, vehicle * COUNT + np.rint(time_s * 10).astype(np.int64), vehicle, time_s)


FIRST = episode(1, event("a", "hard_brake", 10), event("b", "left_lane_change", 40, "commanded"))
SECOND = episode(
    2, event("a", "hard_brake", 20), event("a", "hard_brake", 40), event("b", "hard_brake", 5, left_out="jump")
)


def levels(of: LiveEpisode, spikes: dict[tuple[int, int, float], float]) -> Levels:
    """Levels that are 0 but for spikes at (vehicle, intention, time)."""
    level = np.zeros((len(of.time_s), len(KNOWN)), np.float32)
    for (vehicle, intention, time), value in spikes.items():
        level[vehicle * COUNT + round(time * 10), intention] = value
    return Levels.of(of, level)
