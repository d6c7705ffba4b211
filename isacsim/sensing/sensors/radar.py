"""The UV's own radar as a sensor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from isac_cosim.base.arrays import BoolArray
from isac_cosim.isacsim.heading import heading_rad
from isac_cosim.isacsim.sensing.following import Approach, FixPicture, Observed, filled
from isac_cosim.isacsim.sensing.onboard_radar import Pose, RadarSettings, scan, unseen
from isac_cosim.isacsim.sensing.passages import Passage, Piece, WatchedTraffic
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


class RadarPicture(FixPicture):
    """What the radar of the UV ahead knows of each TV; when the UV changes, the track goes on with the new one's fixes.

    A passage without a UV, or without a detection in the run-in, has no state. No passage uses a site.
    """

    def __init__(self, traffic: WatchedTraffic, settings: RadarSettings) -> None:
        super().__init__(traffic, settings.tracking)
        self._settings = settings
        self._line_of_sight = settings.condition == "nlos" and settings.pattern == "line_of_sight"

    def in_view(self, passage: Passage) -> BoolArray:
        """Return where the TV has a UV; whether its radar detects anything is seen later."""
        carrier, count = passage.carrier, passage.truth.shape[1]
        if carrier is None:
            return np.zeros(count, dtype=bool)
        nearest = np.rint(np.arange(count) * carrier.rate_hz / self.traffic.rate_hz).astype(np.int64)
        return np.asarray(~np.isnan(carrier.state[0, np.minimum(nearest, carrier.state.shape[1] - 1)]))

    def observed(self, passage: Passage, approach: Approach) -> Observed:
        """Return the fixes of a passage, as its UV makes them."""
        settings, carrier, count = self._settings, passage.carrier, approach.motion.shape[1]
        if carrier is None:
            return Observed(unseen(count), 0, np.nan, 0.0, False)
        blockers = None
        if self._line_of_sight:
            blockers = self.traffic.others(passage, {passage.tv, *carrier.vehicles}, settings.tracking.run_in_s)
        from_start_s = (np.arange(count) - approach.before) / self.traffic.rate_hz
        pose, time_s = Pose.of(carrier, from_start_s, passage.key), approach.time_s(self.traffic.rate_hz)
        scanned = scan(approach.motion, time_s, pose, settings, passage.key, blockers)
        usable = bool(scanned.fixes.valid[: approach.run_in + 1].any())
        return Observed(filled(scanned.fixes), 0, scanned.snr_db, scanned.detected, usable)

    def fixes(self, piece: Piece, uv_of: Mapping[str, str]) -> dict[str, Fixes]:
        """Return the fixes of the TVs over a piece, each from its UV."""
        uvs = {name: uv_of[name] for name in piece.names if uv_of.get(name) in piece.place}
        return {name: self._scanned(piece, name, uv) for name, uv in uvs.items()}

    def _scanned(self, piece: Piece, name: str, uv: str) -> Fixes:
        motion, carrier = piece.tv[piece.place[name]], piece.tv[piece.place[uv]]
        key = ("live", self.traffic.scenario, self.traffic.seed, name, f"{piece.end_s:.6f}")
        time_s, report = np.arange(motion.shape[1]) / self.traffic.rate_hz, self.traffic.report
        pose = Pose(carrier[:4], carrier[:4], heading_rad(carrier[2:4]), report.position_sd_m, report.speed_sd_mps)
        blockers = piece.others({name, uv}) if self._line_of_sight else None
        return scan(motion, time_s, pose, self._settings, key, blockers, whole=False).fixes
