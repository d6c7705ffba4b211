"""What sensors are asked about, and what they answer.

A sensor watches the traffic of one episode. Then it is asked about passages, in which one vehicle's motion is known
from beginning to end, or about pieces of a world that runs, which hold all vehicles for a moment.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.radio.blockage import Blockers, blockers_of
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.isacsim.sensing.reports import ReportSettings
from isac_cosim.isacsim.traffic.motion import MotionSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording


@dataclass(frozen=True)
class Carrier:
    """Motion of the UV that carries a radar, and how well the UV knows its own.

    state: true x, y, vx, vy, ax, ay, m, m/s, m/s2, (6, C) at rate_hz from the passage's start on; NaN where no UV is
    there. reported: the same as the UV reports it, None if it reports the truth. position_sd_m, speed_sd_mps: standard
    deviations of the reports' white noise on either axis. vehicles: names of the UVs, one after the other.
    """

    state: Array
    rate_hz: float
    reported: Array | None = None
    position_sd_m: float = 0.0
    speed_sd_mps: float = 0.0
    vehicles: tuple[str, ...] = ()


@dataclass(frozen=True)
class Passage:
    """A TV over an interval in which its true motion is known: a stored record, or a stretch of a recording.

    tv: its name. start_s: the first instant, s of simulation time. truth: x, y, vx, vy, ax, ay, m, m/s, m/s2, (6, S) at
    the rate of the traffic. key: seeds every draw. past: true states just before, (6, P), where they are known.
    acquired: whether the sensor meets the vehicle at start_s, so that its filter settles within the passage; it has
    known a vehicle that is not acquired before. find_carrier: gives the motion of the UV, None without one.
    """

    tv: str
    start_s: float
    truth: Array
    key: tuple[str | int, ...]
    past: Array | None = None
    acquired: bool = False
    find_carrier: Callable[[], Carrier | None] = lambda: None

    @cached_property
    def carrier(self) -> Carrier | None:
        """The UV; found when a sensor asks for it, because not every sensor does."""
        return self.find_carrier()


@dataclass(frozen=True)
class TrackUse:
    """Which of the network's tracks stands for a TV in a passage, and how well.

    track_id: of the one at the beginning. right_share: share of the passage in which what was followed was the TV.
    breaks: how often it was lost and another one taken up. position_sd_m: median of the track's own statement, m.
    """

    track_id: str
    right_share: float
    breaks: int
    position_sd_m: float


@dataclass(frozen=True)
class SensedRecord:
    """What a sensor knows of one passage.

    state: x, y, vx, vy, ax, ay after the filter, (6, S). fixes: x, y, vx, vy before it, (4, S); a snapshot without a
    detection repeats the fix before it. n_sites: fewest sites assigned at any snapshot; 0 for a sensor that uses none,
    and for a vehicle that was not located before the record. snr_db: per-element SNR, mean over the record and its
    sites. detected: share of the echoes that were detected. usable: whether the sensor could follow the vehicle;
    otherwise state and fixes mean nothing. track: of a sensor that does not know who is who, None of others.
    """

    state: Array
    fixes: Array
    n_sites: int
    snr_db: float
    detected: float
    usable: bool
    track: TrackUse | None = None


@dataclass(frozen=True)
class Piece:
    """The motion of the vehicles over one interval of the clock of a world that runs.

    end_s: its end, s. names: of the vehicles whose motion is known throughout, V. tv, uv: their x, y, vx, vy, ax, ay at
    the two rates over the interval, its beginning excluded, (V, 6, m), m, m/s, m/s2. lanes: who is where at the end.
    """

    end_s: float
    names: tuple[str, ...]
    tv: Array
    uv: Array
    lanes: Recording

    @cached_property
    def place(self) -> dict[str, int]:
        """The place of each vehicle among `names`."""
        return {name: k for k, name in enumerate(self.names)}

    def others(self, without: Collection[str]) -> Blockers:
        """Return the vehicles except those named, where they are in the middle of the piece."""
        known = [name for name in self.names if name not in without]
        middle = self.tv[[self.place[name] for name in known]][:, :, self.tv.shape[2] // 2]
        speed = np.maximum(np.hypot(middle[:, 2], middle[:, 3]), 1e-9)
        heading = middle[:, 2:4] / speed[:, None]
        tracks = [self.lanes.tracks[name] for name in known]
        return Blockers.of(tracks, 1.0, middle[:, :1], middle[:, 1:2], heading[:, None])


@dataclass(frozen=True)
class SensedPiece:
    """The TVs that a sensor followed over a piece. state: x, y, vx, vy, ax, ay at the TV's rate, (B, 6, m)."""

    names: tuple[str, ...]
    state: Array


NOTHING = SensedPiece((), np.empty((0, 6, 0)))
"""No TV is followed."""


@dataclass(frozen=True)
class WatchedTraffic:
    """The episode that a sensor watches: the traffic of one scenario and seed.

    rate_hz: snapshots of a TV per second. report: how well the UVs know themselves. recording: the motion of all
    vehicles; None while the traffic runs, or where only records of it are stored. motion: how that is conditioned.
    """

    scenario: str
    seed: int
    sites: Sequence[Site]
    rate_hz: float
    report: ReportSettings = field(default_factory=ReportSettings)
    recording: Recording | None = None
    motion: MotionSettings = field(default_factory=MotionSettings)

    def others(self, passage: Passage, without: Collection[str], run_in_s: float) -> Blockers | None:
        """Return the vehicles during a passage except those named; None where only the passage itself is known.

        run_in_s: of the filter. Where it is a part of the passage, the vehicles stand until it ends as they do then.
        """
        if self.recording is None:
            return None
        inside_s, before_s = (run_in_s, 0.0) if passage.acquired else (0.0, run_in_s)
        end_s = passage.start_s + passage.truth.shape[1] / self.rate_hz
        return blockers_of(self.recording, passage.start_s + inside_s, end_s, without, self.motion, run_in_s=before_s)
