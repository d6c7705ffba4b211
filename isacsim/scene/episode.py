"""An episode sensed as a scene, from all vehicles' motion to the network's tracks of them."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.seeding import stream
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.isacsim.scene.background import Background
from isac_cosim.isacsim.scene.cells import CellGrid, Echoes, draw
from isac_cosim.isacsim.scene.detection import Detections, detect
from isac_cosim.isacsim.scene.lifetime import Tracks, followed
from isac_cosim.isacsim.scene.scores import SETTLED_S, Scoring
from isac_cosim.isacsim.scene.settings import SceneSetup
from isac_cosim.isacsim.scene.tracker import SceneTracker
from isac_cosim.isacsim.scene.tracks import SceneTracks, TrackedInstant
from isac_cosim.isacsim.scene.vehicles import EchoSource, Present, instants, mast_of, seen
from isac_cosim.isacsim.traffic.recordings.recording import Recording

LEAST_MASTS = 2
"""Vehicles are scored where at least so many masts see them."""


Kept = dict[Hashable, dict[Hashable, list[Detections]]]
"""Detections of each panel by instant and who was where, by what else they depend on."""
_KEPT: ContextVar[Kept | None] = ContextVar("kept", default=None)


@contextmanager
def detections_kept() -> Iterator[None]:
    """Keep what panels find within the block, so that the same episode is sensed once however often it is followed.

    It takes 0.1 GB a minute of a motorway.
    """
    token = _KEPT.set({})
    try:
        yield
    finally:
        _KEPT.reset(token)


def follow(recording: Recording, sites: Sequence[Site], setup: SceneSetup, settled_s: float = SETTLED_S) -> SceneTracks:
    """Sense all vehicles of a recording together, once, and follow them.

    Every panel's draws are seeded by the scenario, the seed, the panel and the number of the instant. settled_s:
    after the beginning, from which on tracks are scored.
    """
    sensing = SceneSensing(setup, sites, recording.lanes, recording.scenario, recording.seed, settled_s)
    for fix, present in instants(recording, setup.scene.fixes_hz, setup.motion):
        sensing.step(fix, present)
    return sensing.tracks


class SceneSensing:
    """Senses a scene instant by instant.

    tracks: everything that came of it so far. detections: of each panel, at the latest instant.
    """

    def __init__(
        self,
        setup: SceneSetup,
        sites: Sequence[Site],
        lanes: Sequence[Lane],
        scenario: str,
        seed: int,
        settled_s: float = SETTLED_S,
    ) -> None:
        if not sites:
            raise InputError("no sites to sense with: add POIs of type isac_site to the scenario")
        self._setup, self._key = setup, (scenario, seed)
        self._panels = Panels.of(sites, setup.target_height_m)
        self._mast = mast_of(self._panels)
        self._grid = CellGrid.of(setup.numerology.waveform, setup.range_m)
        self._source = EchoSource(setup, self._panels, scenario, seed)
        self._background = Background(setup, self._panels, self._grid, self._source, scenario)
        self._tracker = SceneTracker(setup, self._panels, lanes)
        self._scoring = Scoring(1 / setup.scene.fixes_hz, settled_s)
        self._tracks = SceneTracks(setup.scene.fixes_hz)
        kept = _KEPT.get()
        self._known: dict[Hashable, list[Detections]] | None = None
        if kept is not None:
            sensing = setup.scene.model_copy(update={"association": "truth", "begin": "found"})
            alike = scenario, seed, repr(sites), repr(replace(setup, scene=sensing))
            self._known = kept.setdefault(alike, {})
        self.detections: list[Detections] = []

    @property
    def tracks(self) -> SceneTracks:
        """What is known so far, with its scores."""
        self._tracks.scores = self._scoring.scores()
        return self._tracks

    def step(self, fix: int, present: Present) -> TrackedInstant:
        """Sense the vehicles that are there at an instant, and return the tracks that count. Instants come in order."""
        self.detections, measured, view = self.sensed(fix, present)
        if not self._tracks.instants and self._setup.scene.begin == "followed":
            self._begin(present, self._covered(view))
        true = (present.names, measured, view) if self._setup.scene.association == "truth" else None
        tracks = self._tracker.step(self.detections, true)
        counted = tracks.take(tracks.confirmed)
        vehicle = self._scored(present, counted, view)
        instant = TrackedInstant(
            counted.number,
            counted.state[:, :6],
            counted.covariance[:, :2, :2] + counted.outlasting(),
            counted.looked,
            counted.found,
            10 * np.log10(counted.level / self._setup.numerology.waveform.size),
            vehicle,
        )
        self._tracks.instants[fix] = instant
        return instant

    def sensed(self, fix: int, present: Present) -> tuple[list[Detections], Array, BoolArray]:
        """Return what each panel finds at an instant, what it should measure of the vehicles, and whom it sees.

        The last two are (V, I, J, 3), as `bodies.look` returns it, and (V, I).
        """
        echoes, measured, view = self._source.echoes(present)
        instant = fix, tuple(present.names), present.state.tobytes()
        found = None if self._known is None else self._known.get(instant)
        if found is None:
            found = [self._detected(fix, panel, of) for panel, of in enumerate(echoes)]
            if self._known is not None:
                self._known[instant] = found
        return found, measured, view

    def _begin(self, present: Present, covered: BoolArray) -> None:
        """Let the network know the vehicles that two masts see, as if it had followed them before."""
        bodies = self._setup.scene.bodies == "bodies"
        length = present.size[covered, 0] * bodies
        rng = stream("scene", *self._key, "followed")
        known = followed(present.state[covered], length, present.ahead[covered], rng)
        self._tracker.begin([name for name, of in zip(present.names, covered, strict=True) if of], known)

    def _detected(self, fix: int, panel: int, echoes: Echoes) -> Detections:
        rng = stream("scene", *self._key, panel, fix)
        drawn = draw(self._background.added(panel, echoes, rng), self._grid, rng)
        return detect(drawn, self._grid, self._setup.false_alarm, rng, self._background.known(panel))

    def _scored(self, present: Present, counted: Tracks, view: BoolArray) -> tuple[str | None, ...]:
        """Add the instant to the scores, and return the vehicle of each track."""
        setup = self._setup
        middle = present.middle if setup.scene.bodies == "bodies" else present.state[:, :2]
        tracked = seen(counted.state[:, :2], self._panels, setup.range_m, setup.half_width_deg)
        vehicle, track = self._scoring.add(
            present.names,
            np.concatenate([middle, present.state[:, 2:4]], axis=1),
            self._covered(view),
            counted.number,
            counted.middle,
            counted.middle_covariance() + counted.outlasting(),
            self._covered(tracked),
        )
        owner: list[str | None] = [None] * len(counted)
        for of_vehicle, of_track in zip(vehicle.tolist(), track.tolist(), strict=True):
            owner[of_track] = present.names[of_vehicle]
        return tuple(owner)

    def _covered(self, view: BoolArray) -> BoolArray:
        """Return who is seen from enough masts, (N,). view: by panel, (N, I)."""
        by_mast: Array = np.zeros((len(view), int(self._mast.max()) + 1))
        for panel, mast in enumerate(self._mast.tolist()):
            by_mast[:, mast] += view[:, panel]
        return np.asarray((by_mast > 0).sum(axis=1) >= LEAST_MASTS)
