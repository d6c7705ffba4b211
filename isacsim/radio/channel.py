"""The SNR of every echo: a fixed number, a draw from a range, or a link budget; then rain and blocking vehicles.

The link budget is the monostatic radar equation per array element; the radar cross-section of a vehicle is in
`isacsim.radio.cross_section`. The defaults give, for a cross-section of 10 dBsm:

>>> link_snr_db(LinkBudget(), Waveform(), np.array([50.0, 100.0, 200.0]), 10.0).round(1).tolist()
[33.7, 21.6, 9.6]

Rain and blocking vehicles (`isacsim.radio.blockage`) lower the SNR of all three kinds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.seeding import stream
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.blockage import Blockers, blockage_db
from isac_cosim.isacsim.radio.cross_section import aspect_dbsm, random_mean_db
from isac_cosim.isacsim.radio.waveform import Waveform

_THERMAL_DBM_PER_HZ = -173.98


Decibels = Annotated[float, Field(ge=-60, le=80)]
"""SNR per antenna element, dB."""


class LinkBudget(Settings):
    """Transmit and receive chain of one panel, and the vehicle's radar cross-section."""

    power_dbm: float = Field(29.8, ge=-200, le=200, description="Transmit power over the sensing bandwidth.")
    transmit_gain_db: float = Field(
        8.0, ge=-200, le=200, description="Gain of the transmitting panel toward the vehicle."
    )
    element_gain_db: float = Field(8.0, ge=-200, le=200, description="Gain of one receiving element.")
    noise_figure_db: float = Field(5.0, ge=0, le=300, description="Receiver noise figure.")
    loss_db: float = Field(3.0, ge=0, le=300, description="Losses of the chain, both ways.")
    cross_section: Literal["aspect", "constant"] = Field(
        "aspect",
        description="Mean radar cross-section: by the angle at which the panel sees the vehicle (TR 38.901, 7.9.2.1), "
        "or the same from everywhere.",
    )
    cross_section_dbsm: float = Field(
        11.25,
        ge=-200,
        le=200,
        description="Linear mean of the `constant` cross-section, in dBsm (TR 38.901, 7.9.2.1); also used for a "
        "vehicle that never moves, whose heading is unknown.",
    )
    cross_section_sd_db: float = Field(
        3.41,
        ge=0,
        le=100,
        description="Standard deviation of the log-normal part, drawn once for each record and site; its linear mean "
        "is one (TR 38.901, 7.9.2.1).",
    )


class ChannelSettings(Settings):
    """The per-element SNR of every echo of a record."""

    kind: Literal["fixed", "uniform", "link"] = Field(
        "uniform",
        description="fixed: one number. uniform: one draw for each record, the same at all its sites (the paper). "
        "link: the link budget.",
    )
    snr_db: float = Field(5.0, ge=-60, le=80, description="Per-element SNR of `fixed`.")
    snr_range_db: tuple[Decibels, Decibels] = Field((0.0, 10.0), description="Range of `uniform`: lowest, highest.")
    link: LinkBudget = Field(default_factory=LinkBudget, description="Budget of `link`.")
    rain_mm_per_h: float = Field(0.0, ge=0, le=300, description="Rain, which attenuates both ways (ITU-R P.838-3).")
    blockage: bool = Field(False, description="Whether vehicles between site and target attenuate (3GPP TR 37.885).")

    @model_validator(mode="after")
    def _ordered(self) -> ChannelSettings:
        low, high = self.snr_range_db
        if low > high:
            raise ValueError(f"snr_range_db {low:g}:{high:g} is no range: give LOW:HIGH in dB with LOW <= HIGH")
        return self


@dataclass(frozen=True)
class EchoGeometry:
    """Where a record's vehicle and the panels of its echoes are, at S instants and for I echoes of each.

    position: true x, y, m, (S, 2). heading_rad: of the vehicle, counter-clockwise from +x, (S,), NaN if unknown.
    site: number of each echo's site, (S, I). panels: of each echo, (S, I). time_s: from the record's start, (S,).
    """

    position: Array
    heading_rad: Array
    site: IntArray
    panels: Panels
    time_s: Array


