"""The sites as a sensor of all vehicles at once, which has to find out who is who."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray
from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.heading import heading_rad
from isac_cosim.isacsim.panels import Panels
from isac_cosim.isacsim.scene.episode import LEAST_MASTS, SceneSensing, follow
from isac_cosim.isacsim.scene.scores import SceneScores
from isac_cosim.isacsim.scene.settings import SceneSettings, SceneSetup
from isac_cosim.isacsim.scene.tracks import FollowedVehicle, Follower, SceneTracks
from isac_cosim.isacsim.scene.vehicles import Present, mast_of, seen, size_of
from isac_cosim.isacsim.sensing.chain import SensingSettings
from isac_cosim.isacsim.sensing.passages import (
    NOTHING,
    Passage,
    Piece,
    SensedPiece,
    SensedRecord,
    TrackUse,
    WatchedTraffic,
)
from isac_cosim.isacsim.sensing.sensors.protocol import SensorSettings
from isac_cosim.isacsim.traffic.motion import MotionSettings

GIVEN_UP_S = 1.0
"""In running traffic and streams, a TV whose track has been lost for longer than this is not followed any more, s."""


def as_sensed(settings: SensingSettings, scene: bool) -> SensingSettings:
    """Return the settings of a sensing chain as they are with a scene, or without one."""
    if not scene:
        return settings.model_copy(update={"scene": None})
    link = settings.channel.model_copy(update={"kind": "link"})
    return settings.model_copy(update={"scene": settings.scene or SceneSettings(), "channel": link})


def setup_of(settings: SensingSettings, motion: MotionSettings) -> SceneSetup:
    """Return what a scene depends on, from the settings of a sensing chain. Raises InputError for blockage."""
    if settings.channel.blockage:
        raise InputError("channel.blockage: scenes have no blockage but `scene.blockage`; turn it off")
    settings = as_sensed(settings, scene=True)
    return SceneSetup(
        scene=settings.scene or SceneSettings(),
        channel=settings.channel,
        tracking=settings.tracking,
        motion=motion,
        range_m=settings.view.range_m,
        half_width_deg=settings.view.half_width_deg,
        target_height_m=settings.target_height_m,
        false_alarm=settings.false_alarm,
    )


class SceneSensor:
    """The sites, through the room `isacsim.scene`."""

    label = "the sites, all vehicles at once"
    cost_s = 1.3e-3
    by_sites = True
    filtered = False
    unusable = "without_track"

    def refusal(self, settings: SensorSettings) -> str | None:
        """What a scene needs besides the records, their episode, is recorded again."""
        return None

    def watch(self, traffic: WatchedTraffic, settings: SensorSettings) -> ScenePicture:
        """Sense the whole episode, if it is recorded. Raises InputError without sites."""
        if not traffic.sites:
            raise InputError("no sites to sense with: add POIs of type isac_site to the scenario")
        return ScenePicture(traffic, setup_of(settings.sensing, traffic.motion))


class ScenePicture:
    """The network's tracks, and which of them stand for a TV.

    A TV is the track that is the nearest to it when it is first asked about, whatever becomes of the track. A passage
    that begins without one is not usable. In running traffic and streams, a TV whose track is lost is a gap until it
    has a new one.
    """

    def __init__(self, traffic: WatchedTraffic, setup: SceneSetup) -> None:
        self._traffic, self._setup = traffic, setup
        self._panels = Panels.of(traffic.sites, setup.target_height_m)
        self._mast = mast_of(self._panels)
        self._sensing: SceneSensing | None = None
        self._followers: dict[str, Follower] = {}
        self._heading: dict[str, float] = {}
        self._tracks = SceneTracks(setup.scene.fixes_hz)
        if traffic.recording is not None:
            self._tracks = follow(traffic.recording, traffic.sites, setup)

    @property
    def scores(self) -> SceneScores:
        """How well the network knows who is where."""
        return self._tracks.scores if self._sensing is None else self._sensing.tracks.scores

    def in_view(self, passage: Passage) -> BoolArray:
        """Return where two masts see the TV and the network follows a track for it: each part begins with its own."""
        setup = self._setup
        view = seen(passage.truth[:2].T, self._panels, setup.range_m, setup.half_width_deg)
        masts = np.stack([view[:, self._mast == mast].any(axis=1) for mast in np.unique(self._mast)])
        covered = masts.sum(axis=0) >= LEAST_MASTS
        return self._tracks.held(passage.tv, self._times(passage), covered, GIVEN_UP_S)

    def record(self, passages: Sequence[Passage]) -> list[SensedRecord]:
        """Return the state of the track that stands for each TV."""
        return [_as_record(self._tracks.followed(one.tv, self._times(one)), one) for one in passages]

    def step(self, piece: Piece, uv_of: Mapping[str, str]) -> SensedPiece:
        """Sense the vehicles at the instants of a piece, and go on with the tracks of the TVs."""
        traffic, fixes_hz = self._traffic, self._setup.scene.fixes_hz
        if self._sensing is None:
            lanes = piece.lanes.lanes
            self._sensing = SceneSensing(self._setup, traffic.sites, lanes, traffic.scenario, traffic.seed)
        count = piece.tv.shape[2]
        times = piece.end_s + (np.arange(count) - count + 1) / traffic.rate_hz
        before = int(np.floor((times[0] - 1 / traffic.rate_hz) * fixes_hz + 1e-6))
        for fix in range(before + 1, int(np.floor(piece.end_s * fixes_hz + 1e-6)) + 1):
            self._sensing.step(fix, self._present(piece, fix / fixes_hz, times))
        tracks = self._sensing.tracks
        wanted = [name for name in piece.names if name in uv_of]
        found = {name: self._followers.get(name) or tracks.follower(name, before) for name in wanted}
        states = {name: of.states(times) for name, of in found.items() if of is not None}
        lost = GIVEN_UP_S * fixes_hz
        self._followers = {name: of for name, of in found.items() if of is not None and of.lost_for <= lost}
        names = tuple(name for name in states if name in self._followers)
        return SensedPiece(names, np.stack([states[name] for name in names])) if names else NOTHING

    def _present(self, piece: Piece, time_s: float, times: Array) -> Present:
        """Return the vehicles of a piece at one of its instants, s. times: of its states, s."""
        nearest = int(np.abs(times - time_s).argmin())
        state = piece.tv[:, :, nearest].copy()
        state[:, :2] += (time_s - times[nearest]) * state[:, 2:4]
        for name, motion in zip(piece.names, piece.tv, strict=True):
            heading = float(heading_rad(motion[2:4, : nearest + 1])[-1])
            if np.isfinite(heading):
                self._heading[name] = heading
        heading_of = [self._heading.get(name, np.nan) for name in piece.names]
        size = np.array([size_of(piece.lanes.tracks[name]) for name in piece.names]).reshape(-1, 3)
        return Present(piece.names, state, np.array(heading_of), size)

    def _times(self, passage: Passage) -> Array:
        return np.asarray(passage.start_s + np.arange(passage.truth.shape[1]) / self._traffic.rate_hz)


def _as_record(followed: FollowedVehicle | None, passage: Passage) -> SensedRecord:
    if followed is None:
        nothing = np.zeros(passage.truth.shape)
        return SensedRecord(nothing, nothing[:4], 0, np.nan, 0.0, False)
    use = TrackUse(str(followed.track), followed.right_share, followed.breaks, followed.position_sd_m)
    return SensedRecord(
        followed.state, followed.state[:4], followed.n_sites, followed.snr_db, followed.detected, True, use
    )
