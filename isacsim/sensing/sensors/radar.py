"""The UV's own radar as a sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from isac_cosim.base.arrays import BoolArray
from isac_cosim.isacsim.heading import heading_rad
from isac_cosim.isacsim.sensing.following import Approach, Filters, filled, states_of
from isac_cosim.isacsim.sensing.onboard_radar import Pose, RadarSettings, Scan, scan
from isac_cosim.isacsim.sensing.passages import Passage, Piece, SensedPiece, SensedRecord, WatchedTraffic
from isac_cosim.isacsim.sensing.sensors.protocol import SensorSettings
from isac_cosim.isacsim.tracking.fusion import Fixes


class RadarSensor:
    """The radar that the UV carries (`isacsim.sensing.onboard_radar`)."""

    label = "the UV's own radar"
    cost_s = 3.1e-6
    by_sites = False
    filtered = True
    unusable = "not_detected"

    def refusal(self, settings: SensorSettings) -> str | None:
        """A line of sight past other vehicles cannot be sensed anew."""
        if settings.radar.condition != "nlos" or settings.radar.pattern != "line_of_sight":
            return None
        return (
            "pattern line_of_sight needs the other vehicles, which a dataset does not hold; choose random or contiguous"
        )

    def watch(self, traffic: WatchedTraffic, settings: SensorSettings) -> RadarPicture:
        """Nothing is looked at before a UV is."""
        return RadarPicture(traffic, settings.radar)


class RadarPicture:
    """What the radar of the UV ahead knows of each TV; when the UV changes, the track goes on with the new one's fixes.

    A passage without a UV, or without a detection in the run-in, has no usable state. No passage uses a site.
    """

    def __init__(self, traffic: WatchedTraffic, settings: RadarSettings) -> None:
        self._traffic, self._settings = traffic, settings
        self._filters = Filters(traffic.rate_hz, settings.tracking)
        self._line_of_sight = settings.condition == "nlos" and settings.pattern == "line_of_sight"

    def in_view(self, passage: Passage) -> BoolArray:
        """Return where the TV has a UV; whether its radar detects anything is seen later."""
        carrier, count = passage.carrier, passage.truth.shape[1]
        if carrier is None:
            return np.zeros(count, dtype=bool)
        nearest = np.rint(np.arange(count) * carrier.rate_hz / self._traffic.rate_hz).astype(np.int64)
        return np.asarray(~np.isnan(carrier.state[0, np.minimum(nearest, carrier.state.shape[1] - 1)]))

    def record(self, passages: Sequence[Passage]) -> list[SensedRecord]:
        """Sense passages from their UVs."""
        rate_hz, tracking = self._traffic.rate_hz, self._settings.tracking
        approaches = [Approach.of(passage, rate_hz, tracking) for passage in passages]
        scans = [self._scanned(*pair) for pair in zip(passages, approaches, strict=True)]
        fixes = [filled(scan.fixes) for scan in scans]
        records = []
        for approach, of, part, state in zip(
            approaches, scans, fixes, states_of(fixes, rate_hz, tracking), strict=True
        ):
            first, usable = approach.before, bool(part.valid[: approach.run_in + 1].any())
            raw = np.ascontiguousarray(part.state[first:].T)
            records.append(SensedRecord(state[:, first:], raw, 0, of.snr_db, of.detected, usable))
        return records

    def step(self, piece: Piece, uv_of: Mapping[str, str]) -> SensedPiece:
        """Scan the TVs over a piece, each from its UV, and go on with their tracks."""
        names = [name for name in piece.names if uv_of.get(name) in piece.place]
        self._filters.forget_all_but(names)
        fixes = {name: self._scanned_piece(piece, name, uv_of[name]) for name in names}
        return self._filters.follow({name: of for name, of in fixes.items() if name in self._filters or of.valid.any()})

    def _scanned(self, passage: Passage, approach: Approach) -> Scan:
        traffic, settings, carrier = self._traffic, self._settings, passage.carrier
        count = approach.motion.shape[1]
        if carrier is None:
            nothing = Fixes(np.zeros((count, 4)), np.tile(1e8 * np.eye(4), (count, 1, 1)), np.zeros(count, bool))
            return Scan(nothing, np.nan, 0.0)
        blockers = None
        if self._line_of_sight:
            blockers = traffic.others(passage, {passage.tv, *carrier.vehicles}, settings.tracking.run_in_s)
        from_start_s = (np.arange(count) - approach.before) / traffic.rate_hz
        pose = Pose.of(carrier, from_start_s, passage.key)
        return scan(approach.motion, approach.time_s(traffic.rate_hz), pose, settings, passage.key, blockers)

    def _scanned_piece(self, piece: Piece, name: str, uv: str) -> Fixes:
        motion, carrier = piece.tv[piece.place[name]], piece.tv[piece.place[uv]]
        key = ("live", self._traffic.scenario, self._traffic.seed, name, f"{piece.end_s:.6f}")
        time_s = np.arange(motion.shape[1]) / self._traffic.rate_hz
        report = self._traffic.report
        pose = Pose(carrier[:4], carrier[:4], heading_rad(carrier[2:4]), report.position_sd_m, report.speed_sd_mps)
        blockers = piece.others({name, uv}) if self._line_of_sight else None
        return scan(motion, time_s, pose, self._settings, key, blockers, whole=False).fixes
