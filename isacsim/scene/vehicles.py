"""The vehicles of an episode at one instant, and the echoes that each panel gets of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from isac_cosim.base.arrays import Array, BoolArray, IntArray
from isac_cosim.base.seeding import stream
from isac_cosim.isacsim.heading import heading_rad
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.radio.blockage import cuts, height_m, mean_loss_db
from isac_cosim.isacsim.radio.channel import link_snr_db, rain_db_per_km
from isac_cosim.isacsim.radio.cross_section import aspect_dbsm, random_mean_db
from isac_cosim.isacsim.scene.bodies import BEHIND, look
from isac_cosim.isacsim.scene.cells import Echoes
from isac_cosim.isacsim.scene.settings import SceneSetup
from isac_cosim.isacsim.traffic import motion
from isac_cosim.isacsim.traffic.motion import MotionSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track


@dataclass(frozen=True)
class Present:
    """The V vehicles on the road at one instant.

    names: in an order that does not change. state: x, y, vx, vy, ax, ay of the front bumper's centre, m, m/s, m/s2,
    (V, 6). heading: radians counter-clockwise from +x, (V,), NaN of a vehicle that never moves. size: length, width and
    height, m, (V, 3).
    """

    names: Sequence[str]
    state: Array
    heading: Array
    size: Array

    @property
    def ahead(self) -> Array:
        """Unit vector of the heading; along +x of a vehicle that never moves, (V, 2)."""
        heading = np.nan_to_num(self.heading)
        return np.stack([np.cos(heading), np.sin(heading)], axis=1)

    @property
    def middle(self) -> Array:
        """Middle of the body, m, (V, 2)."""
        return self.state[:, :2] - self.size[:, :1] / 2 * self.ahead


def size_of(track: Track) -> Array:
    """Return length, width and height of a vehicle, m, (3,)."""
    return np.array([track.length_m, track.width_m, height_m(track.kind)])


def instants(recording: Recording, fixes_hz: float, settings: MotionSettings) -> Iterator[tuple[int, Present]]:
    """Yield the number of each fix of a recording, counted from time 0, and the vehicles that are there then."""
    names = list(recording.tracks)
    sizes = np.array([size_of(track) for track in recording.tracks.values()])
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
        here = of_vehicle[begin:end]
        of_names = [names[k] for k in here.tolist()]
        yield number, Present(of_names, states[begin:end], headings[begin:end], sizes[here])


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
    """Gives the echoes of the vehicles in each panel's view, and of the background where the scene has one.

    The random part of each point's cross-section toward a panel, and the phase of its reflection, are drawn once for
    the episode. Between instants, phases turn with the distance. Bodies hide what is behind them.
    """

    def __init__(self, setup: SceneSetup, panels: Panels, scenario: str, seed: int) -> None:
        self._setup, self._panels, self._key = setup, panels, (scenario, seed)
        link = setup.channel.link
        self._link = link.model_copy(update={"power_dbm": setup.numerology.power_dbm})
        self._bodies = setup.scene.bodies == "bodies"
        self._drawn: dict[str, tuple[Array, Array, Array]] = {}

    def echoes(self, present: Present) -> tuple[list[Echoes], Array, BoolArray]:
        """Return the echoes that each panel gets, what it should measure of the points, and who is seen.

        The last two are (V, I, J, 3) and (V, I).
        """
        setup, panels, link = self._setup, self._panels, self._link
        waveform = setup.numerology.waveform
        view = seen(present.state[:, :2], panels, setup.range_m, setup.half_width_deg)
        points = look(present.state[:, :4], present.ahead, present.size if self._bodies else None, panels)
        drawn = [self._of(name) for name in present.names]
        distance = points.measured[..., 1]
        if self._bodies:
            section = points.strength_dbsm()
        elif link.cross_section == "constant":
            section = np.full(distance.shape, link.cross_section_dbsm)
        else:
            aspect = aspect_dbsm(points.azimuth, points.zenith)
            section = np.where(np.isnan(present.heading)[:, None, None], link.cross_section_dbsm, aspect)
        random = np.array([of for of, _, _ in drawn]).reshape(distance.shape)
        section = section + random_mean_db(link.cross_section_sd_db) + link.cross_section_sd_db * random
        level = self.level_db(distance, section)
        if self._bodies and setup.scene.blockage:
            loss = np.array([of for _, _, of in drawn]).reshape(view.shape)
            level -= 2 * self._hidden_db(present, view, loss)[..., None]
        phase = np.array([of for _, of, _ in drawn]).reshape(len(drawn), 1, distance.shape[2])
        amplitude = 10 ** (level / 20) * np.exp(1j * (phase - 4 * np.pi / waveform.wavelength_m * distance))
        parts = [
            Echoes(points.measured[in_view, panel].reshape(-1, 3), amplitude[in_view, panel].ravel())
            for panel, in_view in enumerate(view.T)
        ]
        return parts, points.measured, view

    def level_db(self, distance: Array, section_dbsm: Array) -> Array:
        """Return the per-element SNR of echoes, dB. distance: slant range, m. section_dbsm: cross-section, dBsm."""
        channel, waveform = self._setup.channel, self._setup.numerology.waveform
        level = link_snr_db(self._link, waveform, distance, section_dbsm)
        if channel.rain_mm_per_h:
            level = level - 2 * distance / 1000 * rain_db_per_km(waveform.carrier_hz, channel.rain_mm_per_h)
        return np.asarray(level)

    def _hidden_db(self, present: Present, view: BoolArray, draw: Array) -> Array:
        """Return the loss of each vehicle's echoes by the one in between that attenuates most, one way, dB, (V, I).

        draw: standard normal deviate of each vehicle's loss toward each panel, (V, I).
        """
        panels, worst = self._panels, np.zeros(view.shape)
        low = panels.target_height_m
        # Lines of sight fall toward their targets, so that only what is near these can be in between.
        steepest = np.clip((present.size[:, 2].max(initial=low) - low) / np.maximum(panels.height_m.min(), 1e-3), 0, 1)
        reach = float(steepest) * self._setup.range_m + present.size[:, 0].max(initial=0.0)
        middle = present.middle
        near = cKDTree(middle).query_pairs(reach, output_type="ndarray") if len(middle) else np.empty((0, 2), np.int64)
        target, blocker = np.concatenate([near, near[:, ::-1]]).T
        hidden = view[target] & cuts(
            present.state[blocker, :2], present.ahead[blocker], present.size[blocker], middle[target], panels
        )
        pair, panel = np.nonzero(hidden)
        of_target, of_blocker = target[pair], blocker[pair]
        dx, dy = middle[of_target, 0] - panels.x[panel], middle[of_target, 1] - panels.y[panel]
        distance = np.sqrt(dx**2 + dy**2 + panels.height_m[panel] ** 2)
        mast = panels.height_m[panel] + low
        mean, deviation = mean_loss_db(
            distance, np.minimum(low, mast), np.maximum(low, mast), present.size[of_blocker, 2]
        )
        np.maximum.at(worst, (of_target, panel), mean + deviation * draw[of_blocker, panel])
        return worst

    def _of(self, name: str) -> tuple[Array, Array, Array]:
        """Return what is drawn for a vehicle: cross-sections, (I, J), phases, (J,), and its loss to others, (I,)."""
        if name not in self._drawn:
            count = len(BEHIND) if self._bodies else 1
            panels = len(self._panels.x)
            rng = stream("scene", *self._key, "cross-section", name)
            section = rng.standard_normal((panels, count))
            self._drawn[name] = section, rng.uniform(0, 2 * np.pi, count), rng.standard_normal(panels)
        return self._drawn[name]
