"""Reactions and commands look like what SUMO's drivers do by themselves: trees hardly tell them apart."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import pytest
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import GroupKFold, cross_val_predict

from isacsim.scenarios.scenario import load
from isacsim.traffic.director import ManeuverSettings
from isacsim.traffic.recording import Recording
from isacsim.traffic.simulation import TrafficSettings, record
from labeling.detectors.settings import LabelSettings
from labeling.events import label, provenance
from labeling.intentions import Event, Intention
from labeling.road.lane_graph import LaneGraph
from labeling.road.road_motion import RoadMotion, road_motion

SEEDS = range(401, 407)
AFTER_S = 2.2
LEAST = 15
"""Events of each origin without which an intention is not asked about."""
ASKED = {
    Intention.HARD_BRAKE: 0.70,
    Intention.LEFT_LANE_CHANGE: 0.70,
    Intention.RIGHT_LANE_CHANGE: 0.70,
    Intention.OVERTAKE: 0.70,
}


def features(motion: RoadMotion, event: Event) -> list[float] | None:
    """True motion from onset to 2.2 s after it, every 0.2 s, relative to onset; None where the track ends before."""
    times = event.onset + np.arange(0.0, AFTER_S + 0.01, 0.2)
    if times[0] < motion.times[0] or times[-1] > motion.times[-1]:
        return None
    v, a, q, vq, aq = (np.interp(times, motion.times, getattr(motion, name)) for name in ("v", "a", "q", "vq", "aq"))
    return [v[0], *(v - v[0]), *a, *(q - q[0]), *vq, *aq]


def collected() -> dict[tuple[Intention, str], tuple[list[list[float]], list[int]]]:
    """Features and seeds of all events, by intention and origin."""
    rows: dict[tuple[Intention, str], tuple[list[list[float]], list[int]]] = defaultdict(lambda: ([], []))
    for seed in SEEDS:
        recording: Recording = record(load("motorway"), seed, TrafficSettings(), ManeuverSettings())
        graph = LaneGraph(recording.lanes)
        motions: dict[str, RoadMotion] = {}
        for event in label(recording, LabelSettings()).events:
            if event.intention is Intention.FOLLOWING:
                continue
            if event.vehicle not in motions:
                motions[event.vehicle] = road_motion(recording, recording.tracks[event.vehicle], graph, 0.15)
            described = features(motions[event.vehicle], event)
            if described is not None:
                kept, seeds = rows[event.intention, provenance(recording, event).origin]
                kept.append(described)
                seeds.append(seed)
    return rows


@pytest.mark.slow
def test_trees_hardly_tell_origins_apart_and_shares_are_as_wanted() -> None:
    """AUC over seeds of natural against other events; shares of natural events, and of reactions."""
    rows = collected()

    def count(intention: Intention, *origins: str) -> int:
        return sum(len(rows[intention, origin][0]) for origin in origins if (intention, origin) in rows)

    print()
    for intention in Intention:
        natural, reaction, commanded = (count(intention, name) for name in ("natural", "reaction", "commanded"))
        print(f"{intention.text}: {natural} natural, {reaction} reactions, {commanded} commanded")
    aucs = {}
    for intention in ASKED:
        for other in ("reaction", "commanded"):
            if min(count(intention, "natural"), count(intention, other)) < LEAST:
                continue
            (own, own_seeds), (others, other_seeds) = rows[intention, "natural"], rows[intention, other]
            truth = np.repeat([0, 1], [len(own), len(others)])
            tree = HistGradientBoostingClassifier(max_iter=80, random_state=0)
            chance = cross_val_predict(
                tree, np.array(own + others), truth, groups=own_seeds + other_seeds,
                cv=GroupKFold(min(len(SEEDS), len(set(own_seeds + other_seeds)))), method="predict_proba",
            )[:, 1]  # fmt: skip
            aucs[intention, other] = float(roc_auc_score(truth, chance))
            print(f"{intention.text}, natural against {other}: AUC {aucs[intention, other]:.2f}")
    for intention in (Intention.EVASIVE_SWERVE, Intention.HARD_ACCEL):
        assert count(intention, "reaction") >= 0.8 * count(intention, "natural", "reaction", "commanded")
    for intention in ASKED:
        assert count(intention, "natural") >= 0.2 * count(intention, "natural", "reaction", "commanded")
    assert {pair: auc for pair, auc in aucs.items() if auc > ASKED[pair[0]]} == {}
