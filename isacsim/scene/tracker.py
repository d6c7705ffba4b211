"""One filter over all panels: tracks go on by what their detections say, begin on the road's map, and end.

The states of all tracks are predicted to the instant, all panels' detections are associated with them, and all of a
track's detections enter together, in the information form of the extended Kalman filter:

    J = sum H' R^-1 H,  g = sum H' R^-1 (z - h(x)),  K = P_m (1 + J P_mm)^-1,  x <- x + K g,  P <- P - K J P_m'

where P_m are the columns of position and velocity. The model of the motion is that of `isacsim.tracking.kalman`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scene.association import Pairs, associate, associate_truly, wrapped
from isac_cosim.isacsim.scene.detection import Detections
from isac_cosim.isacsim.scene.initiation import Birth, births
from isac_cosim.isacsim.scene.road import NEAR_M, RoadMap
from isac_cosim.isacsim.scene.settings import SceneSetup
from isac_cosim.isacsim.scene.vehicles import seen
from isac_cosim.isacsim.tracking.fusion import jacobian
from isac_cosim.isacsim.tracking.kalman import process_noise, transition

CONFIRMED_HITS = 6
"""Instants with a detection after which a track counts."""
TENTATIVE_MISSES, LONGEST_GAP_S = 2, 0.6
"""A track that does not count yet ends after more instants without a detection; one that counts, after this time, s."""
WIDEST_M = 8.0
"""A track that counts and whose position is less certain than this has lost its vehicle, m."""
APART_CELLS = np.array([0.0, 1.35, 1.75, 2.25, 2.75, 3.5, 5.0, 8.0])
CROWDED_CELLS = np.array([0.5, 0.5, 0.3, 0.15, 0.06, 0.015, 0.004, 0.001])
"""Standard deviation that is allowed for what another vehicle does to a detection along each axis, cells, against the
distance between the two, cells along the axis on which it is largest: two to
three times the errors that `benchmarks.findings.sensing.scene_crowding` measures, because they outlast an instant."""
NEIGHBOURS_M = 60.0
"""Vehicles farther apart than this do not share a cell, m: an angle cell is 44 m wide at 350 m."""
TWIN_ALONG_M, TWIN_ACROSS_M = 1.5, 1.3
"""Two tracks nearer than this are of one vehicle."""
TWIN_STEPS, TENTATIVE_TWIN_STEPS = 6, 1
"""Instants after which the younger of two such tracks ends, where it counts already, and where it does not."""
OFF_ROAD_EVERY = 10
"""Instants between looks at whether tracks are on the road."""


@dataclass(frozen=True)
class Tracks:
    """T tracks at one instant, the oldest first; all arrays (T, ...).

    number: unlike for every track. state: x, y, vx, vy, ax, ay, m, m/s, m/s2, (T, 6). covariance: (T, 6, 6).
    hits, misses: instants with a detection in all, and without one in a row. confirmed: whether it counts. twin:
    instants for which it has been on top of an older one. looked, found: how many panels look for it, and found it at
    the latest instant. level: mean power of what they found over the noise after processing, NaN without.
    """

    number: IntArray
    state: Array
    covariance: Array
    hits: IntArray
    misses: IntArray
    confirmed: BoolArray
    twin: IntArray
    looked: IntArray
    found: IntArray
    level: Array

    @staticmethod
    def none() -> Tracks:
        """No track."""
        whole = np.empty(0, np.int64)
        return Tracks(
            whole, np.empty((0, 6)), np.empty((0, 6, 6)), whole, whole, np.empty(0, bool), whole, whole, whole,
            np.empty(0),
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.number)

    def take(self, kept: BoolArray) -> Tracks:
        """Return some of the tracks."""
        return Tracks(**{name: getattr(self, name)[kept] for name in self.__dataclass_fields__})

    def with_born(self, born: Sequence[Birth], first_number: int) -> Tracks:
        """Return the tracks and new ones."""
        if not born:
            return self
        count = len(born)
        zeros = np.zeros(count, np.int64)
        fresh = Tracks(
            first_number + np.arange(count), np.stack([of.state for of in born]),
            np.stack([of.covariance for of in born]), zeros + 1, zeros, np.zeros(count, bool), zeros, zeros + 1,
            zeros + 1, np.array([of.power for of in born]),
        )  # fmt: skip
        return Tracks(
            **{name: np.concatenate([getattr(self, name), getattr(fresh, name)]) for name in self.__dataclass_fields__}
        )


class SceneTracker:
    """Follows all vehicles from instant to instant.

    tracks: all of them after the latest instant, also those that do not count yet.
    """

    def __init__(self, setup: SceneSetup, panels: Panels, lanes: Sequence[Lane]) -> None:
        self._setup, self._panels, self._road = setup, panels, RoadMap(lanes)
        waveform = setup.numerology.waveform
        self._per_unit = np.abs(waveform.cells_per_unit)
        self._ambiguity_mps = waveform.symbols / self._per_unit[2]
        step_s = 1 / setup.scene.fixes_hz
        self._move = transition(step_s)
        self._noise = process_noise(step_s, setup.tracking.jerk_density)
        self._longest_gap = max(1, round(LONGEST_GAP_S * setup.scene.fixes_hz))
        self._born = 0
        self._steps = 0
        self._of_vehicle: dict[str, int] = {}
        self.tracks = Tracks.none()

    def step(
        self, detections: Sequence[Detections], true: tuple[Sequence[str], Array, BoolArray] | None = None
    ) -> Tracks:
        """Go on by one instant and return the tracks.

        detections: of each panel. true: names of the vehicles, what the panels should measure of them, (V, I, 3), and
        who is seen where, (V, I), if the truth associates.
        """
        tracks = self._predicted()
        predicted = self._panels.measured(tracks.state[:, :4])
        rows = jacobian(tracks.state[:, :4], predicted, self._panels)
        spread = self._spread(tracks, predicted)
        view = seen(tracks.state[:, :2], self._panels, self._setup.range_m, self._setup.half_width_deg)
        if true is None:
            own = (rows @ tracks.covariance[:, None, :4, :4] * rows).sum(axis=-1)
            pairs = associate(detections, predicted, own + spread**2, view, self._ambiguity_mps)
            owners: list[str | None] = [None] * len(pairs.free)
        else:
            pairs, owners = self._truly(detections, tracks, true)
        tracks = self._updated(tracks, pairs, detections, predicted, rows, spread, view)
        born = self._births(tracks, pairs.free, owners, detections)
        self.tracks = self._kept(tracks.with_born([birth for birth, _ in born], self._born))
        for k, (_, owner) in enumerate(born):
            if owner is not None:
                self._of_vehicle[owner] = self._born + k
        self._born += len(born)
        self._steps += 1
        return self.tracks

    def _predicted(self) -> Tracks:
        tracks = self.tracks
        state = tracks.state @ self._move.T
        return replace(tracks, state=state, covariance=self._move @ tracks.covariance @ self._move.T + self._noise)

    def _spread(self, tracks: Tracks, predicted: Array) -> Array:
        """Return the deviation that other vehicles cause, by how near the nearest one is in cells, (T, I, 3)."""
        cells = predicted * self._per_unit
        nearest = np.full(predicted.shape[:2], np.inf)
        if len(tracks) > 1:
            near = cKDTree(tracks.state[:, :2]).query_pairs(NEIGHBOURS_M, output_type="ndarray")
            apart = np.abs(cells[near[:, 0]] - cells[near[:, 1]]).max(axis=-1)
            for one, other in ((0, 1), (1, 0)):
                # A track that does not count yet may be of nothing.
                counts = tracks.confirmed[near[:, other]]
                np.minimum.at(nearest, near[counts, one], apart[counts])
        sd = np.exp(np.interp(nearest, APART_CELLS, np.log(CROWDED_CELLS)))
        return np.asarray(sd[..., None] / self._per_unit)

    def _truly(
        self, detections: Sequence[Detections], tracks: Tracks, true: tuple[Sequence[str], Array, BoolArray]
    ) -> tuple[Pairs, list[str | None]]:
        """Return the pairs by the truth; detections of vehicles without a track are free, and have an owner."""
        names, measured, view = true
        pairs = associate_truly(detections, measured, view, self._per_unit, self._ambiguity_mps)
        place = {number: k for k, number in enumerate(tracks.number.tolist())}
        at = np.array([place.get(self._of_vehicle.get(name, -1), -1) for name in names], np.int64)
        row = at[pairs.track]
        owned = row < 0
        free = list(zip(pairs.panel[owned].tolist(), pairs.detection[owned].tolist(), strict=True))
        owners: list[str | None] = [names[k] for k in pairs.track[owned].tolist()]
        known = ~owned
        return Pairs(row[known], pairs.panel[known], pairs.detection[known], free), owners

    def _updated(
        self,
        tracks: Tracks,
        pairs: Pairs,
        detections: Sequence[Detections],
        predicted: Array,
        rows: Array,
        spread: Array,
        view: BoolArray,
    ) -> Tracks:
        """Return the tracks with their detections."""
        count = len(tracks)
        found = np.bincount(pairs.track, minlength=count)
        looked = np.maximum(view.sum(axis=1), found)
        level = np.full(count, np.nan)
        state, covariance = tracks.state, tracks.covariance
        if len(pairs.track):
            first = np.concatenate([[0], np.cumsum([len(of) for of in detections])])[pairs.panel] + pairs.detection
            measured = np.concatenate([of.measured for of in detections])[first]
            noise = np.concatenate([of.deviation for of in detections])[first]
            power = np.concatenate([of.power for of in detections])[first]
            at = pairs.track, pairs.panel
            surprise = wrapped(measured - predicted[at], self._ambiguity_mps)
            weight = 1 / (noise**2 + spread[at] ** 2)
            row = rows[at]
            weighted = row * weight[..., None]
            information, gradient = np.zeros((count, 4, 4)), np.zeros((count, 4))
            np.add.at(information, pairs.track, weighted.transpose(0, 2, 1) @ row)
            np.add.at(gradient, pairs.track, (weighted * surprise[..., None]).sum(axis=1))
            of_motion = covariance[:, :, :4]
            gain = of_motion @ np.linalg.inv(np.eye(4) + information @ covariance[:, :4, :4])
            state = state + (gain @ gradient[..., None])[..., 0]
            covariance = covariance - gain @ information @ of_motion.transpose(0, 2, 1)
            covariance = (covariance + covariance.transpose(0, 2, 1)) / 2
            with np.errstate(invalid="ignore"):
                level = np.bincount(pairs.track, power, count) / np.where(found > 0, found, np.nan)
        hit = found > 0
        hits = tracks.hits + hit
        return replace(
            tracks,
            state=state,
            covariance=covariance,
            hits=hits,
            misses=np.where(hit, 0, tracks.misses + 1),
            confirmed=tracks.confirmed | (hits >= CONFIRMED_HITS),
            looked=looked,
            found=found,
            level=level,
        )

    def _births(
        self,
        tracks: Tracks,
        free: Sequence[tuple[int, int]],
        owners: Sequence[str | None],
        detections: Sequence[Detections],
    ) -> list[tuple[Birth, str | None]]:
        """Return new tracks from detections without one, with their vehicles where the truth associates."""
        if not free:
            return []
        return births(
            free, owners, detections, tracks.state, self._panels, self._road, self._ambiguity_mps, self._per_unit
        )

    def _kept(self, tracks: Tracks) -> Tracks:
        """Return the tracks without those that have ended."""
        if not len(tracks):
            return tracks
        sd = np.sqrt(tracks.covariance[:, 0, 0] + tracks.covariance[:, 1, 1])
        uncertain = tracks.confirmed & (sd > WIDEST_M)
        gone = tracks.misses > np.where(tracks.confirmed, self._longest_gap, TENTATIVE_MISSES)
        kept = ~(uncertain | gone)
        if self._steps % OFF_ROAD_EVERY == 0:
            kept &= self._road.distance_m(tracks.state[:, :2]) <= NEAR_M + 1.0
        tracks = self._twins_counted(tracks.take(kept))
        limit = np.where(tracks.confirmed, TWIN_STEPS, TENTATIVE_TWIN_STEPS)
        return tracks.take(tracks.twin <= limit)

    def _twins_counted(self, tracks: Tracks) -> Tracks:
        """Count for each track the instants in a row for which it has been on top of an older one."""
        twin = np.zeros(len(tracks), np.int64)
        if len(tracks) > 1:
            for one, other in cKDTree(tracks.state[:, :2]).query_pairs(TWIN_ALONG_M + TWIN_ACROSS_M):
                older, younger = min(one, other), max(one, other)
                velocity = tracks.state[older, 2:4]
                ahead = velocity / max(float(np.hypot(*velocity)), 1e-6)
                apart = tracks.state[younger, :2] - tracks.state[older, :2]
                across = abs(ahead[0] * apart[1] - ahead[1] * apart[0])
                if abs(ahead @ apart) < TWIN_ALONG_M and across < TWIN_ACROSS_M:
                    twin[younger] = tracks.twin[younger] + 1
        return replace(tracks, twin=twin)
