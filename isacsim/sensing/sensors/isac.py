"""The sites of the mobile network as a sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.heading import heading_rad
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.channel import EchoGeometry, snr_db
from isac_cosim.isacsim.sensing.chain import (
    CONFIRMED,
    LEAST_SITES,
    Observed,
    SensingSettings,
    assign,
    fix,
    fused,
    serving,
)
from isac_cosim.isacsim.sensing.following import Approach, Filters, states_of
from isac_cosim.isacsim.sensing.passages import NOTHING, Passage, Piece, SensedPiece, SensedRecord, WatchedTraffic
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


class SitePicture:
    """What the sites know of TVs, each sensed on its own.

    A passage that fewer than LEAST_SITES sites see throughout has no state; nor has one that fewer than CONFIRMED of
    the run-in's snapshots located, whose n_sites is 0. In running traffic, either is a gap.
    """

    def __init__(self, traffic: WatchedTraffic, settings: SensingSettings) -> None:
        self._traffic, self._settings = traffic, settings
        self._panels = Panels.of(traffic.sites, settings.target_height_m)
        self._filters = Filters(traffic.rate_hz, settings.tracking)
        self._acquired: dict[str, str] = {}

    def in_view(self, passage: Passage) -> BoolArray:
        """Return where enough sites see the TV."""
        return np.asarray((self._assigned(passage.truth) >= 0).sum(axis=1) >= LEAST_SITES)

    def record(self, passages: Sequence[Passage]) -> list[SensedRecord]:
        """Sense passages with the sites."""
        rate_hz, tracking = self._traffic.rate_hz, self._settings.tracking
        approaches = [Approach.of(passage, rate_hz, tracking) for passage in passages]
        observed = [self._observed(*pair) for pair in zip(passages, approaches, strict=True)]
        located = [k for k, of in enumerate(observed) if of.n_sites >= LEAST_SITES]
        states = states_of([observed[k].fixes for k in located], rate_hz, tracking)
        state_of = dict(zip(located, states, strict=True))
        records = []
        for k, (of, approach) in enumerate(zip(observed, approaches, strict=True)):
            state = state_of.get(k, np.zeros((6, len(of.fixes.valid))))[:, approach.before :]
            fixes = np.ascontiguousarray(of.fixes.state[approach.before :].T)
            records.append(SensedRecord(state, fixes, of.n_sites, of.snr_db, of.detected, k in state_of))
        return records

    def step(self, piece: Piece, uv_of: Mapping[str, str]) -> SensedPiece:
        """Sense the TVs over a piece, and go on with their tracks."""
        slots = {name: self._assigned(piece.tv[piece.place[name]]) for name in piece.names if name in uv_of}
        slots = {name: of for name, of in slots.items() if (of >= 0).sum(axis=1).min() >= LEAST_SITES}
        self._filters.forget_all_but(slots)
        self._acquired = {name: self._acquired.get(name, f"{piece.end_s:.6f}") for name in slots}
        fixes = self._fixes(piece, slots)
        located = {
            name: of
            for name, of in fixes.items()
            if name in self._filters or (of.valid.any() and of.valid.mean() >= CONFIRMED)
        }
        return self._filters.follow(located) if located else NOTHING

    def _assigned(self, motion: Array) -> IntArray:
        return assign(motion[:2].T, self._traffic.rate_hz, self._panels, self._settings.view)

    def _observed(self, passage: Passage, approach: Approach) -> Observed:
        traffic, settings, blockers = self._traffic, self._settings, None
        if settings.channel.blockage:
            blockers = traffic.others(passage, {passage.tv}, settings.tracking.run_in_s)
        return fix(approach, traffic.rate_hz, self._panels, settings, passage.key, blockers)

    def _fixes(self, piece: Piece, slots: Mapping[str, IntArray]) -> dict[str, Fixes]:
        """Return the fixes of TVs over a piece; their echoes are drawn together. slots: their sites, (m, I)."""
        if not slots:
            return {}
        motions = [piece.tv[piece.place[name]] for name in slots]
        together = np.concatenate(list(slots.values()))
        level = np.concatenate([self._level(piece, *one) for one in zip(slots, motions, slots.values(), strict=True)])
        key = ("live", self._traffic.scenario, self._traffic.seed, f"{piece.end_s:.6f}")
        _, panels = serving(together, self._panels)
        states = np.concatenate([motion[:4].T for motion in motions])
        fixes, _ = fused(states, together >= 0, panels, level, self._settings, key)
        length = piece.tv.shape[2]
        parts = {name: slice(k * length, (k + 1) * length) for k, name in enumerate(slots)}
        return {
            name: Fixes(fixes.state[part], fixes.covariance[part], fixes.valid[part]) for name, part in parts.items()
        }

    def _level(self, piece: Piece, name: str, motion: Array, slots: IntArray) -> Array:
        """Return the SNR of a TV's echoes, dB, (m, I). Slow draws hold from its acquisition on."""
        number, panels = serving(slots, self._panels)
        time_s = (np.arange(motion.shape[1]) - motion.shape[1] + 1) / self._traffic.rate_hz
        geometry = EchoGeometry(motion[:2].T, heading_rad(motion[2:4]), number, panels, time_s)
        key = ("live", self._traffic.scenario, self._traffic.seed, name, self._acquired[name])
        settings = self._settings
        blockers = piece.others({name}) if settings.channel.blockage else None
        return snr_db(settings.channel, settings.waveform, geometry, blockers, key)
