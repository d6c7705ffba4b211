"""Reactions and commands look like what SUMO's drivers do by themselves: trees hardly tell them apart."""

from __future__ import annotations

from collections import defaultdict
from statistics import fmean

import numpy as np
import pytest
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import GroupKFold, cross_val_predict

from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.detectors.events import label, provenance
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import KNOWN, Event, Intention
from isac_cosim.labeling.road.lane_graph import LaneGraph
from isac_cosim.labeling.road.road_motion import RoadMotion, road_motion

SETS = (range(401, 407), range(407, 413), range(413, 419))
"""Seeds of three sets of episodes. The aim is for the trees of one set; those that learn from all of them find more."""
SEEDS = range(SETS[0].start, SETS[-1].stop)
AFTER_S = 2.2
FOLDS = 6
LEAST = 15
"""Events of each origin that an AUC needs."""
LARGEST_AUC = 0.70
NOT_REACHED = pytest.mark.xfail(strict=True, reason="the figures reached are in docs/traffic.md")
Rows = dict[tuple[Intention, str], tuple[list[list[float]], list[int]]]
"""Features and seeds of all events, by intention and origin."""


def features(motion: RoadMotion, event: Event) -> list[float] | None:
    """True motion from onset to 2.2 s after it, every 0.2 s, relative to onset; None where the track ends before."""
    times = event.onset + np.arange(0.0, AFTER_S + 0.01, 0.2)
    if times[0] < motion.times[0] or times[-1] > motion.times[-1]:
        return None
    v, a, q, vq, aq = (np.interp(times, motion.times, getattr(motion, name)) for name in ("v", "a", "q", "vq", "aq"))
    return [v[0], *(v - v[0]), *a, *(q - q[0]), *vq, *aq]


@pytest.fixture(scope="module")
def rows() -> Rows:
    rows: Rows = defaultdict(lambda: ([], []))
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
    return dict(rows)


def count(rows: Rows, intention: Intention, *origins: str) -> int:
    return sum(len(rows[intention, origin][0]) for origin in origins if (intention, origin) in rows)


@pytest.mark.slow
def test_shares_of_origins_are_as_wanted(rows: Rows) -> None:
    """Who swerves or accelerates hard has a cause; of the other intentions, a fifth at least are natural.

    Of the hard brakes, it is a tenth: drivers who stop comfortably where nothing surprises them seldom brake hard.
    """
    print()
    for intention in KNOWN:
        numbers = {origin: count(rows, intention, origin) for origin in ("natural", "reaction", "commanded")}
        print(f"{intention.text}: {numbers} in {len(SEEDS)} episodes")
        if intention in (Intention.EVASIVE_SWERVE, Intention.HARD_ACCEL):
            assert numbers["reaction"] >= 0.8 * sum(numbers.values())
        else:
            least = 0.1 if intention is Intention.HARD_BRAKE else 0.2
            assert numbers["natural"] >= least * sum(numbers.values())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("intention", "other"),
    [
        pytest.param(Intention.HARD_BRAKE, "reaction", marks=NOT_REACHED),
        (Intention.HARD_BRAKE, "commanded"),
        pytest.param(Intention.LEFT_LANE_CHANGE, "reaction", marks=NOT_REACHED),
        pytest.param(Intention.LEFT_LANE_CHANGE, "commanded", marks=NOT_REACHED),
        pytest.param(Intention.RIGHT_LANE_CHANGE, "reaction", marks=NOT_REACHED),
        (Intention.RIGHT_LANE_CHANGE, "commanded"),
    ],
)
def test_trees_hardly_tell_natural_events_from_others(rows: Rows, intention: Intention, other: str) -> None:
    """AUC over seeds, on the true states after onset: the sets' mean. Natural overtakes are too few."""
    auc = fmean(area_under_curve(rows, intention, other, seeds) for seeds in SETS)
    of_all = area_under_curve(rows, intention, other, SEEDS)
    print(f"\n{intention.text}, natural against {other}: AUC {auc:.2f}, of all {len(SEEDS)} episodes {of_all:.2f}")
    assert auc <= LARGEST_AUC


def area_under_curve(rows: Rows, intention: Intention, other: str, seeds: range) -> float:
    """How well trees that never saw an event's episode tell natural events from others, in six folds of episodes."""
    (natural, natural_seeds), (others, other_seeds) = rows[intention, "natural"], rows[intention, other]
    groups = np.array(natural_seeds + other_seeds)
    inside = np.isin(groups, seeds)
    described = np.array(natural + others)[inside]
    truth = np.repeat([0, 1], [len(natural), len(others)])[inside]
    assert np.bincount(truth).min() >= LEAST
    chance = cross_val_predict(
        HistGradientBoostingClassifier(max_iter=80, random_state=0), described, truth,
        groups=groups[inside], cv=GroupKFold(FOLDS), method="predict_proba",
    )[:, 1]  # fmt: skip
    return float(roc_auc_score(truth, chance))
