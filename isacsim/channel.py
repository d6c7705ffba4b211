"""Where the SNR of an echo comes from: a number, a range, a link budget; and what rain and other vehicles take off it.

Source of the link budget: the monostatic radar equation per array element; of the vehicle's radar cross-section: 3GPP
TR 38.901 clause 7.9. The defaults of `link` give 33.7, 21.7 and 9.6 dB at 50, 100 and 200 m for 10 dBsm.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from isacsim.seeding import stream
from isacsim.settings import Settings
from isacsim.waveform import Array, Waveform

_THERMAL_DBM_PER_HZ = -173.98


class LinkBudget(Settings):
    """Transmit and receive chain of one panel."""

    power_dbm: float = Field(29.8, description="Transmit power over the sensing bandwidth.")
    transmit_gain_db: float = Field(8.0, description="Gain of the transmitting panel toward the vehicle.")
    element_gain_db: float = Field(8.0, description="Gain of one receiving element.")
    noise_figure_db: float = Field(5.0, ge=0, description="Receiver noise figure.")
    loss_db: float = Field(3.0, ge=0, description="Losses of the chain, both ways.")
    cross_section_dbsm: float = Field(11.25, description="Mean radar cross-section of a vehicle (TR 38.901, 7.9).")
    cross_section_sd_db: float = Field(3.41, ge=0, description="Its spread, drawn a record and site (TR 38.901, 7.9).")


class ChannelSettings(Settings):
    """The per-element SNR of every echo of a record."""

    kind: Literal["fixed", "uniform", "link"] = Field(
        "uniform", description="One number; one draw a record, alike at all its sites (the paper); the link budget."
    )
    snr_db: float = Field(5.0, ge=-60, le=80, description="Per-element SNR of `fixed`.")
    snr_range_db: tuple[float, float] = Field((0.0, 10.0), description="Range of `uniform`: lowest, highest.")
    link: LinkBudget = Field(default_factory=LinkBudget, description="Budget of `link`.")

    @model_validator(mode="after")
    def _ordered(self) -> ChannelSettings:
        low, high = self.snr_range_db
        if not -60 <= low <= high <= 80:
            raise ValueError(f"snr_range_db {low:g}:{high:g} is no range: give LOW:HIGH in dB with LOW <= HIGH")
        return self


def snr_db(
    settings: ChannelSettings, waveform: Waveform, distance_m: Array, site: Array, key: tuple[str | int, ...]
) -> Array:
    """Per-element SNR of every echo of a record, dB.

    distance_m: slant range of each echo, (S, I). site: number of the site of each echo, integers, (S, I).
    key: names the record; every draw is seeded by it. Returns (S, I).
    """
    rng = stream(*key, "channel")
    if settings.kind == "fixed":
        return np.full(distance_m.shape, settings.snr_db)
    if settings.kind == "uniform":
        return np.full(distance_m.shape, rng.uniform(*settings.snr_range_db))
    spread = np.array([stream(*key, "cross-section", int(k)).standard_normal() for k in range(int(site.max()) + 1)])
    section = settings.link.cross_section_dbsm + settings.link.cross_section_sd_db * spread[site]
    return link_snr_db(settings.link, waveform, distance_m, section)


def link_snr_db(link: LinkBudget, waveform: Waveform, distance_m: Array, cross_section_dbsm: Array | float) -> Array:
    """Per-element SNR by the radar equation, dB. distance_m: slant range, (...). Returns (...)."""
    bandwidth_hz = waveform.subcarriers * waveform.subcarrier_spacing_hz
    received = (
        link.power_dbm
        + link.transmit_gain_db
        + link.element_gain_db
        - link.loss_db
        + cross_section_dbsm
        + 20 * np.log10(waveform.wavelength_m)
        - 30 * np.log10(4 * np.pi)
        - 40 * np.log10(distance_m)
    )
    noise = _THERMAL_DBM_PER_HZ + 10 * np.log10(bandwidth_hz) + link.noise_figure_db
    return np.asarray(received - noise)
