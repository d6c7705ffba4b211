"""The sites of the mobile network as a sensor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.heading import heading_rad
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.channel import EchoGeometry, snr_db
from isac_cosim.isacsim.sensing.chain import CONFIRMED, LEAST_SITES, SensingSettings, assign, fix, fused, serving
from isac_cosim.isacsim.sensing.following import Approach, FixPicture, Observed
from isac_cosim.isacsim.sensing.passages import Passage, Piece, WatchedTraffic
from isac_cosim.isacsim.sensing.sensors.protocol import SensorSettings
from isac_cosim.isacsim.tracking.fusion import Fixes


class IsacSensor:
    """The sites, through the chain of `isacsim.sensing.chain`, one TV at a time."""

    label = "the sites"
    cost_s = 9.5e-6
    by_sites = True
    filtered = True
    unusable = "too_few_sites"

    def refusal(self, settings: SensorSettings) -> str | None:
        """Blockage cannot be sensed anew."""
        if not settings.sensing.channel.blockage:
            return None
        return (
            "blockage needs the other vehicles, which a dataset does not hold; generate with it, or sense without it "
            "(--no-blockage)"
        )

    def watch(self, traffic: WatchedTraffic, settings: SensorSettings) -> SitePicture:
        """Look up the panels. Raises InputError without sites."""
        if not traffic.sites:
            raise InputError("no sites to sense with: add POIs of type isac_site to the scenario")
        return SitePicture(traffic, settings.sensing)


class SitePicture(FixPicture):
    """What the sites know of TVs, each sensed on its own.

    A passage that fewer than LEAST_SITES sites see throughout has no state; nor has one that fewer than CONFIRMED of
    the run-in's snapshots located, whose n_sites is 0. In running traffic, either is a gap.
    """

    def __init__(self, traffic: WatchedTraffic, settings: SensingSettings) -> None:
        super().__init__(traffic, settings.tracking, CONFIRMED)
        self._settings, self._panels = settings, Panels.of(traffic.sites, settings.target_height_m)
        self._acquired: dict[str, str] = {}

    def in_view(self, passage: Passage) -> BoolArray:
        """Return where enough sites see the TV."""
        return np.asarray((self._slots(passage.truth) >= 0).sum(axis=1) >= LEAST_SITES)

    def observed(self, passage: Passage, approach: Approach) -> Observed:
        """Return the fixes of a passage."""
        settings, blockers = self._settings, None
        if settings.channel.blockage:
            blockers = self.traffic.others(passage, {passage.tv}, settings.tracking.run_in_s)
        return fix(approach, self.traffic.rate_hz, self._panels, settings, passage.key, blockers)

    def fixes(self, piece: Piece, uv_of: Mapping[str, str]) -> dict[str, Fixes]:
        """Return the fixes of the TVs in view over a piece; their echoes are drawn together."""
        motions = {name: piece.tv[piece.place[name]] for name in piece.names if name in uv_of}
        slots = {name: self._slots(motion) for name, motion in motions.items()}
        slots = {name: of for name, of in slots.items() if (of >= 0).sum(axis=1).min() >= LEAST_SITES}
        now, length = f"{piece.end_s:.6f}", piece.tv.shape[2]
        self._acquired = {name: self._acquired.get(name, now) for name in slots}
        if not slots:
            return {}
        states = np.concatenate([motions[name][:4].T for name in slots])
        level = np.concatenate([self._level_db(piece, name, motions[name], of) for name, of in slots.items()])
        together, key = np.concatenate(list(slots.values())), ("live", self.traffic.scenario, self.traffic.seed, now)
        _, panels = serving(together, self._panels)
        fixes, _ = fused(states, together, panels, level, self._settings, key)
        return {name: fixes.part(slice(k * length, (k + 1) * length)) for k, name in enumerate(slots)}

    def _slots(self, motion: Array) -> IntArray:
        return assign(motion[:2].T, self.traffic.rate_hz, self._panels, self._settings.view)

    def _level_db(self, piece: Piece, name: str, motion: Array, slots: IntArray) -> Array:
        """Return the SNR of a TV's echoes over a piece. Slow draws hold from its acquisition on."""
        time_s = (np.arange(motion.shape[1]) - motion.shape[1] + 1) / self.traffic.rate_hz
        key = ("live", self.traffic.scenario, self.traffic.seed, name, self._acquired[name])
        blockers = piece.others({name}) if self._settings.channel.blockage else None
        geometry = EchoGeometry(motion[:2].T, heading_rad(motion[2:4]), *serving(slots, self._panels), time_s)
        return snr_db(self._settings.channel, self._settings.waveform, geometry, blockers, key)
