"""How well the network knows who is where: errors, what is missed, false and mixed up, over an episode.

At every instant, tracks are assigned to vehicles so that the sum of min(distance, c)^2 is least, c = 2 m. This is the
assignment of GOSPA with p = 2 and alpha = 2 (Rahmathullah, Garcia-Fernandez & Svensson, "Generalized optimal
sub-pattern assignment metric", FUSION 2017):

    GOSPA^2 = sum over pairs of distance^2 + c^2 / 2 (missed + false)

Identities are scored over the episode as IDF1 (Ristani et al., "Performance measures and a data set for multi-target,
multi-camera tracking", ECCV Workshops 2016): the share of instants that the best one-to-one assignment of tracks to
vehicles explains.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.base.settings import Settings

CUTOFF_M = 2.0
"""A track farther from its vehicle than this is of no use: GOSPA's c."""
SLOW_MPS, SLOW_FOR_S = 6.0, 5.0
"""A vehicle is slow that was below this speed at some time in the last seconds."""
SETTLED_S = 2.0
"""Nothing is scored before, by default: the network begins without a track."""
QUANTILE_BINS = 2000
"""Errors up to `CUTOFF_M` are counted in so many bins: 1 mm each."""


class SceneScores(Settings):
    """The scores of one episode, over all instants at which a vehicle or a track is where two masts see it.

    vehicle_fixes, track_fixes: how many vehicles and tracks there were, summed over instants; slow_fixes: of the first,
    those of slow vehicles. matched_fixes: vehicles with a track. driven_km: by the vehicles. rms_m, p95_m: error of
    positions, root mean square and 95 %. missed, missed_slow: share of vehicles without a track, of those that are not
    slow and of those that are. false: share of tracks without a vehicle. switches: changes of a vehicle's track. idf1:
    see above. nees: mean over positions of the squared error normalised by the track's covariance, over 2; 1 is right.
    gospa_m: root mean square over the instants; gospa_parts_m2: what localisation, missed vehicles and false tracks add
    to its square. Values are None where there is nothing to score.
    """

    instants: int = 0
    vehicle_fixes: int = 0
    slow_fixes: int = 0
    track_fixes: int = 0
    matched_fixes: int = 0
    driven_km: float = 0.0
    rms_m: float | None = None
    p95_m: float | None = None
    missed: float | None = None
    missed_slow: float | None = None
    false: float | None = None
    switches: int = 0
    switches_per_km: float | None = None
    idf1: float | None = None
    nees: float | None = None
    gospa_m: float | None = None
    gospa_parts_m2: tuple[float, float, float] | None = None


def assign(true: Array, tracked: Array) -> tuple[IntArray, IntArray]:
    """Assign tracks to vehicles as GOSPA does; return the numbers of both, of pairs within CUTOFF_M.

    true, tracked: positions, m, (V, 2) and (T, 2).
    """
    from scipy.optimize import linear_sum_assignment  # loaded only here, because it takes long

    none = np.empty(0, np.int64)
    if not len(true) or not len(tracked):
        return none, none
    distance = np.hypot(true[:, None, 0] - tracked[:, 0], true[:, None, 1] - tracked[:, 1])
    vehicle, track = linear_sum_assignment(np.minimum(distance, CUTOFF_M) ** 2)
    near = distance[vehicle, track] < CUTOFF_M
    return vehicle[near].astype(np.int64), track[near].astype(np.int64)


