"""The vehicles of an episode at one instant, and the echoes that each panel gets of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.base.seeding import stream
from isac_cosim.isacsim.heading import heading_rad
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.channel import link_snr_db, rain_db_per_km
from isac_cosim.isacsim.radio.cross_section import aspect_dbsm, random_mean_db
from isac_cosim.isacsim.scene.cells import Echoes
from isac_cosim.isacsim.scene.settings import SceneSetup
from isac_cosim.isacsim.traffic import motion
from isac_cosim.isacsim.traffic.motion import MotionSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording


@dataclass(frozen=True)
class Present:
    """The V vehicles on the road at one instant.

    names: in an order that does not change. state: x, y, vx, vy, ax, ay of the front bumper's centre, m, m/s, m/s2,
    (V, 6). heading: radians counter-clockwise from +x, (V,), NaN of a vehicle that never moves.
    """

    names: Sequence[str]
    state: Array
    heading: Array


def instants(recording: Recording, fixes_hz: float, settings: MotionSettings) -> Iterator[tuple[int, Present]]:
    """Yield the number of each fix of a recording, counted from time 0, and the vehicles that are there then."""
    names = list(recording.tracks)
    fix, vehicle, state, heading = [], [], [], []
    for number, track in enumerate(recording.tracks.values()):
        times = recording.times(track)
        first, last = (int(f(t * fixes_hz)) for f, t in ((np.ceil, times[0] - 1e-9), (np.floor, times[-1] + 1e-9)))
        if last < first:
            continue
        of_fix = np.arange(first, last + 1)
        at = np.clip(of_fix / fixes_hz, times[0], times[-1])
        driven = motion.states(recording, track, at, settings)
        fix.append(of_fix)
        vehicle.append(np.full(len(of_fix), number))
        state.append(driven.T)
        heading.append(heading_rad(driven[2:4]))
    if not fix:
        return
    of_fix, of_vehicle = np.concatenate(fix), np.concatenate(vehicle)
    order = np.lexsort((of_vehicle, of_fix))
    states, headings = np.concatenate(state)[order], np.concatenate(heading)[order]
    of_fix, of_vehicle = of_fix[order], of_vehicle[order]
    numbers = np.arange(of_fix[0], of_fix[-1] + 1)
    begins, ends = np.searchsorted(of_fix, numbers, "left"), np.searchsorted(of_fix, numbers, "right")
    for number, begin, end in zip(numbers.tolist(), begins.tolist(), ends.tolist(), strict=True):
        here = [names[k] for k in of_vehicle[begin:end].tolist()]
        yield number, Present(here, states[begin:end], headings[begin:end])


def seen(position: Array, panels: Panels, range_m: float, half_width_deg: float) -> BoolArray:
    """Return which panels see which positions, m, (N, 2) -> (N, I)."""
    dx, dy, distance = panels.sight(position[:, :1], position[:, 1:2])
    ahead = dx * panels.front[:, 0] + dy * panels.front[:, 1]
    return np.asarray((distance <= range_m) & (ahead >= np.hypot(dx, dy) * np.cos(np.radians(half_width_deg))))


def mast_of(panels: Panels) -> IntArray:
    """Return the number of the mast of each panel, (I,): panels in one place share their line of sight."""
    _, mast = np.unique(np.round(np.stack([panels.x, panels.y], axis=1)), axis=0, return_inverse=True)
    return np.asarray(mast, dtype=np.int64).ravel()


class EchoSource:
    """Gives the echoes of the vehicles in each panel's view, each vehicle one scattering point at its front bumper.

    The random part of a vehicle's cross-section toward a panel, and the phase of its reflection, are drawn once for the
    episode. Between instants, phases turn with the distance.
    """

    def __init__(self, setup: SceneSetup, panels: Panels, scenario: str, seed: int) -> None:
        self._setup, self._panels, self._key = setup, panels, (scenario, seed)
        link = setup.channel.link
        self._link = link.model_copy(update={"power_dbm": setup.power_dbm})
        self._drawn: dict[str, tuple[Array, float]] = {}

    def echoes(self, present: Present) -> tuple[list[Echoes], Array, BoolArray]:
        """Return the echoes that each panel gets, what it should measure, (V, I, 3), and who is seen, (V, I)."""
        setup, panels, link = self._setup, self._panels, self._link
        waveform = setup.numerology.waveform
        view = seen(present.state[:, :2], panels, setup.range_m, setup.half_width_deg)
        measured = panels.measured(present.state[:, :4])
        drawn = [self._of(name) for name in present.names]
        distance = measured[..., 1]
        if link.cross_section == "constant":
            section = np.full(distance.shape, link.cross_section_dbsm)
        else:
            dx, dy, _ = panels.sight(present.state[:, :1], present.state[:, 1:2])
            heading = present.heading[:, None]
            azimuth = np.arctan2(-dy, -dx) - np.where(np.isnan(heading), 0.0, heading)
            aspect = aspect_dbsm(azimuth, np.arccos(panels.height_m / distance))
            section = np.where(np.isnan(heading), link.cross_section_dbsm, aspect)
        random = np.array([of for of, _ in drawn]).reshape(distance.shape)
        section = section + random_mean_db(link.cross_section_sd_db) + link.cross_section_sd_db * random
        level = link_snr_db(link, waveform, distance, section)
        if setup.channel.rain_mm_per_h:
            rain = rain_db_per_km(waveform.carrier_hz, setup.channel.rain_mm_per_h)
            level = level - 2 * distance / 1000 * rain
        phase = np.array([of for _, of in drawn])[:, None] - 4 * np.pi / waveform.wavelength_m * distance
        amplitude = 10 ** (level / 20) * np.exp(1j * phase)
        parts = [
            Echoes(measured[view[:, panel], panel], amplitude[view[:, panel], panel]) for panel in range(len(panels.x))
        ]
        return parts, measured, view

    def _of(self, name: str) -> tuple[Array, float]:
        if name not in self._drawn:
            rng = stream("scene", *self._key, "cross-section", name)
            self._drawn[name] = rng.standard_normal(len(self._panels.x)), float(rng.uniform(0, 2 * np.pi))
        return self._drawn[name]
