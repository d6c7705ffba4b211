"""What the network knew of an episode: its tracks at every instant, and whose they really were."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.isacsim.scene.scores import SceneScores

TAKEN_UP_M = 5.0
"""A lost track is taken up again by another one so near to where the vehicle should be, m."""


@dataclass(frozen=True)
class TrackedInstant:
    """The tracks that count at one instant, all arrays by track in ascending number.

    number: (T,). state: x, y, vx, vy, ax, ay, (T, 6). covariance: of the position, m², (T, 2, 2). looked, found: panels
    that look for it, and that found it. snr_db: mean per-element SNR of what they found, dB, NaN without. vehicle: name
    of the one that it is of, or None.
    """

    number: IntArray
    state: Array
    covariance: Array
    looked: IntArray
    found: IntArray
    snr_db: Array
    vehicle: tuple[str | None, ...]

    @property
    def position_sd_m(self) -> Array:
        """Root of the trace of the position's covariance, (T,)."""
        return np.asarray(np.sqrt(np.trace(self.covariance, axis1=1, axis2=2)))


@dataclass(frozen=True)
class FollowedVehicle:
    """What the network took for one vehicle over a while.

    track: number of the track at the beginning. state: (6, S). right_share: share of the instants at which what was
    followed was that vehicle's track. breaks: how often it was lost and another one taken up. position_sd_m: median of
    the track's own statement. n_sites: fewest panels that looked for it. detected: share of the looks that found it.
    snr_db: mean over what was found.
    """

    track: int
    state: Array
    right_share: float
    breaks: int
    position_sd_m: float
    n_sites: int
    detected: float
    snr_db: float


@dataclass
class SceneTracks:
    """The tracks of an episode by the number of the instant. scores: of the whole episode."""

    fixes_hz: float
    instants: dict[int, TrackedInstant] = field(default_factory=dict)
    scores: SceneScores = field(default_factory=SceneScores)

    def fix_before(self, time_s: float) -> int:
        """Return the number of the latest instant that is not after a time, s."""
        return int(np.floor(time_s * self.fixes_hz + 1e-6))

    def held(self, vehicle: str, times: Array, watched: BoolArray, lost_s: float) -> BoolArray:
        """Return at which times, s, (S,), the network has something that it takes for a vehicle, (S,).

        watched: when it looks for the vehicle, (S,). From when on the vehicle has a track, that is followed, whatever
        becomes of it. Where it has been lost for longer than lost_s, s, there is nothing until the vehicle has a track.
        """
        result = np.zeros(len(times), dtype=bool)
        number = np.floor(times * self.fixes_hz + 1e-6).astype(np.int64)
        follower: Follower | None = None
        for k, (fix, here) in enumerate(zip(number.tolist(), watched.tolist(), strict=True)):
            if not here:
                follower = None
                continue
            follower = follower or self.follower(vehicle, fix)
            if follower is not None:
                follower.go_on(fix)
                follower = None if follower.lost_for > lost_s * self.fixes_hz else follower
            result[k] = follower is not None
        return result

    def followed(self, vehicle: str, times: Array) -> FollowedVehicle | None:
        """Return what the network takes for a vehicle, (S,) instants in s; None if it has no track of it at first.

        The track that is the vehicle's at the first instant is followed, whatever becomes of it. Between instants it is
        predicted. Where it ends, it is predicted on until another one is near, which is taken up.
        """
        follower = self.follower(vehicle, self.fix_before(float(times[0])))
        return None if follower is None else follower.summary(follower.states(times))

    def follower(self, vehicle: str, fix: int) -> Follower | None:
        """Return what follows the track that is a vehicle's at an instant; None if it has none."""
        first = self.instants.get(fix)
        if first is None or vehicle not in first.vehicle:
            return None
        return Follower(self, int(first.number[first.vehicle.index(vehicle)]), vehicle)