class Scoring:
    """Adds up the scores of an episode, instant by instant.

    step_s: between instants. settled_s: nothing is scored before.
    """

    def __init__(self, step_s: float, settled_s: float = SETTLED_S) -> None:
        self._step_s, self._settled_s = step_s, settled_s
        self._steps = 0
        self._instants = self._vehicles = self._slow = self._missed = self._missed_slow = 0
        self._tracks = self._false = self._switches = 0
        self._driven_m = self._square = self._nees = 0.0
        self._errors = np.zeros(QUANTILE_BINS, np.int64)
        self._pairs: Counter[tuple[str, int]] = Counter()
        self._latest: dict[str, int] = {}
        self._slow_until: dict[str, float] = {}

    def add(
        self,
        names: Sequence[str],
        true: Array,
        covered: BoolArray,
        numbers: IntArray,
        tracked: Array,
        covariance: Array,
        tracks_covered: BoolArray,
    ) -> tuple[IntArray, IntArray]:
        """Add one instant, and return which vehicles have which tracks.

        names, true, covered: of the vehicles, with x, y, vx, vy, (V, 4), and whether two masts see them. numbers,
        tracked, covariance, tracks_covered: of the tracks, with positions, (T, 2), and their covariances, (T, 2, 2).
        """
        vehicle, track = assign(true[:, :2], tracked)
        now = self._steps * self._step_s
        self._steps += 1
        speed = np.hypot(true[:, 2], true[:, 3])
        for k in np.flatnonzero(speed < SLOW_MPS).tolist():
            self._slow_until[names[k]] = now + SLOW_FOR_S
        if now < self._settled_s:
            return vehicle, track
        self._instants += 1
        slow = np.array([self._slow_until.get(name, -1.0) >= now for name in names], dtype=bool)
        matched = np.zeros(len(names), dtype=bool)
        matched[vehicle] = True
        self._vehicles += int(covered.sum())
        self._slow += int((covered & slow).sum())
        self._missed += int((covered & ~slow & ~matched).sum())
        self._missed_slow += int((covered & slow & ~matched).sum())
        self._driven_m += float(speed[covered].sum()) * self._step_s
        has_vehicle = np.zeros(len(numbers), dtype=bool)
        has_vehicle[track] = True
        self._tracks += int(tracks_covered.sum())
        self._false += int((tracks_covered & ~has_vehicle).sum())
        counted = covered[vehicle]
        self._add_pairs([names[k] for k in vehicle[counted].tolist()], numbers[track[counted]].tolist())
        error = tracked[track[counted]] - true[vehicle[counted], :2]
        square = (error**2).sum(axis=1)
        self._square += float(square.sum())
        bins = np.minimum(np.sqrt(square) / CUTOFF_M * QUANTILE_BINS, QUANTILE_BINS - 1).astype(np.int64)
        self._errors += np.bincount(bins, minlength=QUANTILE_BINS)
        if len(error):
            weighted = np.linalg.solve(covariance[track[counted]], error[..., None])[..., 0]
            self._nees += float((error * weighted).sum())
        return vehicle, track

    def _add_pairs(self, names: Iterable[str], numbers: Iterable[int]) -> None:
        for name, number in zip(names, numbers, strict=True):
            self._pairs[name, number] += 1
            self._switches += self._latest.get(name, number) != number
            self._latest[name] = number

    def scores(self) -> SceneScores:
        """Return the scores of the instants so far."""
        pairs, moving = sum(self._pairs.values()), self._vehicles - self._slow
        missed = self._missed + self._missed_slow
        half = CUTOFF_M**2 / 2
        parts = np.array([self._square, half * missed, half * self._false]) / max(self._instants, 1)
        return SceneScores(
            instants=self._instants,
            vehicle_fixes=self._vehicles,
            slow_fixes=self._slow,
            track_fixes=self._tracks,
            matched_fixes=pairs,
            driven_km=round(self._driven_m / 1000, 6),
            rms_m=_share(self._square, pairs, root=True),
            p95_m=self._quantile(0.95) if pairs else None,
            missed=_share(self._missed, moving),
            missed_slow=_share(self._missed_slow, self._slow),
            false=_share(self._false, self._tracks),
            switches=self._switches,
            switches_per_km=_share(self._switches, self._driven_m / 1000),
            idf1=_share(2 * self._explained(), self._vehicles + self._tracks),
            nees=_share(self._nees / 2, pairs),
            gospa_m=_share(float(parts.sum()), 1, root=True) if self._instants else None,
            gospa_parts_m2=(round(parts[0], 6), round(parts[1], 6), round(parts[2], 6)) if self._instants else None,
        )

    def _quantile(self, share: float) -> float:
        total = np.cumsum(self._errors)
        return round(float((np.searchsorted(total, share * total[-1]) + 1) * CUTOFF_M / QUANTILE_BINS), 6)

    def _explained(self) -> int:
        """Return the instants that the best one-to-one assignment of tracks to vehicles explains."""
        from scipy.optimize import linear_sum_assignment  # loaded only here, because it takes long

        if not self._pairs:
            return 0
        vehicles = {name: k for k, name in enumerate(dict.fromkeys(name for name, _ in self._pairs))}
        tracks = {number: k for k, number in enumerate(dict.fromkeys(number for _, number in self._pairs))}
        together = np.zeros((len(vehicles), len(tracks)), np.int64)
        for (name, number), count in self._pairs.items():
            together[vehicles[name], tracks[number]] = count
        rows, columns = linear_sum_assignment(together, maximize=True)
        return int(together[rows, columns].sum())


