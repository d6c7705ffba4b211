"""One filter over all panels: tracks go on by what their detections say, begin on the road's map, and end.

The states of all tracks are predicted to the instant, all panels' detections are associated with them, and all of a
track's detections enter together, in the information form of the extended Kalman filter:

    J = sum H' R^-1 H,  g = sum H' R^-1 (z - h(x)),  K = P_m (1 + J P_mm)^-1,  x <- x + K g,  P <- P - K J P_m'

where P_m are the columns of position, velocity and length. The model of the motion is that of
`isacsim.tracking.kalman`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from isac_cosim.base.arrays import Array, BoolArray
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scene.association import Pairs, associate, associate_truly, wrapped
from isac_cosim.isacsim.scene.detection import Detections
from isac_cosim.isacsim.scene.extent import (
    LASTS,
    LENGTH_SD_M,
    LONG_M,
    LONGEST_M,
    OFF_MPS,
    SHORTEST_M,
    SLOW_MPS,
    SLOWEST_MPS,
    Expected,
    astray,
    between_points,
    ends_put_right,
    expected,
    matched,
    off_its_point,
    robust_weight,
    rows_at,
)
from isac_cosim.isacsim.scene.lifetime import (
    ANSWERED_FOR,
    STANDING_MPS,
    WITHIN_FOR,
    YOUNG_HITS,
    Birth,
    Tracks,
    births,
    without_doubles,
)
from isac_cosim.isacsim.scene.road import NEAR_M, RoadMap
from isac_cosim.isacsim.scene.rolling import rolled, rolling_noise
from isac_cosim.isacsim.scene.settings import SceneSetup
from isac_cosim.isacsim.scene.vehicles import seen
from isac_cosim.isacsim.tracking.fusion import jacobian
from isac_cosim.isacsim.tracking.kalman import process_noise, transition

CONFIRMED_HITS = 6
"""Instants with a detection after which a track counts."""
LEAST_FOUND = 0.5
"""A body is found where at least this share of the panels that look for it find it: an echo of a roof or of two points
in one cell lies, on the road, in another place for every panel."""
TENTATIVE_MISSES, LONGEST_GAP_S = 2, 1.2
"""A track that does not count yet ends after more instants without a detection; one that counts, after this time, s."""
LONGEST_HOLD_S, LOOSE_S = 120.0, 2.0
"""One that counts and stands ends after this time, s. At first, so long, s, its uncertainty grows as that of others: it
may have pulled off meanwhile, and its next detection is then elsewhere and of another velocity."""
WIDEST_M = 8.0
"""A track that counts and whose position is less certain than this has lost its vehicle, m."""
APART_CELLS = np.array([0.0, 1.35, 1.75, 2.25, 2.75, 3.5, 5.0, 8.0])
CROWDED_CELLS = np.array([0.5, 0.5, 0.3, 0.15, 0.06, 0.015, 0.004, 0.001])
"""Standard deviation that is allowed for what another vehicle does to a detection along each axis, cells, against the
distance between the two, cells along the axis on which it is largest: two to
three times the errors that `benchmarks.findings.sensing.scene_crowding` measures, because they outlast an instant."""
NEIGHBOURS_M = 60.0
"""Vehicles farther apart than this do not share a cell, m: an angle cell is 44 m wide at 350 m."""
CLEAR_CELLS = 0.1
"""A detection tells an end where other vehicles move it by less, cells."""
MEASURED = [0, 1, 2, 3, 6]
"""Components of the state that detections tell: position, velocity and length."""
OFF_ROAD_EVERY = 10
"""Instants between looks at whether tracks are on the road."""


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
        self._bodies = setup.scene.bodies == "bodies"
        self._move, self._noise = np.eye(7), np.zeros((7, 7))
        self._move[:6, :6] = transition(step_s)
        self._noise[:6, :6] = process_noise(step_s, setup.tracking.jerk_density)
        self._noise[6, 6] = step_s * LENGTH_SD_M**2 * self._bodies
        self._longest_gap = max(1, round(LONGEST_GAP_S * setup.scene.fixes_hz))
        self._longest_hold, self._loose = (round(time * setup.scene.fixes_hz) for time in (LONGEST_HOLD_S, LOOSE_S))
        self._born = 0
        self._steps = 0
        self._of_vehicle: dict[str, int] = {}
        self.tracks = Tracks.none()

    def begin(self, names: Sequence[str], of_each: Sequence[Birth]) -> None:
        """Begin with tracks of vehicles that have long been followed. They are as at the first instant to come."""
        tracks = Tracks.none().with_born(of_each, 0)
        before = tracks.state @ np.linalg.inv(self._move).T
        certain = np.ones(len(tracks), dtype=bool)
        self.tracks = replace(tracks, state=before, hits=tracks.hits + YOUNG_HITS, confirmed=certain)
        self._of_vehicle = {name: k for k, name in enumerate(names)}
        self._born = len(names)

    def step(
        self, detections: Sequence[Detections], true: tuple[Sequence[str], Array, BoolArray] | None = None
    ) -> Tracks:
        """Go on by one instant and return the tracks.

        detections: of each panel. true: names of the vehicles, what the panels should measure of them, (V, I, J, 3),
        and who is seen where, (V, I), if the truth associates.
        """
        tracks = self._predicted()
        of = expected(tracks.state, tracks.ahead, self._panels, self._bodies)
        spread = self._spread(tracks, of.measured)
        view = seen(tracks.state[:, :2], self._panels, self._setup.range_m, self._setup.half_width_deg)
        variance = self._variance(tracks, of, spread)
        if true is None:
            pairs = associate(detections, of.measured, variance, view, tracks.confirmed, self._ambiguity_mps)
            owners: list[str | None] = [None] * len(pairs.free)
        else:
            pairs, owners = self._truly(detections, tracks, true)
        tracks = self._updated(tracks, pairs, detections, of, spread, variance, view)
        born, within = births(
            pairs.free, owners, detections, tracks, self._panels, self._road, self._ambiguity_mps, self._per_unit,
            self._bodies,
        )  # fmt: skip
        tracks = replace(tracks, within=tracks.within + (within - tracks.within) / WITHIN_FOR)
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
        noise = rolling_noise(self._noise, tracks.ahead) if self._bodies else self._noise
        covariance = self._move @ tracks.covariance @ self._move.T + noise
        held = tracks.standing & tracks.confirmed & (tracks.misses > 0)
        if held.any():
            state[held, 2:6] = 0.0
            held &= tracks.misses > self._loose
            covariance[held] = tracks.covariance[held]
        return replace(tracks, state=state, covariance=covariance)

    def _variance(self, tracks: Tracks, of: Expected, spread: Array) -> Array:
        """Return the variance of detections about the points that they are of, (T, I, 3)."""
        middle = np.concatenate([tracks.middle, tracks.state[:, 2:4]], axis=1)
        rows = jacobian(middle, of.middle, self._panels)
        covariance = tracks.covariance[:, None, :4, :4].copy()
        covariance[:, :, :2, :2] = tracks.middle_covariance()[:, None]
        variance = (rows @ covariance * rows).sum(axis=-1) + spread**2
        if self._bodies:
            variance += between_points(of.middle, np.hypot(tracks.state[:, 2], tracks.state[:, 3]))
        return np.asarray(variance)

    def _spread(self, tracks: Tracks, points: Array) -> Array:
        """Return the deviation that other vehicles cause, by how near the nearest one is in cells, (T, I, 3)."""
        cells = points * self._per_unit
        low, high = cells.min(axis=2), cells.max(axis=2)
        nearest = np.full(low.shape[:2], np.inf)
        if len(tracks) > 1:
            near = cKDTree(tracks.state[:, :2]).query_pairs(NEIGHBOURS_M, output_type="ndarray")
            one, two = near.T
            apart = np.maximum(low[one] - high[two], low[two] - high[one]).max(axis=-1)
            for this, other in ((one, two), (two, one)):
                # A track that does not count yet may be of nothing.
                counts = tracks.confirmed[other]
                np.minimum.at(nearest, this[counts], apart[counts])
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
        of: Expected,
        spread: Array,
        variance: Array,
        view: BoolArray,
    ) -> Tracks:
        """Return the tracks with their detections."""
        count = len(tracks)
        has = np.zeros(view.shape, dtype=bool)
        has[pairs.track, pairs.panel] = True
        found = has.sum(axis=1)
        looked = (view | has).sum(axis=1)
        level = np.full(count, np.nan)
        state, covariance, off = tracks.state, tracks.covariance, tracks.astray_m
        if len(pairs.track):
            first = np.concatenate([[0], np.cumsum([len(one) for one in detections])])[pairs.panel] + pairs.detection
            measured, noise = (
                np.concatenate([getattr(one, name) for one in detections])[first] for name in ("measured", "deviation")
            )
            power = np.concatenate([one.power for one in detections])[first]
            at = pairs.track, pairs.panel
            plain = noise**2 + spread[at] ** 2
            surprise = wrapped(measured[:, None] - of.measured[at], self._ambiguity_mps)
            if self._bodies:
                mean, apart, behind = matched(surprise, variance[at], of.measured[at], of.share[at], of.behind)
                clear = spread[at][:, 1] < CLEAR_CELLS / self._per_unit[1]
                ends = pairs.track[clear], pairs.panel[clear]
                off = astray(surprise[clear], power[clear], of.share[ends], ends, of, self._panels, tracks.middle, off)
                speed = np.hypot(tracks.state[pairs.track, 2], tracks.state[pairs.track, 3])
                lasts = LASTS * np.maximum(1.0, SLOW_MPS / np.maximum(speed, SLOWEST_MPS))[:, None]
                row = rows_at(mean, behind, *at, tracks.state, of, self._panels)
                plain[:, 2] += LASTS * OFF_MPS**2
                uncertain = lasts[..., None] * (apart + off_its_point(row)) + plain[..., None] * np.eye(3)
                surprise = wrapped(measured - mean, self._ambiguity_mps)
                of_track = covariance[pairs.track][:, MEASURED][:, :, MEASURED]
                share = robust_weight(surprise, uncertain + row @ of_track @ row.transpose(0, 2, 1))
                weight = np.linalg.inv(uncertain) * share[:, None, None]
            else:
                mean, behind = of.middle[at], np.zeros(len(measured))
                row = rows_at(mean, behind, *at, tracks.state, of, self._panels)
                surprise = wrapped(measured - mean, self._ambiguity_mps)
                weight = np.eye(3) / plain[..., None]
            weighted = row.transpose(0, 2, 1) @ weight
            information, gradient = np.zeros((count, 5, 5)), np.zeros((count, 5))
            np.add.at(information, pairs.track, weighted @ row)
            np.add.at(gradient, pairs.track, (weighted @ surprise[..., None])[..., 0])
            of_motion = covariance[:, :, MEASURED]
            gain = of_motion @ np.linalg.inv(np.eye(5) + information @ covariance[:, MEASURED][:, :, MEASURED])
            state = state + (gain @ gradient[..., None])[..., 0]
            covariance = covariance - gain @ information @ of_motion.transpose(0, 2, 1)
            covariance = (covariance + covariance.transpose(0, 2, 1)) / 2
            if self._bodies:
                state, covariance = rolled(state, covariance, self._road.along(state[:, :2], tracks.ahead))
                longest = np.where(tracks.state[:, 6] > LONG_M, LONGEST_M, LONG_M)
                state[:, 6] = np.clip(state[:, 6], SHORTEST_M, longest)
                ends_put_right(state, covariance, tracks.ahead, off)
            with np.errstate(invalid="ignore"):
                total = np.bincount(pairs.track, minlength=count)
                level = np.bincount(pairs.track, power, count) / np.where(total > 0, total, np.nan)
        hit = (found > 0) & ((not self._bodies) | (found >= LEAST_FOUND * looked))
        hits = tracks.hits + hit
        answered = np.divide(found, looked, out=np.zeros(count), where=looked > 0)
        speed = np.hypot(state[:, 2], state[:, 3])[:, None]
        return replace(
            tracks,
            state=state,
            covariance=covariance,
            ahead=np.where(speed > STANDING_MPS, state[:, 2:4] / np.maximum(speed, STANDING_MPS), tracks.ahead),
            hits=hits,
            misses=np.where(hit, 0, tracks.misses + 1),
            confirmed=tracks.confirmed | (hits >= CONFIRMED_HITS),
            looked=looked,
            found=found,
            answered=tracks.answered + (answered - tracks.answered) / ANSWERED_FOR,
            level=level,
            astray_m=off,
        )

    def _kept(self, tracks: Tracks) -> Tracks:
        """Return the tracks without those that have ended."""
        if not len(tracks):
            return tracks
        sd = np.sqrt(tracks.covariance[:, 0, 0] + tracks.covariance[:, 1, 1])
        uncertain = tracks.confirmed & (sd > WIDEST_M)
        gone = tracks.misses > np.where(tracks.confirmed, self._longest_gap, TENTATIVE_MISSES)
        # Who stands is lost among what stands beside the road, and has not gone.
        kept = ~(uncertain | gone) | (tracks.confirmed & tracks.standing & (tracks.misses < self._longest_hold))
        kept &= (tracks.misses == 0) | ~self._road.left(tracks.state[:, :2])
        if self._steps % OFF_ROAD_EVERY == 0:
            kept &= self._road.distance_m(tracks.state[:, :2]) <= NEAR_M + 1.0
        return without_doubles(tracks.take(kept), self._bodies)
