"""What stands beside the road and echoes, and what is left of it once the receiver has subtracted what it has learned.

The background of a panel is the same in every snapshot. The receiver has learned it over minutes, long before the
episode, and subtracts it; a residual of changing phase is left. It knows how strong that is, and takes no weaker peak
there for a vehicle.
"""

from __future__ import annotations

import numpy as np

from isac_cosim.base.seeding import stream
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.scene.cells import CellGrid, Echoes
from isac_cosim.isacsim.scene.detection import KnownPeaks
from isac_cosim.isacsim.scene.settings import SceneSetup
from isac_cosim.isacsim.scene.vehicles import EchoSource

NEAREST_M = 20.0
"""Shortest slant range of a point of the background."""


class Background:
    """The background of every panel of a scenario; it does not depend on the seed."""

    def __init__(self, setup: SceneSetup, panels: Panels, grid: CellGrid, source: EchoSource, scenario: str) -> None:
        scene, link = setup.scene, setup.channel.link
        count = scene.background_points if scene.bodies == "bodies" else 0
        self._left: list[Echoes] = []
        self._known: list[KnownPeaks] = []
        for panel in range(len(panels.x)):
            rng = stream("scene", scenario, "background", panel)
            measured = np.zeros((count, 3))
            measured[:, 0] = np.sin(np.radians(rng.uniform(-setup.half_width_deg, setup.half_width_deg, count)))
            measured[:, 1] = np.sqrt(rng.uniform(NEAREST_M**2, setup.range_m**2, count))
            section = scene.background_dbsm + link.cross_section_sd_db * rng.standard_normal(count)
            amplitude = 10 ** ((source.level_db(measured[:, 1], section) + scene.residual_db) / 20)
            self._left.append(Echoes(measured, amplitude.astype(np.complex128)))
            self._known.append(KnownPeaks.of(self._left[-1], grid))

    def added(self, panel: int, echoes: Echoes, rng: np.random.Generator) -> Echoes:
        """Return the echoes of a panel with what is left of its background."""
        left = self._left[panel]
        if not len(left.amplitude):
            return echoes
        turned = left.amplitude * np.exp(2j * np.pi * rng.random(len(left.amplitude)))
        return Echoes(np.concatenate([echoes.measured, left.measured]), np.concatenate([echoes.amplitude, turned]))

    def known(self, panel: int) -> KnownPeaks:
        """Return where a panel expects what is left."""
        return self._known[panel]
