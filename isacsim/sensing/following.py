"""Sensors that make fixes of each TV, and the Kalman filters that turn fixes into states, many at a time.

The filter is causal. Fed whole passages, or piece by piece, it gives what one gives that is fed fix by fix.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.sensing.passages import NOTHING, Passage, Piece, SensedPiece, SensedRecord, WatchedTraffic
from isac_cosim.isacsim.tracking import kalman
from isac_cosim.isacsim.tracking.fusion import Fixes
from isac_cosim.isacsim.tracking.kalman import FilteredStates, TrackingSettings

TOGETHER = 96
"""Passages filtered at once: enough to make the filter cheap."""
MOST_SNAPSHOTS = 800_000
"""Most snapshots whose fixes wait until their passages are filtered: their covariances take 100 MB."""
MOST_INSTANTS = 256
"""Most instants that are filtered at once: the fixes of TOGETHER passages at them fit into a processor's cache."""


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
    fixes: Sequence[Fixes], rate_hz: float, settings: TrackingSettings, before: FilteredStates | None = None
) -> FilteredStates:
    """Filter the fixes of several vehicles together; those with fewer than the others go on without fixes.

    before: what came of the fixes before these, of the same vehicles.
    """
    longest = max(len(part.valid) for part in fixes)
    # By instant, as the filter goes through them.
    state = np.zeros((longest, len(fixes), 4))
    covariance = np.empty((longest, len(fixes), 4, 4))
    covariance[:] = np.eye(4)
    valid = np.zeros((longest, len(fixes)), dtype=bool)
    for row, part in enumerate(fixes):
        length = len(part.valid)
        state[:length, row], covariance[:length, row], valid[:length, row] = part.state, part.covariance, part.valid
    return kalman.track(state.swapaxes(0, 1), covariance.swapaxes(0, 1), valid.T, 1 / rate_hz, settings, before)


def states_of(fixes: Sequence[Fixes], rate_hz: float, settings: TrackingSettings) -> list[Array]:
    """Return the filtered states of several vehicles, x, y, vx, vy, ax, ay, (6, S) of each."""
    states = [np.empty((6, len(of.valid))) for of in fixes]
    # A step costs much the same, however many vehicles there are: those of about the same length go together.
    longest_first = sorted(range(len(fixes)), key=lambda number: -len(fixes[number].valid))
    for first in range(0, len(fixes), TOGETHER):
        going = longest_first[first : first + TOGETHER]
        tracks: FilteredStates | None = None
        for begin in range(0, len(fixes[going[0]].valid), MOST_INSTANTS):
            piece = slice(begin, begin + MOST_INSTANTS)
            going = [number for number in going if len(fixes[number].valid) > begin]
            before = None if tracks is None else tracks.first(len(going))
            tracks = filtered([fixes[number].part(piece) for number in going], rate_hz, settings, before)
            for row, number in enumerate(going):
                part = states[number][:, piece]
                part[:] = tracks.state[row, : part.shape[1]].T
    return states


@dataclass(frozen=True)
class Observed:
    """Fixes of one passage, run-in included, and what they rest on; see SensedRecord."""

    fixes: Fixes
    n_sites: int
    snr_db: float
    detected: float
    usable: bool


class FixPicture(ABC):
    """A picture by fixes of one TV at a time. least: share of a piece's snapshots that must locate a TV at first."""

    def __init__(self, traffic: WatchedTraffic, tracking: TrackingSettings, least: float = 0.0) -> None:
        self.traffic, self._tracking, self._least = traffic, tracking, least
        self._tracks: dict[str, tuple[Array, Array, int]] = {}

    @abstractmethod
    def observed(self, passage: Passage, approach: Approach) -> Observed:
        """Return the fixes of a passage."""

    @abstractmethod
    def fixes(self, piece: Piece, uv_of: Mapping[str, str]) -> dict[str, Fixes]:
        """Return the fixes of the TVs that can be sensed over a piece; the tracks of all others end."""

    def record(self, passages: Sequence[Passage]) -> list[SensedRecord]:
        """Sense passages, and filter their fixes. Those that cannot be used have a state of zeros."""
        rate_hz = self.traffic.rate_hz
        approaches = [Approach.of(passage, rate_hz, self._tracking) for passage in passages]
        observed = [self.observed(*pair) for pair in zip(passages, approaches, strict=True)]
        states = iter(states_of([of.fixes for of in observed if of.usable], rate_hz, self._tracking))
        records = []
        for approach, of in zip(approaches, observed, strict=True):
            state = next(states) if of.usable else np.zeros((6, len(of.fixes.valid)))
            fixes = np.ascontiguousarray(of.fixes.state[approach.before :].T)
            records.append(
                SensedRecord(state[:, approach.before :], fixes, of.n_sites, of.snr_db, of.detected, of.usable)
            )
        return records

    def step(self, piece: Piece, uv_of: Mapping[str, str]) -> SensedPiece:
        """Sense the TVs over a piece, and go on with their tracks, or begin them."""
        fixes = self.fixes(piece, uv_of)
        self._tracks = {name: track for name, track in self._tracks.items() if name in fixes}
        known = [name for name in fixes if name in self._tracks]
        fresh = [
            name
            for name, of in fixes.items()
            if name not in known and of.valid.any() and of.valid.mean() >= self._least
        ]
        states: dict[str, Array] = {}
        for names, before in ((known, self._latest(known)), (fresh, None)):
            if not names:
                continue
            # The first fix of a new track stands for the instants before it.
            parts = [fixes[name] if before else filled(fixes[name]) for name in names]
            tracks = filtered(parts, self.traffic.rate_hz, self._tracking, before)
            for row, name in enumerate(names):
                self._tracks[name] = tracks.state[row, -1], tracks.covariance[row], int(tracks.refused[row])
                states[name] = tracks.state[row].T
        followed = tuple(name for name in fixes if name in states)
        return SensedPiece(followed, np.stack([states[name] for name in followed])) if followed else NOTHING

    def _latest(self, names: Sequence[str]) -> FilteredStates | None:
        if not names:
            return None
        state, covariance, refused = zip(*(self._tracks[name] for name in names), strict=True)
        latest = np.stack(state)[:, None]
        return FilteredStates(latest, np.stack(covariance), np.zeros(latest.shape[:2]), np.array(refused, np.int64))