def snr_db(
    settings: ChannelSettings,
    waveform: Waveform,
    geometry: EchoGeometry,
    blockers: Blockers | None,
    key: tuple[str | int, ...],
) -> Array:
    """Per-element SNR of every echo of a record, dB, (S, I).

    blockers: the other vehicles, needed if the settings include blockage. key: names the record and seeds every draw.
    Raises InputError if blockage is on and there are no blockers.
    """
    position, panels = geometry.position, geometry.panels
    _, _, distance = panels.sight(position[:, :1], position[:, 1:])
    if settings.kind == "fixed":
        level = np.full(distance.shape, settings.snr_db)
    elif settings.kind == "uniform":
        level = np.full(distance.shape, stream(*key, "channel").uniform(*settings.snr_range_db))
    else:
        section = cross_section_dbsm(settings.link, geometry, key)
        level = link_snr_db(settings.link, waveform, distance, section)
    if settings.rain_mm_per_h:
        level = level - 2 * distance / 1000 * rain_db_per_km(waveform.carrier_hz, settings.rain_mm_per_h)
    if settings.blockage:
        if blockers is None:
            raise InputError(
                "blockage needs the other vehicles, which were not given: sense from traffic, or turn blockage off"
            )
        level = level - 2 * blockage_db(blockers, position, geometry.site, panels, geometry.time_s, key)
    return level


def cross_section_dbsm(link: LinkBudget, geometry: EchoGeometry, key: tuple[str | int, ...]) -> Array:
    """Radar cross-section that each echo of a record sees, dBsm, (S, I).

    The mean follows the aspect from instant to instant; the random part is drawn once for each site.
    """
    numbers = np.flatnonzero(np.bincount(geometry.site.ravel()))
    draw = np.zeros(int(numbers.max()) + 1)
    draw[numbers] = [stream(*key, "cross-section", int(k)).standard_normal() for k in numbers]
    random = random_mean_db(link.cross_section_sd_db) + link.cross_section_sd_db * draw[geometry.site]
    if link.cross_section == "constant":
        return np.asarray(link.cross_section_dbsm + random)
    dx, dy, distance = geometry.panels.sight(geometry.position[:, :1], geometry.position[:, 1:])
    heading = geometry.heading_rad[:, None]
    # From the vehicle to the panel, hence the signs.
    azimuth = np.arctan2(-dy, -dx) - np.where(np.isnan(heading), 0.0, heading)
    mean = aspect_dbsm(azimuth, np.arccos(geometry.panels.height_m / distance))
    return np.asarray(np.where(np.isnan(heading), link.cross_section_dbsm, mean) + random)


def link_snr_db(link: LinkBudget, waveform: Waveform, distance_m: Array, cross_section_dbsm: Array | float) -> Array:
    """Per-element SNR by the monostatic radar equation, dB.

    distance_m: slant range, (...). cross_section_dbsm: of the vehicle, (...). Returns (...).
    """
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


def rain_db_per_km(carrier_hz: float, rain_mm_per_h: float) -> float:
    """Specific attenuation of rain for horizontal polarisation, dB/km, one way.

    Source: ITU-R P.838-3, equations (1)-(3) and tables 1 and 3; valid from 1 to 1000 GHz.
    """
    decade = np.log10(carrier_hz / 1e9)

    def regression(terms: list[tuple[float, float, float]], slope: float, constant: float) -> float:
        bells = sum(a * np.exp(-(((decade - b) / c) ** 2)) for a, b, c in terms)
        return float(bells + slope * decade + constant)

    k = 10 ** regression(_RAIN_K, -0.18961, 0.71147)
    alpha = regression(_RAIN_ALPHA, 0.67849, -1.95537)
    return float(k * rain_mm_per_h**alpha)


_RAIN_K = [
    (-5.33980, -0.10008, 1.13098),
    (-0.35351, 1.26970, 0.45400),
    (-0.23789, 0.86036, 0.15354),
    (-0.94158, 0.64552, 0.16817),
]
_RAIN_ALPHA = [
    (-0.14318, 1.82442, -0.55187),
    (0.29591, 0.77564, 0.19822),
    (0.32177, 0.63773, 0.13164),
    (-5.37610, -0.96230, 1.47828),
    (16.1721, -3.29980, 3.43990),
]