class Follower:
    """Follows one track, and takes up another where it ends."""

    def __init__(self, tracks: SceneTracks, track: int, vehicle: str) -> None:
        self._tracks, self._vehicle = tracks, vehicle
        self._first = self._track = track
        self._state, self._fix = np.zeros(6), -1
        self._right: list[bool] = []
        self._tracked: list[bool] = []
        self._sd: list[float] = []
        self._looked: list[int] = []
        self._found: list[int] = []
        self._snr: list[float] = []
        self._breaks = 0

    @property
    def lost_for(self) -> int:
        """Number of instants in a row, up to the latest, without a track."""
        return next((k for k, looked in enumerate(reversed(self._tracked)) if looked), len(self._tracked))

    def states(self, times: Array) -> Array:
        """Return the state at times, s, (S,), predicted from the latest instant before each, (6, S)."""
        fixes_hz = self._tracks.fixes_hz
        number = np.floor(times * fixes_hz + 1e-6).astype(np.int64)
        state = np.empty((6, len(times)))
        begins = np.flatnonzero(np.diff(number, prepend=number[0] - 1))
        for begin, end in zip(begins.tolist(), [*begins[1:].tolist(), len(times)], strict=True):
            fix = int(number[begin])
            self.go_on(fix)
            state[:, begin:end] = predicted(self._state, times[begin:end] - fix / fixes_hz)
        return state

    def go_on(self, fix: int) -> None:
        """Go on to an instant, unless that is the latest one. Instants come in order."""
        if fix == self._fix:
            return
        instant = self._tracks.instants.get(fix)
        row = None if instant is None else self._row(instant, fix)
        if instant is None or row is None:
            gap_s = (fix - self._fix) / self._tracks.fixes_hz
            # What the vehicle did when it was lost soon says nothing of what it does.
            self._state = predicted(np.concatenate([self._state[:4], np.zeros(2)]), np.array([gap_s]))[:, 0]
            self._right.append(False)
            self._tracked.append(False)
            self._looked.append(0)
            self._found.append(0)
        else:
            self._state = instant.state[row]
            self._tracked.append(True)
            self._right.append(instant.vehicle[row] == self._vehicle)
            self._sd.append(float(instant.position_sd_m[row]))
            self._looked.append(int(instant.looked[row]))
            self._found.append(int(instant.found[row]))
            self._snr.append(float(instant.snr_db[row]))
        self._fix = fix

    def _row(self, instant: TrackedInstant, fix: int) -> int | None:
        """Return the row of the track; of the nearest one, if it has ended and another is near; or None."""
        row = int(np.searchsorted(instant.number, self._track))
        if row < len(instant.number) and instant.number[row] == self._track:
            return row
        if not len(instant.number):
            return None
        gap_s = (fix - self._fix) / self._tracks.fixes_hz
        apart = np.hypot(*(instant.state[:, :2] - self._state[:2] - gap_s * self._state[2:4]).T)
        nearest = int(apart.argmin())
        if apart[nearest] > TAKEN_UP_M:
            return None
        self._track = int(instant.number[nearest])
        self._breaks += 1
        return nearest

    def summary(self, state: Array) -> FollowedVehicle:
        """Return what was followed so far. state: of it."""
        snr = [value for value in self._snr if np.isfinite(value)]
        return FollowedVehicle(
            self._first,
            state,
            right_share=float(np.mean(self._right)),
            breaks=self._breaks,
            position_sd_m=float(np.median(self._sd)),
            n_sites=min(self._looked),
            detected=sum(self._found) / max(sum(self._looked), 1),
            snr_db=float(np.mean(snr)) if snr else float("nan"),
        )


def predicted(state: Array, after_s: Array) -> Array:
    """Return a state, (6,), at times after its own, s, (S,), with constant acceleration, (6, S)."""
    position, velocity, acceleration = (state[k : k + 2, None] for k in (0, 2, 4))
    return np.concatenate(
        [
            position + velocity * after_s + acceleration * after_s**2 / 2,
            velocity + acceleration * after_s,
            np.broadcast_to(acceleration, (2, len(after_s))),
        ]
    )
