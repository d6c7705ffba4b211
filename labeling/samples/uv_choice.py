"""Which connected vehicle (UV) meets a target vehicle (TV)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from isacsim.seeding import stream
from isacsim.settings import Settings
from isacsim.traffic.recording import Recording, Track
from labeling.road.surroundings import Relation, Surroundings


class PairSettings(Settings):
    """Who is connected, who may be a target, and where the UV of a sample is looked for."""

    connected_share: float = Field(1.0, ge=0.0, le=1.0, description="share of vehicles that are connected")
    before_onset_s: float = Field(1.0, ge=0.0, le=10.0, description="when the UV is chosen, before onset, s")
    range_m: float = Field(100.0, gt=0.0, le=500.0, description="greatest distance between TV and UV then, m")
    fall_back: bool = Field(False, description="whether the nearest connected vehicle stands in for a missing leader")
    tv_kinds: tuple[str, ...] | None = Field(None, description="vehicle classes that may be targets; absent: all")
    uv_kinds: tuple[str, ...] | None = Field(None, description="vehicle classes that may be connected; absent: all")


@dataclass(frozen=True)
class Pair:
    """A UV for a TV. relation: where the UV is, from the TV, when chosen. gap_m: its front ahead of the TV's, m."""

    tv: str
    uv: str
    relation: Relation
    gap_m: float


def connected(recording: Recording, track: Track, settings: PairSettings) -> bool:
    """Whether a vehicle is connected. A vehicle that is so at one share is so at every greater one."""
    if settings.uv_kinds is not None and track.kind not in settings.uv_kinds:
        return False
    draw = stream("connected", recording.scenario, recording.seed, track.vehicle).random()
    return bool(draw < settings.connected_share)


def may_be_tv(track: Track, settings: PairSettings) -> bool:
    """Whether a vehicle may be a target."""
    return settings.tv_kinds is None or track.kind in settings.tv_kinds


def around_tv(around: Surroundings, tv: str, time: float, settings: PairSettings) -> list[Pair]:
    """All connected vehicles on the TV's carriageway within range at an instant, nearest first."""
    recording = around.recording
    own = recording.tracks[tv]
    row = around.step(time) - own.first_step
    found: list[tuple[float, Pair]] = []
    for track in around.present(time):
        k = around.step(time) - track.first_step
        distance = float(np.hypot(track.x[k] - own.x[row], track.y[k] - own.y[row]))
        if track is own or distance > settings.range_m or not connected(recording, track, settings):
            continue
        relation = around.relation(tv, track.vehicle, time)
        if relation is not None:
            gap = float(around.gaps(tv, track.vehicle, np.array([time]))[0])
            found.append((distance, Pair(tv, track.vehicle, relation, gap)))
    return [pair for _, pair in sorted(found, key=lambda item: (item[0], item[1].uv))]


def choose_uv(around: Surroundings, tv: str, onset: float, settings: PairSettings) -> Pair | None:
    """The UV of a sample, by one rule for every intention.

    The leader in the TV's lane `before_onset_s` before onset, if it is connected and within range; else the nearest
    connected vehicle on the same carriageway, unless `fall_back` is off; None where there is none, or the TV is not on
    the road yet. Without a leader nothing can be overtaken: with the fallback, where the UV is tells that much.
    """
    time = onset - settings.before_onset_s
    if not around.has(tv, time, time):
        return None
    leader = around.leader(tv, time, settings.range_m)
    if leader is not None:
        track = around.recording.tracks[leader.vehicle]
        if connected(around.recording, track, settings):
            return Pair(tv, leader.vehicle, "ahead", leader.gap_m + track.length_m)
    if not settings.fall_back:
        return None
    nearest = around_tv(around, tv, time, settings)
    return nearest[0] if nearest else None