def pooled(scores: Sequence[SceneScores]) -> SceneScores:
    """Return the scores of several episodes together; of `p95_m`, the mean over what was matched."""

    def mean(name: str, weight: Sequence[float], root: bool = False) -> float | None:
        pairs = [(getattr(one, name), of) for one, of in zip(scores, weight, strict=True)]
        known = [(value**2 if root else value, of) for value, of in pairs if value is not None]
        return _share(sum(value * of for value, of in known), sum(of for _, of in known), root)

    total = {name: sum(getattr(one, name) for one in scores) for name in _COUNTS}
    matched, instants = [one.matched_fixes for one in scores], [one.instants for one in scores]
    parts = [one.gospa_parts_m2 or (0.0, 0.0, 0.0) for one in scores]
    split = np.average(parts, axis=0, weights=instants) if total["instants"] else None
    return SceneScores(
        **total,
        rms_m=mean("rms_m", matched, root=True),
        p95_m=mean("p95_m", matched),
        missed=mean("missed", [one.vehicle_fixes - one.slow_fixes for one in scores]),
        missed_slow=mean("missed_slow", [one.slow_fixes for one in scores]),
        false=mean("false", [one.track_fixes for one in scores]),
        switches_per_km=_share(total["switches"], total["driven_km"]),
        idf1=mean("idf1", [one.vehicle_fixes + one.track_fixes for one in scores]),
        nees=mean("nees", matched),
        gospa_m=mean("gospa_m", instants, root=True),
        gospa_parts_m2=None if split is None else (float(split[0]), float(split[1]), float(split[2])),
    )


def scene_scores(of_episodes: Iterable[SceneScores | None]) -> dict[str, Any]:
    """Return the scores of several episodes together by the key `scene`; nothing where none of them was a scene."""
    scores = [one for one in of_episodes if one is not None]
    return {"scene": pooled(scores).model_dump(mode="json")} if scores else {}


def scene_line(scores: Mapping[str, Any]) -> str:
    """Return what is printed of scores, as plain values."""
    return "scene: " + ", ".join(f"{key} {scores[key]}" for key in SHOWN)


SHOWN = ("rms_m", "p95_m", "missed", "missed_slow", "false", "switches_per_km", "idf1", "nees", "gospa_m")
"""Scores that are printed."""
_COUNTS = (
    "instants", "vehicle_fixes", "slow_fixes", "track_fixes", "matched_fixes", "driven_km", "switches",
)  # fmt: skip
"""Fields that add up over episodes."""


def _share(part: float, whole: float, root: bool = False) -> float | None:
    if not whole:
        return None
    value = float(part) / float(whole)
    return round(float(np.sqrt(value)) if root else value, 6)
