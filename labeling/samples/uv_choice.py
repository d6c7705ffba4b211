"""The choice of the connected vehicle (UV) that is paired with a target vehicle (TV)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from pydantic import Field

from isac_cosim.base.seeding import stream
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.labeling.road.surroundings import Relation, Surroundings


class PairSettings(Settings):
    """Which vehicles are connected, which may be targets, and where the UV of a sample is searched."""

    connected_share: float = Field(1.0, ge=0.0, le=1.0, description="share of vehicles that are connected")
    before_onset_s: float = Field(1.0, ge=0.0, le=10.0, description="how long before onset the UV is chosen, s")
    range_m: float = Field(100.0, gt=0.0, le=500.0, description="maximum distance between TV and UV at that time, m")
    fall_back: bool = Field(False, description="use the nearest connected vehicle where there is no connected leader")
    tv_kinds: tuple[str, ...] | None = Field(None, description="SUMO vehicle classes that may be targets; absent: all")
    uv_kinds: tuple[str, ...] | None = Field(
        None, description="SUMO vehicle classes that may be connected; absent: all"
    )


@dataclass(frozen=True)
class Pair:
    """A TV and its UV.

    relation: where the UV is, seen from the TV, when it is chosen. gap_m: how far its front bumper is ahead of the TV's
    along the road at that time, m.
    """

    tv: str
    uv: str
    relation: Relation
    gap_m: float


def connected(recording: Recording, track: Track, settings: PairSettings) -> bool:
    """Return whether a vehicle is connected. One that is connected at some share is so at every larger share."""
    if track.bystander or (settings.uv_kinds is not None and track.kind not in settings.uv_kinds):
        return False
    return _connected_draw(recording.scenario, recording.seed, track.vehicle) < settings.connected_share


@lru_cache(maxsize=4096)
def _connected_draw(scenario: str, seed: int, vehicle: str) -> float:
    """Return the number between 0 and 1 that decides at which share a vehicle is connected."""
    return float(stream("connected", scenario, seed, vehicle).random())


def may_be_tv(track: Track, settings: PairSettings) -> bool:
    """Return whether a vehicle may be a target."""
    return not track.bystander and (settings.tv_kinds is None or track.kind in settings.tv_kinds)


def around_tv(surroundings: Surroundings, tv: str, time: float, settings: PairSettings) -> list[Pair]:
    """Return all connected vehicles on the TV's carriageway within range at a time (s), nearest first."""
    recording = surroundings.recording
    tv_track = recording.tracks[tv]
    row = surroundings.step(time) - tv_track.first_step
    pairs: list[tuple[float, Pair]] = []
    for track in surroundings.present(time):
        k = surroundings.step(time) - track.first_step
        distance = float(np.hypot(track.x[k] - tv_track.x[row], track.y[k] - tv_track.y[row]))
        if track is tv_track or distance > settings.range_m or not connected(recording, track, settings):
            continue
        relation = surroundings.relation(tv, track.vehicle, time)
        if relation is not None:
            gap = float(surroundings.gaps(tv, track.vehicle, np.array([time]))[0])
            pairs.append((distance, Pair(tv, track.vehicle, relation, gap)))
    return [pair for _, pair in sorted(pairs, key=lambda item: (item[0], item[1].uv))]


def choose_uv(surroundings: Surroundings, tv: str, onset: float, settings: PairSettings) -> Pair | None:
    """Return the UV of a sample, by one rule for every intention, or None if there is none.

    onset: of the TV's event, s. The UV is the leader in the TV's lane `before_onset_s` before onset, if it is connected
    and within range. Otherwise it is the nearest connected vehicle on the same carriageway if `fall_back` is on; that
    gives something away, because a TV without a leader has nothing to overtake. A TV that is not on the road yet has no
    UV.
    """
    time = onset - settings.before_onset_s
    if not surroundings.has(tv, time, time):
        return None
    leader = surroundings.leader(tv, time, settings.range_m)
    if leader is not None:
        track = surroundings.recording.tracks[leader.vehicle]
        if connected(surroundings.recording, track, settings):
            return Pair(tv, leader.vehicle, "ahead", leader.gap_m + track.length_m)
    if not settings.fall_back:
        return None
    nearest = around_tv(surroundings, tv, time, settings)
    return nearest[0] if nearest else None
