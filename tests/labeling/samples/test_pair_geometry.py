"""The choice of the UV does not give the class away: overtake or left lane change, from the pair alone."""

import numpy as np
import pytest
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import GroupKFold, cross_val_predict

from isacsim.scenarios.scenario import load
from isacsim.traffic.director import ManeuverSettings
from isacsim.traffic.simulation import TrafficSettings, record
from labeling.detectors.settings import LabelSettings
from labeling.events import label
from labeling.intentions import Intention
from labeling.road.surroundings import Surroundings
from labeling.samples.candidates import Candidate, RecordSettings, candidates
from labeling.samples.uv_choice import PairSettings

SEEDS = range(301, 309)
RELATIONS = ("ahead", "behind", "left", "right")


def geometry(surroundings: Surroundings, sample: Candidate, before_s: float) -> list[float]:
    """The pair some time before onset: the relation of the UV, the gap along the road, m, and the distance, m."""
    time = sample.t_onset - before_s
    tv, uv = (surroundings.recording.tracks[v] for v in (sample.tv, sample.uv))
    row, other = (surroundings.step(time) - track.first_step for track in (tv, uv))
    gap = float(surroundings.gaps(sample.tv, sample.uv, np.array([time]))[0])
    distance = float(np.hypot(uv.x[other] - tv.x[row], uv.y[other] - tv.y[row]))
    return [RELATIONS.index(sample.relation), gap, distance]


@pytest.mark.slow
@pytest.mark.parametrize(("fall_back", "limit"), [(False, 0.62), (True, 1.0)])
def test_the_place_of_the_uv_does_not_separate_overtakes_from_left_lane_changes(fall_back: bool, limit: float) -> None:
    """A tree on the pair's geometry 1 s before onset, cross-validated over seeds, stays near chance (AUC 0.5)."""
    rows, labels, groups = [], [], []
    for seed in SEEDS:
        recording = record(load("motorway"), seed, TrafficSettings(), ManeuverSettings())
        surroundings = Surroundings(recording)
        events = label(recording, LabelSettings(), surroundings)
        offered = candidates(recording, events, PairSettings(fall_back=fall_back), RecordSettings(), surroundings)
        for sample in offered.samples:
            if sample.intention in (Intention.OVERTAKE, Intention.LEFT_LANE_CHANGE):
                rows.append(geometry(surroundings, sample, 1.0))
                labels.append(sample.intention is Intention.OVERTAKE)
                groups.append(seed)
    tree = HistGradientBoostingClassifier(max_iter=60, random_state=0)
    folds = GroupKFold(len(SEEDS))
    chance = cross_val_predict(tree, np.array(rows), labels, groups=groups, cv=folds, method="predict_proba")[:, 1]
    auc = roc_auc_score(labels, chance)
    print(f"fall_back {fall_back}: AUC {auc:.3f} of {len(labels)} samples, {sum(labels)} overtakes")
    assert auc < limit
