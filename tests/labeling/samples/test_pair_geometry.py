"""The choice of the UV does not give the class away: overtakes and hard accelerations, from the pair alone."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import GroupKFold, cross_val_predict

from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.samples.candidates import Candidate, RecordSettings, candidates
from isac_cosim.labeling.samples.uv_choice import PairSettings

SEEDS = range(301, 309)
LARGEST_ACCEL_AUC = 0.65
RELATIONS = ("ahead", "behind", "left", "right")


def geometry(surroundings: Surroundings, sample: Candidate, before_s: float) -> list[float]:
    """The pair some time before onset: the relation of the UV, the gap along the road, m, and the distance, m."""
    time = sample.t_onset - before_s
    tv, uv = (surroundings.recording.tracks[v] for v in (sample.tv, sample.uv))
    row, other = (surroundings.step(time) - track.first_step for track in (tv, uv))
    gap = float(surroundings.gaps(sample.tv, sample.uv, np.array([time]))[0])
    distance = float(np.hypot(uv.x[other] - tv.x[row], uv.y[other] - tv.y[row]))
    return [RELATIONS.index(sample.relation), gap, distance]


@dataclass(frozen=True)
class Rows:
    """Samples of several episodes: their intentions, the pair's geometry 1 s before onset, and their seeds."""

    intentions: list[Intention] = field(default_factory=list)
    geometry: list[list[float]] = field(default_factory=list)
    seeds: list[int] = field(default_factory=list)

    def auc(self, intention: Intention, *others: Intention) -> float:
        """Return how well trees tell an intention from others by the geometry, cross-validated over seeds."""
        kept = [k for k, known in enumerate(self.intentions) if known in (intention, *others)]
        is_it = [self.intentions[k] is intention for k in kept]
        chance = cross_val_predict(
            HistGradientBoostingClassifier(max_iter=60, random_state=0),
            np.array([self.geometry[k] for k in kept]), is_it,
            groups=[self.seeds[k] for k in kept], cv=GroupKFold(len(SEEDS)), method="predict_proba",
        )[:, 1]  # fmt: skip
        auc = float(roc_auc_score(is_it, chance))
        print(f"{intention.text}: AUC {auc:.3f} of {len(kept)} samples, {sum(is_it)} of it")
        return auc


@pytest.fixture(scope="module")
def rows() -> dict[bool, Rows]:
    """The samples of eight episodes, by whether a UV may be any vehicle near by."""
    rows = {False: Rows(), True: Rows()}
    for seed in SEEDS:
        recording = record(load("motorway"), seed, TrafficSettings(), ManeuverSettings())
        surroundings = Surroundings(recording)
        events = label(recording, LabelSettings(), surroundings)
        for fall_back, kept in rows.items():
            offered = candidates(recording, events, PairSettings(fall_back=fall_back), RecordSettings(), surroundings)
            for sample in offered.samples:
                kept.intentions.append(sample.intention)
                kept.geometry.append(geometry(surroundings, sample, 1.0))
                kept.seeds.append(seed)
    return rows


@pytest.mark.slow
@pytest.mark.parametrize(("fall_back", "limit"), [(False, 0.62), (True, 1.0)])
def test_the_place_of_the_uv_does_not_separate_overtakes_from_left_lane_changes(
    rows: dict[bool, Rows], fall_back: bool, limit: float
) -> None:
    """Trees on the pair's geometry 1 s before onset stay near chance (AUC 0.5)."""
    assert rows[fall_back].auc(Intention.OVERTAKE, Intention.LEFT_LANE_CHANGE) < limit


@pytest.mark.slow
def test_the_place_of_the_uv_hardly_gives_hard_accelerations_away(rows: dict[bool, Rows]) -> None:
    """Who accelerates hard needs room ahead, so some of it shows; the intention itself must not."""
    others = [intention for intention in KNOWN if intention is not Intention.HARD_ACCEL]
    assert rows[False].auc(Intention.HARD_ACCEL, *others) < LARGEST_ACCEL_AUC
