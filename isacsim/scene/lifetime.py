"""How tracks begin and end.

A detection without a track, put on the road's map, is taken for a vehicle that drives along. Of two tracks of one
vehicle, one ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.scene.detection import Detections
from isac_cosim.isacsim.scene.extent import CAR_M, CAR_SD_M, CAR_WIDTH_M, LONG_M, LONG_WIDTH_M, LONGEST_M
from isac_cosim.isacsim.scene.road import RoadMap

FASTEST_MPS = 60.0
"""Nobody is taken to drive faster."""
LEAST_COSINE = 0.25
"""A radial velocity tells the speed along the road where the line of sight is not squarer to it than this."""
APART_ALONG_M, APART_ACROSS_M, APART_SHARE = 2.5, 1.6, 0.012
"""A detection nearer to a track than this is not of another vehicle: along and across its way, and across as a share of
the distance from the panel."""
BODY_ACROSS_M, HIGH_ACROSS_M2 = 2.2, 31.0
"""The same across for a body, m; and, for a high one, by how much more near a mast, times the distance: its roof seems
to be nearer to the mast than it is."""
BIRTH_CELLS = 0.1
"""Standard deviation that is allowed to the detection that a track begins with, cells."""
LEAST_GROUND_M = 2.0
"""Detections from nearer than this to the foot of a mast are not used."""
END_SD_M = 0.7
"""Standard deviation of where on its end of a body the first detection is, m."""
STANDING_MPS = 1.0
"""A track slower than this stands: it is held where no panel finds it."""
TWIN_ALONG_M, TWIN_ACROSS_M = 1.5, 1.3
"""Two tracks nearer than this are of one vehicle."""
OUTLASTS_M = 0.1
"""Standard deviation of the errors of a body along its way that stay as long as it is seen, m. Its echoes come of
several points that are not told apart, and which of them answers depends on the vehicle. Over whole passages of cars,
the mean error is below 0.07 m for two in three, and below 0.15 m for nine in ten."""
FOLLOWED_SD = np.array([0.25, 0.2, 0.5, 0.4])
"""Standard deviation of the position, the velocity and the acceleration of tracks on the bundled motorway, along either
axis, and of a car's length, m, m/s, m/s2 and m."""
YOUNG_HITS, CLEARANCE_M = 50, 0.6
"""A track with fewer hits is on top of an older one wherever their bodies would be nearer to each other across than
this, m: nobody passes as close."""
TWIN_STEPS, TENTATIVE_TWIN_STEPS = 6, 1
"""Instants after which one of two such tracks ends, where it counts already, and where it does not."""
ANSWERED_FOR, ANSWERED_LESS = 25.0, 0.3
"""It is the younger one, unless fewer of the panels that look for the older one find it, by this share, on average over
so many instants: then the older one has lost its vehicle and has run into another's."""
ALIKE_MPS, FOLLOWER_M, FOLLOWER_S, FARTHEST_END_M, END_STEPS = 0.7, CAR_M, 0.45, 16.0, 10
"""Two tracks in a lane whose speeds differ by less, and whose middles are nearer than those of cars that people drive
at so short a headway, m and s, are the two ends of one body; so they are not if they are farther apart than a body is
long, m. After so many instants, the younger ends."""
JOINED_CHANGE_M, SETTLING_STEPS = 2.0, 50
"""A body of two ends whose length changes by more than this was two vehicles; at first, so many instants long, the
length is still found out."""
WITHIN_M, WITHIN_MPS, WITHIN_FOR, MOST_WITHIN = 2.0, 3.0, 12.0, 0.5
"""So was one in which more than this share of instants finds something that is none of its points: so far from its
ends, m, and about as fast, m/s; averaged over so many instants."""


@dataclass(frozen=True)
class Birth:
    """A new track.

    state: as in `Tracks`, (7,). covariance: (7, 7). ahead: (2,). power: of its detection over the noise. place: of the
    detection on the ground, m, (2,).
    """

    state: Array
    covariance: Array
    ahead: Array
    power: float
    place: Array


def followed(state: Array, length: Array, ahead: Array, rng: np.random.Generator) -> list[Birth]:
    """Return tracks of V vehicles that have been followed, the errors drawn.

    state: true, as in `Birth` but for the length, (V, 6). length: m, 0 of points, (V,). ahead: (V, 2).
    """
    deviation = np.tile(np.repeat(FOLLOWED_SD, (2, 2, 2, 1)), (len(state), 1))
    deviation[length == 0, 6] = 0.0
    drawn = np.column_stack([state, length]) + deviation * rng.standard_normal(deviation.shape)
    return [
        Birth(of, np.diag(sd**2), heading, np.nan, of[:2])
        for of, sd, heading in zip(drawn, deviation, ahead, strict=True)
    ]


