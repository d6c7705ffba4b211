"""The Kalman filters behind the sensors: of whole passages, many at a time, and of TVs followed from piece to piece.

The filter is causal. Fed whole passages, or piece by piece, it gives what one gives that is fed fix by fix
(`isacsim.tracking.streaming`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.sensing.passages import NOTHING, Passage, SensedPiece
from isac_cosim.isacsim.tracking import kalman
from isac_cosim.isacsim.tracking.fusion import Fixes
from isac_cosim.isacsim.tracking.kalman import TrackingSettings, Tracks

TOGETHER = 96
"""Passages filtered at once: enough to make the filter cheap, few enough to keep their covariances small in memory."""
MOST_SNAPSHOTS = 400_000
"""Most snapshots that are filtered at once: their covariances take 50 MB."""


@dataclass(frozen=True)
class Approach:
    """The motion of a passage as a filter meets it, with the run-in in which the filter settles.

    motion: x, y, vx, vy, ax, ay, (6, S). run_in: number of instants in the run-in. before: how many of these are not in
    the passage. carried: how many, the first ones, do not have the vehicle's own motion and heading.
    """

    motion: Array
    run_in: int
    before: int
    carried: int

    @classmethod
    def of(cls, passage: Passage, rate_hz: float, settings: TrackingSettings) -> Approach:
        """Return a passage with the run-in of a filter."""
        count = run_in_snapshots(rate_hz, settings)
        if passage.acquired:
            return cls(passage.truth, count, 0, count)
        known = 0 if passage.past is None else min(passage.past.shape[1], count)
        motion = np.concatenate([run_in(passage.truth, rate_hz, count, passage.past), passage.truth], axis=1)
        return cls(motion, count, count, count - known)

    def time_s(self, rate_hz: float) -> Array:
        """Return the time of each instant from the end of the run-in on, s, (S,)."""
        return (np.arange(self.motion.shape[1]) - self.run_in) / rate_hz


def run_in_snapshots(rate_hz: float, settings: TrackingSettings) -> int:
    """Number of snapshots in the filter's run-in, which are sensed before a record begins."""
    return round(settings.run_in_s * rate_hz)


def run_in(truth: Array, rate_hz: float, count: int, past: Array | None = None) -> Array:
    """The motion in the run-in of a record: its true past, and what is not known of it carried back.

    truth: (..., 6, S) at rate_hz. count: snapshots of the run-in. past: true states just before the record,
    (..., 6, P), where they are known. Returns (..., 6, count).
    """
    if past is None or not past.shape[-1] or not count:
        return before(truth, rate_hz, count)
    known = past[..., -count:]
    return np.concatenate([before(known, rate_hz, count - known.shape[-1]), known], axis=-1)


def before(truth: Array, rate_hz: float, count: int) -> Array:
    """The motion before a record: its first state carried back at constant acceleration.

    truth: (..., 6, S) at rate_hz. count: snapshots to go back. Returns (..., 6, count).
    """
    time = (np.arange(count) - count) / rate_hz
    position, velocity, acceleration = (truth[..., k : k + 2, :1] for k in (0, 2, 4))
    return np.concatenate(
        [
            position + velocity * time + acceleration * time**2 / 2,
            velocity + acceleration * time,
            np.broadcast_to(acceleration, (*acceleration.shape[:-1], count)),
        ],
        axis=-2,
    )


def filled(fixes: Fixes) -> Fixes:
    """Fill missing fixes with the latest one before them, or, at the start, with the first one.

    Covariance and `valid` stay as they are, and so still say that nothing was measured there.
    """
    latest = np.maximum.accumulate(np.where(fixes.valid, np.arange(len(fixes.valid)), -1))
    latest = np.where(latest < 0, int(np.argmax(fixes.valid)), latest)
    return Fixes(fixes.state[latest], fixes.covariance, fixes.valid)


def filtered(
    fixes: Sequence[Fixes], rate_hz: float, settings: TrackingSettings, before: Tracks | None = None
) -> Tracks:
    """Filter the fixes of several vehicles together; those with fewer than the others go on without fixes.

    before: what came of the fixes before these, of the same vehicles.
    """
    longest = max(len(part.valid) for part in fixes)
    state = np.zeros((len(fixes), longest, 4))
    covariance = np.tile(np.eye(4), (len(fixes), longest, 1, 1))
    valid = np.zeros((len(fixes), longest), dtype=bool)
    for row, part in enumerate(fixes):
        length = len(part.valid)
        state[row, :length], covariance[row, :length], valid[row, :length] = part.state, part.covariance, part.valid
    return kalman.track(state, covariance, valid, 1 / rate_hz, settings, before)


def states_of(fixes: Sequence[Fixes], rate_hz: float, settings: TrackingSettings) -> list[Array]:
    """Return the filtered states of several vehicles, x, y, vx, vy, ax, ay, (6, S) of each."""
    states: list[Array] = []
    while len(states) < len(fixes):
        part = _together(fixes[len(states) :])
        tracks = filtered(part, rate_hz, settings).state
        states += [np.ascontiguousarray(tracks[row, : len(of.valid)].T) for row, of in enumerate(part)]
    return states


def _together(fixes: Sequence[Fixes]) -> Sequence[Fixes]:
    """Return as many of the first vehicles as are filtered at once; all are as long as the longest then."""
    longest = np.maximum.accumulate([len(of.valid) for of in fixes[:TOGETHER]])
    return fixes[: max(1, int(np.sum(longest * np.arange(1, len(longest) + 1) <= MOST_SNAPSHOTS)))]


@dataclass
class Filters:
    """The Kalman filters of the TVs that are followed from piece to piece. rate_hz: of the fixes."""

    rate_hz: float
    settings: TrackingSettings
    _of: dict[str, tuple[Array, Array, int]] = field(default_factory=dict)

    def __contains__(self, name: str) -> bool:
        return name in self._of

    def forget_all_but(self, names: Collection[str]) -> None:
        """End the tracks of all TVs but these."""
        self._of = {name: state for name, state in self._of.items() if name in names}

    def follow(self, fixes: dict[str, Fixes]) -> SensedPiece:
        """Continue the tracks of some TVs by their fixes over one piece, or begin them."""
        states: dict[str, Array] = {}
        known = [name for name in fixes if name in self._of]
        fresh = [name for name in fixes if name not in self._of]
        for names, earlier in ((known, self._before(known)), (fresh, None)):
            if not names:
                continue
            # The first fix of a new track stands for the instants before it.
            parts = [fixes[name] if earlier else filled(fixes[name]) for name in names]
            tracks = filtered(parts, self.rate_hz, self.settings, earlier)
            for row, name in enumerate(names):
                self._of[name] = tracks.state[row, -1], tracks.covariance[row], int(tracks.refused[row])
                states[name] = tracks.state[row].T
        return SensedPiece(tuple(fixes), np.stack([states[name] for name in fixes])) if fixes else NOTHING

    def _before(self, names: Sequence[str]) -> Tracks | None:
        if not names:
            return None
        state, covariance, refused = zip(*(self._of[name] for name in names), strict=True)
        latest = np.stack(state)[:, None]
        return Tracks(latest, np.stack(covariance), np.zeros(latest.shape[:2]), np.array(refused, np.int64))
