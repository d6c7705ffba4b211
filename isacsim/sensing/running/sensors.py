"""What senses the TVs of a running simulation, a piece at a time: the sites, the onboard radar of the UV, or the truth.

Every sensor continues its tracks from piece to piece; a filter that is fed piece by piece gives what one that is fed
fix by fix gives (`isacsim.tracking.streaming`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.isacsim.heading import heading_rad
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.blockage import CAR_HEIGHT_M, HIGH_KINDS, TRUCK_HEIGHT_M, Blockers
from isac_cosim.isacsim.radio.channel import EchoGeometry, snr_db
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.sensing.chain import CONFIRMED, LEAST_SITES, SensingSettings, assign, filled, fused
from isac_cosim.isacsim.sensing.onboard_radar import Pose, RadarSettings, scan
from isac_cosim.isacsim.sensing.reports import ReportSettings
from isac_cosim.isacsim.sensing.running.world import Piece, Vehicle, numbers
from isac_cosim.isacsim.tracking import kalman
from isac_cosim.isacsim.tracking.fusion import Fixes
from isac_cosim.isacsim.tracking.kalman import TrackingSettings, Tracks


@dataclass(frozen=True)
class Sensed:
    """The TVs that a sensor followed over a piece. state: x, y, vx, vy, ax, ay at tv_rate_hz, (B, 6, m)."""

    names: tuple[str, ...]
    state: Array


NOTHING = Sensed((), np.empty((0, 6, 0)))


class Sensor(Protocol):
    """Follows TVs from piece to piece. A TV that it does not return for a piece begins anew when it comes back."""

    def sense(self, piece: Piece, uv_of: Mapping[str, str]) -> Sensed:
        """Sense the TVs of a piece. uv_of: the TVs, each with the UV that is ahead of it now."""


@dataclass
class TruthSensor:
    """Knows the motion itself, wherever the vehicle is."""

    def sense(self, piece: Piece, uv_of: Mapping[str, str]) -> Sensed:
        names = tuple(name for name in piece.names if name in uv_of)
        return Sensed(names, piece.tv[numbers(piece.names, names)])


@dataclass
class Filters:
    """The Kalman filters of the TVs that are followed. rate_hz: of the fixes."""

    rate_hz: float
    settings: TrackingSettings
    _of: dict[str, tuple[Array, Array, int]] = field(default_factory=dict)

    def __contains__(self, name: str) -> bool:
        return name in self._of

    def forget_all_but(self, names: Sequence[str]) -> None:
        """End the tracks of all TVs but these."""
        kept = set(names)
        self._of = {name: state for name, state in self._of.items() if name in kept}

    def follow(self, names: Sequence[str], fixes: Sequence[Fixes]) -> Sensed:
        """Continue the tracks of some TVs by their fixes over one piece, or begin them."""
        known = [k for k, name in enumerate(names) if name in self._of]
        fresh = [k for k, name in enumerate(names) if name not in self._of]
        states: dict[int, Array] = {}
        for chosen, before in ((known, self._before([names[k] for k in known])), (fresh, None)):
            if not chosen:
                continue
            # The first fix of a new track stands for the instants before it.
            parts = [fixes[k] if before else filled(fixes[k]) for k in chosen]
            tracks = kalman.track(
                np.stack([part.state for part in parts]),
                np.stack([part.covariance for part in parts]),
                np.stack([part.valid for part in parts]),
                1 / self.rate_hz,
                self.settings,
                before,
            )
            for row, k in enumerate(chosen):
                self._of[names[k]] = tracks.state[row, -1], tracks.covariance[row], int(tracks.refused[row])
                states[k] = tracks.state[row].T
        if not names:
            return NOTHING
        return Sensed(tuple(names), np.stack([states[k] for k in range(len(names))]))

    def _before(self, names: Sequence[str]) -> Tracks | None:
        if not names:
            return None
        state, covariance, refused = zip(*(self._of[name] for name in names), strict=True)
        before = np.stack(state)[:, None]
        return Tracks(before, np.stack(covariance), np.zeros(before.shape[:2]), np.array(refused, np.int64))


@dataclass
class IsacSensor:
    """The sites: echoes of every snapshot at the panels in view, fused and filtered. Fewer than two sites: a gap.

    seed: of the traffic. rate_hz: snapshots per second. vehicles: all that the world knows, for blockage.
    """

    scenario: Scenario
    seed: int
    settings: SensingSettings
    rate_hz: float
    vehicles: Mapping[str, Vehicle]

    def __post_init__(self) -> None:
        self._panels = Panels.of(self.scenario.sites, self.settings.target_height_m)
        self._filters = Filters(self.rate_hz, self.settings.tracking)
        self._acquired: dict[str, str] = {}

    def sense(self, piece: Piece, uv_of: Mapping[str, str]) -> Sensed:
        names = [name for name in piece.names if name in uv_of]
        motion = piece.tv[numbers(piece.names, names)]
        slots = [assign(states[:2].T, self.rate_hz, self._panels, self.settings.view) for states in motion]
        seen = [k for k, slot in enumerate(slots) if (slot >= 0).sum(axis=1).min() >= LEAST_SITES]
        self._forget_all_but([names[k] for k in seen])
        if not seen:
            return NOTHING
        for k in seen:
            self._acquired.setdefault(names[k], f"{piece.end_s:.6f}")
        fixes = self._fixes(piece, [names[k] for k in seen], motion[seen], np.stack([slots[k] for k in seen]))
        located = [
            row
            for row, k in enumerate(seen)
            if names[k] in self._filters or (fixes[row].valid.any() and fixes[row].valid.mean() >= CONFIRMED)
        ]
        return self._filters.follow([names[seen[row]] for row in located], [fixes[row] for row in located])

    def _forget_all_but(self, names: Sequence[str]) -> None:
        self._filters.forget_all_but(names)
        kept = set(names)
        self._acquired = {name: when for name, when in self._acquired.items() if name in kept}

    def _fixes(self, piece: Piece, names: Sequence[str], motion: Array, slots: IntArray) -> list[Fixes]:
        """Return the fixes of B vehicles over a piece; their echoes are drawn together. slots: sites, (B, m, I)."""
        count, instants, echoes = slots.shape
        assigned = slots >= 0
        number = np.where(assigned, slots, slots[:, :, :1]).reshape(-1, echoes)
        panels = self._panels.take(number)
        flat = motion.transpose(0, 2, 1).reshape(-1, 6)
        level = np.concatenate(
            [
                self._level(piece, name, motion[k], number[k * instants : (k + 1) * instants])
                for k, name in enumerate(names)
            ]
        )
        key = ("live", self.scenario.name, self.seed, f"{piece.end_s:.6f}")
        fixes, _ = fused(flat[:, :4], assigned.reshape(-1, echoes), panels, level, self.settings, key)
        parts = [slice(k * instants, (k + 1) * instants) for k in range(count)]
        return [Fixes(fixes.state[part], fixes.covariance[part], fixes.valid[part]) for part in parts]

    def _level(self, piece: Piece, name: str, motion: Array, number: IntArray) -> Array:
        """Return the SNR of a vehicle's echoes, dB, (m, I). Slow draws hold from its acquisition on."""
        time_s = (np.arange(motion.shape[1]) - motion.shape[1] + 1) / self.rate_hz
        geometry = EchoGeometry(motion[:2].T, heading_rad(motion[2:4]), number, self._panels.take(number), time_s)
        key = ("live", self.scenario.name, self.seed, name, self._acquired[name])
        blockers = self._blockers(piece, name) if self.settings.channel.blockage else None
        return snr_db(self.settings.channel, self.settings.waveform, geometry, blockers, key)

    def _blockers(self, piece: Piece, target: str) -> Blockers:
        """Return the other vehicles, where they are in the middle of the piece."""
        others = [k for k, name in enumerate(piece.names) if name != target]
        middle = piece.tv[others][:, :, piece.tv.shape[2] // 2]
        speed = np.maximum(np.hypot(middle[:, 2], middle[:, 3]), 1e-9)
        known = [self.vehicles[piece.names[k]] for k in others]
        return Blockers(
            ids=[vehicle.name for vehicle in known],
            step_s=1.0,
            x=middle[:, :1],
            y=middle[:, 1:2],
            heading=(middle[:, 2:4] / speed[:, None])[:, None],
            length_m=np.array([vehicle.length_m for vehicle in known]),
            width_m=np.array([vehicle.width_m for vehicle in known]),
            height_m=np.array([TRUCK_HEIGHT_M if v.kind in HIGH_KINDS else CAR_HEIGHT_M for v in known]),
        )


@dataclass
class RadarSensor:
    """The onboard radar of the UV ahead of each TV; when the UV changes, the track goes on with the new one's fixes."""

    scenario: Scenario
    seed: int
    settings: RadarSettings
    report: ReportSettings
    rate_hz: float

    def __post_init__(self) -> None:
        self._filters = Filters(self.rate_hz, self.settings.tracking)

    def sense(self, piece: Piece, uv_of: Mapping[str, str]) -> Sensed:
        present = set(piece.names)
        names = [name for name in piece.names if name in uv_of and uv_of[name] in present]
        self._filters.forget_all_but(names)
        place = {name: k for k, name in enumerate(piece.names)}
        fixes = [self._scan(piece, name, piece.tv[place[name]], piece.tv[place[uv_of[name]]]) for name in names]
        located = [k for k, name in enumerate(names) if name in self._filters or fixes[k].valid.any()]
        return self._filters.follow([names[k] for k in located], [fixes[k] for k in located])

    def _scan(self, piece: Piece, name: str, motion: Array, carrier: Array) -> Fixes:
        """Return the fixes of one TV over a piece. motion, carrier: of the TV and the UV, (6, m)."""
        key = ("live", self.scenario.name, self.seed, name, f"{piece.end_s:.6f}")
        time_s = np.arange(motion.shape[1]) / self.rate_hz
        pose = Pose(
            carrier[:4], carrier[:4], heading_rad(carrier[2:4]), self.report.position_sd_m, self.report.speed_sd_mps
        )
        return scan(motion, time_s, pose, self.settings, key, None).fixes