@dataclass(frozen=True)
class Tracks:
    """T tracks at one instant, the oldest first; all arrays (T, ...).

    number: unlike for every track. state: x, y, vx, vy, ax, ay of the front bumper, m, m/s, m/s2, and the length, m,
    (T, 7). covariance: (T, 7, 7). ahead: unit vector in which it drives or last drove, (T, 2).
    hits, misses: instants with a detection in all, and without one in a row. confirmed: whether it counts. twin:
    instants for which it has lain on another one. looked, found: how many panels look for it, and found it at
    the latest instant. answered: which share found it, on average. level: mean power of what they found over the noise
    after processing, NaN without.
    joined_m: length when two ends were joined to one body, m, 0 if they were not; joined_for: instants since.
    beside, other: instants for which it has seemed to be one end of the same body as the track of that number.
    astray_m: average distance of its two ends from where their echoes come from, m, (T, 2). within: average share of
    instants that found something within the body that is none of its points.
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
    answered: Array
    level: Array
    ahead: Array
    joined_m: Array
    joined_for: IntArray
    beside: IntArray
    other: IntArray
    astray_m: Array
    within: Array

    @staticmethod
    def none() -> Tracks:
        """No track."""
        whole = np.empty(0, np.int64)
        return Tracks(
            whole, np.empty((0, 7)), np.empty((0, 7, 7)), whole, whole, np.empty(0, bool), whole, whole, whole,
            np.empty(0), np.empty(0), np.empty((0, 2)), np.empty(0), whole, whole, whole, np.empty((0, 2)),
            np.empty(0),
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.number)

    @property
    def middle(self) -> Array:
        """Middle of the body, m, (T, 2)."""
        return self.state[:, :2] - self.state[:, 6:] / 2 * self.ahead

    @property
    def standing(self) -> BoolArray:
        """Which tracks stand, (T,)."""
        return np.asarray(np.hypot(self.state[:, 2], self.state[:, 3]) < STANDING_MPS)

    def middle_covariance(self) -> Array:
        """Return the covariance of the middle, (T, 2, 2)."""
        rows = np.zeros((len(self), 2, 7))
        rows[:, 0, 0] = rows[:, 1, 1] = 1.0
        rows[:, :, 6] = -self.ahead / 2
        # The heading is that of the velocity, which turns the body about its front.
        speed = np.maximum(np.hypot(self.state[:, 2], self.state[:, 3]), STANDING_MPS)
        turned = np.eye(2) - self.ahead[:, :, None] * self.ahead[:, None]
        rows[:, :, 2:4] = -turned * (self.state[:, 6] / 2 / speed)[:, None, None]
        return np.asarray(rows @ self.covariance @ rows.transpose(0, 2, 1))

    def outlasting(self) -> Array:
        """Return the covariance of the errors that outlast a track, and that its filter does not know, (T, 2, 2)."""
        variance = np.where(self.state[:, 6] > 0, OUTLASTS_M**2, 0.0)
        return np.asarray(variance[:, None, None] * self.ahead[:, :, None] * self.ahead[:, None])

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
            zeros + 1, np.ones(count), np.array([of.power for of in born]), np.stack([of.ahead for of in born]),
            np.zeros(count), zeros, zeros, zeros - 1, np.zeros((count, 2)), np.zeros(count),
        )  # fmt: skip
        return Tracks(
            **{name: np.concatenate([getattr(self, name), getattr(fresh, name)]) for name in self.__dataclass_fields__}
        )


def births(
    free: Sequence[tuple[int, int]],
    owners: Sequence[str | None],
    detections: Sequence[Detections],
    tracks: Tracks,
    panels: Panels,
    road: RoadMap,
    ambiguity_mps: float,
    per_unit: Array,
    bodies: bool,
) -> tuple[list[tuple[Birth, str | None]], BoolArray]:
    """Return the tracks that begin, the nearest to their panels first, each with its vehicle where that is known.

    The second value tells for each track whether a detection is within its body and of none of its points, (T,).

    free, owners: panel and number of each detection without a track, and its vehicle. tracks: those that there
    are. Where the vehicle is known, one track begins for each. bodies: whether vehicles have a length.
    """
    order = sorted(range(len(free)), key=lambda k: float(detections[free[k][0]].measured[free[k][1], 1]))
    born: list[tuple[Birth, str | None]] = []
    there = [np.concatenate([state, ahead]) for state, ahead in zip(tracks.state, tracks.ahead, strict=True)]
    owned: set[str] = set()
    within = np.zeros(len(tracks), dtype=bool)
    for k in order:
        (panel, number), owner = free[k], owners[k]
        if owner in owned:
            continue
        of = detections[panel]
        birth = _birth(
            of.measured[number], float(of.power[number]), panel, panels, road, ambiguity_mps, per_unit, bodies
        )
        if birth is None:
            continue
        if owner is None:
            taken, inner = _taken(birth, there, float(of.measured[number, 1]))
            within[inner[inner < len(tracks)]] = True
            if taken:
                continue
        born.append((birth, owner))
        there.append(np.concatenate([birth.state, birth.ahead]))
        if owner is not None:
            owned.add(owner)
    return born, within


def _birth(
    measured: Array, power: float, panel: int, panels: Panels, road: RoadMap, ambiguity_mps: float, per_unit: Array,
    bodies: bool,
) -> Birth | None:  # fmt: skip
    """Return the track that a detection begins; None if it is not on a road, or its speed cannot be told."""
    sine, distance, radial = measured.tolist()
    height, right, front = float(panels.height_m[panel]), panels.right[panel], panels.front[panel]
    beside = distance * sine
    ahead_squared = distance**2 - height**2 - beside**2
    if ahead_squared <= 0 or distance < abs(height) + LEAST_GROUND_M:
        return None
    ground = beside * right + np.sqrt(ahead_squared) * front
    position = np.array([panels.x[panel], panels.y[panel]]) + ground
    for direction in road.directions(position):
        cosine = float(direction @ ground) / distance
        if abs(cosine) < LEAST_COSINE:
            continue
        speeds = [(radial + turns * ambiguity_mps) / cosine for turns in (0, -1, 1)]
        slack = 1.0 / per_unit[2] / abs(cosine)
        speed = next((value for value in speeds if -slack <= value <= FASTEST_MPS), None)
        if speed is None:
            continue
        state = np.concatenate([position, max(speed, 0.0) * direction, np.zeros(3)])
        sight = ground / np.hypot(*ground)
        cross = np.array([-sight[1], sight[0]])
        squareness = max(float(front @ sight), 0.3)
        sd_along = BIRTH_CELLS / per_unit[1] * distance / float(np.hypot(*ground))
        sd_cross = BIRTH_CELLS / per_unit[0] * distance / squareness
        covariance = np.zeros((7, 7))
        covariance[:2, :2] = np.outer(sight, sight) * sd_along**2 + np.outer(cross, cross) * sd_cross**2
        speed_sd = BIRTH_CELLS / per_unit[2] / abs(cosine) + 0.5
        covariance[2:4, 2:4] = np.outer(direction, direction) * speed_sd**2 + np.eye(2) * 0.8**2
        covariance[4:6, 4:6] = np.eye(2) * 1.5**2
        if bodies:
            # The end that faces the panel answers.
            behind = 1.0 if cosine > 0 else 0.0
            state[6], covariance[6, 6] = CAR_M, CAR_SD_M**2
            state[:2] += behind * CAR_M * direction
            covariance[:2, :2] += np.eye(2) * END_SD_M**2 + behind * CAR_SD_M**2 * np.outer(direction, direction)
            covariance[:2, 6] = covariance[6, :2] = behind * CAR_SD_M**2 * direction
        return Birth(state, covariance, direction, power, position)
    return None


def _taken(birth: Birth, states: Sequence[Array], distance: float) -> tuple[bool, IntArray]:
    """Return whether a track is there already, and the tracks within whose bodies the detection is.

    states: with the heading, (9,) each. distance: from the panel, m.
    """
    if not states:
        return False, np.empty(0, np.int64)
    there = np.array(states)
    ahead, apart, length = there[:, 7:], birth.place - there[:, :2], there[:, 6]
    along = (ahead * apart).sum(axis=1)
    across = np.abs(ahead[:, 0] * apart[:, 1] - ahead[:, 1] * apart[:, 0])
    beyond = np.maximum(along, -length - along)
    alike = np.abs((there[:, 2:4] - birth.state[2:4])[:, None] @ ahead[..., None])[:, 0, 0] < WITHIN_MPS
    inner = (beyond < -WITHIN_M) & (across < TWIN_ACROSS_M) & alike
    widest = np.where(length > 0, BODY_ACROSS_M, APART_ACROSS_M) + np.where(
        length > LONG_M, HIGH_ACROSS_M2 / distance, 0
    )
    taken = bool(((beyond < APART_ALONG_M) & (across < np.maximum(widest, APART_SHARE * distance))).any())
    return taken, np.flatnonzero(inner)


def without_doubles(tracks: Tracks, bodies: bool) -> Tracks:
    """Return the tracks without those that are of the same vehicle as another one.

    Of two that lie on each other, one ends: the younger, or the older if far fewer panels find that. So does one that
    looks like the other end of an older one's vehicle, whose length then reaches from end to end; if it later
    turns out that the length is not constant, they were two vehicles, and the length is a car's again.
    """
    if not len(tracks):
        return tracks
    twin, beside, other = np.zeros(len(tracks), np.int64), np.zeros(len(tracks), np.int64), np.full(len(tracks), -1)
    state, covariance, joined_m = tracks.state.copy(), tracks.covariance.copy(), tracks.joined_m.copy()
    middle, length, velocity = tracks.middle, state[:, 6], state[:, 2:4]
    ended = np.zeros(len(tracks), dtype=bool)
    joined_for = tracks.joined_for + (joined_m > 0)
    settling = (joined_m > 0) & (joined_for <= SETTLING_STEPS)
    joined_m[settling] = length[settling]
    wrong = (joined_m > 0) & ((np.abs(length - joined_m) > JOINED_CHANGE_M) | (tracks.within > MOST_WITHIN))
    state[wrong, 6], covariance[wrong, 6, :], covariance[wrong, :, 6] = CAR_M, 0.0, 0.0
    covariance[wrong, 6, 6], joined_m[wrong] = CAR_SD_M**2, 0.0
    reach = FARTHEST_END_M if bodies else TWIN_ALONG_M + TWIN_ACROSS_M
    pairs = cKDTree(middle).query_pairs(reach) if len(tracks) > 1 else set()
    for one, two in sorted((min(pair), max(pair)) for pair in pairs):
        if ended[one] or ended[two]:
            continue
        ahead, apart = tracks.ahead[one], middle[two] - middle[one]
        along, across = float(ahead @ apart), abs(float(ahead[0] * apart[1] - ahead[1] * apart[0]))
        width = (LONG_WIDTH_M if length[one] > LONG_M else CAR_WIDTH_M) / 2 + CAR_WIDTH_M / 2 + CLEARANCE_M
        if across > (width if bodies and tracks.hits[two] < YOUNG_HITS else TWIN_ACROSS_M):
            continue
        on_top = abs(along) < (length[one] / 2 + 1.0 if bodies else TWIN_ALONG_M)
        if on_top:
            better = tracks.confirmed[two] and tracks.answered[two] > tracks.answered[one] + ANSWERED_LESS
            worse = one if better else two
            twin[worse] = tracks.twin[worse] + 1
            ended[worse] = twin[worse] > (TWIN_STEPS if tracks.confirmed[worse] else TENTATIVE_TWIN_STEPS)
        if not bodies or ended[one] or ended[two]:
            continue
        speed = float(np.hypot(*velocity[one]))
        alike = abs(float((velocity[two] - velocity[one]) @ ahead)) < ALIKE_MPS
        if not alike or abs(along) > FOLLOWER_M + FOLLOWER_S * speed or beside[two]:
            continue
        same = tracks.other[two] == tracks.number[one]
        beside[two], other[two] = (tracks.beside[two] if same else 0) + 1, tracks.number[one]
        if beside[two] <= END_STEPS:
            continue
        ended[two] = True
        front = max(length[one] / 2, along + length[two] / 2)
        whole = front - min(-length[one] / 2, along - length[two] / 2)
        if max(length[one], LONG_M) < whole < LONGEST_M:
            state[one, :2] = middle[one] + front * ahead
            state[one, 6] = joined_m[one] = whole
            joined_for[one] = 0
            covariance[one, :2, :2] += np.eye(2) * 0.5
            covariance[one, 6, 6] += 1.0
    kept = replace(
        tracks,
        state=state,
        covariance=covariance,
        twin=twin,
        joined_m=joined_m,
        joined_for=joined_for,
        beside=beside,
        other=other,
    )
    return kept.take(~ended)
