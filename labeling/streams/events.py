"""The events of running traffic: which of them count when alarms are scored, and which are neutral."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Self

import numpy as np
from pydantic import model_validator

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.motion import excess
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.detectors.events import COMMAND_REACH_S, Labels, Origin, provenance
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.intentions import KNOWN, Event, Intention
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.samples.candidates import for_pair
from isac_cosim.labeling.samples.uv_choice import choose_uv, may_be_tv

GROUPS: tuple[Origin, ...] = ("natural", "reaction", "commanded")
"""The groups of events with scores of their own: the origins."""
NOT_WATCHED = "not_watched"
"""Reason to leave an event out: its vehicle was not predicted throughout, from onset to commit."""
HAS_UV = "has_uv"
"""Reason to leave an event out, where only vehicles without a UV are predicted: its vehicle has one."""
NEAR_MISS = "near_miss"
"""Reason to leave an event out: it is none, but nearly one."""


class LiveEvent(Settings):
    """One event of the traffic.

    onset, commit: s of simulation time. end: when the motion of the event itself ends, s. group: its origin.
    left_out: why the event is neutral, None if it counts. An alarm for a neutral event is neither right nor false.
    """

    vehicle: str
    intention: str
    onset: float
    commit: float
    end: float
    group: Origin
    left_out: str | None = None

    @model_validator(mode="after")
    def _is_an_event(self) -> Self:
        if self.intention not in [known.text for known in KNOWN]:
            raise ValueError(f"intention: {self.intention} is not a known one")
        if not self.onset <= self.commit:
            raise ValueError("commit: is before the onset")
        return self


def events_of(
    surroundings: Surroundings,
    labels: Labels,
    study: DatasetStudy,
    decisions: Mapping[str, Array],
    decision_s: float,
    alone: bool = False,
) -> list[LiveEvent]:
    """Return the events of a recording, without `following`, by onset.

    decisions: the instants at which each vehicle was predicted, s, in order. decision_s: time between two of them, s.
    alone: if true, events of vehicles without a UV count and those of vehicles with one are neutral; if false, the
    reverse.
    """
    recording = surroundings.recording
    beyond: dict[str, Array] = {}
    live_events = []
    for event in labels.events:
        if event.intention is Intention.FOLLOWING:
            continue
        reason, judged = _judged(surroundings, labels, event, study, alone)
        if reason is None and not _watched(event, decisions.get(event.vehicle, np.empty(0)), decision_s):
            reason = NOT_WATCHED
        if reason is None:
            if event.vehicle not in beyond:
                track = recording.tracks[event.vehicle]
                beyond[event.vehicle] = excess(recording, track, study.motion).beyond_car
            inside = (beyond[event.vehicle] >= event.onset) & (beyond[event.vehicle] <= event.commit)
            reason = "beyond_car" if inside.any() else None
        # A mark comes last: with five intentions, a pulling-out with an open outcome counts.
        live_events.append(_live(recording, judged, judged.mark if reason is None else reason))
    live_events += [_live(recording, event, NEAR_MISS) for event in labels.near_misses]
    return sorted(live_events, key=lambda event: event.onset)


def _live(recording: Recording, event: Event, left_out: str | None) -> LiveEvent:
    return LiveEvent(
        vehicle=event.vehicle,
        intention=event.intention.text,
        onset=event.onset,
        commit=event.commit,
        end=event.busy_until,
        group=provenance(recording, event).origin,
        left_out=left_out,
    )


def _judged(
    surroundings: Surroundings, labels: Labels, event: Event, study: DatasetStudy, alone: bool
) -> tuple[str | None, Event]:
    """Return why an event is neutral whatever it is, or None, and the event as it is labelled for its UV in a dataset.

    Whether a pulling-out is an overtake depends on the UV. Without a UV, an overtake of any vehicle is one.
    """
    if not may_be_tv(surroundings.recording.tracks[event.vehicle], study.pairs):
        return "vehicle_class", event
    pair = choose_uv(surroundings, event.vehicle, event.onset, study.pairs)
    if alone == (pair is not None):
        return HAS_UV if alone else "no_uv", event
    if any(event.onset <= time <= event.commit for time in labels.jumps.get(event.vehicle, ())):
        return "jump", event
    return None, event if pair is None else for_pair(surroundings, labels, event, pair.uv)


def _watched(event: Event, decisions: Array, decision_s: float) -> bool:
    """Return whether a vehicle was predicted at every due instant from onset to commit.

    If no instant is due in that time, the last one before it counts.
    """
    last = np.floor(event.commit / decision_s + 1e-6)
    first = min(np.ceil(event.onset / decision_s - 1e-6), last)
    due = np.arange(first, last + 1) * decision_s
    if not len(decisions):
        return False
    nearest = np.clip(np.searchsorted(decisions, due - decision_s / 2), 0, len(decisions) - 1)
    return bool((np.abs(decisions[nearest] - due) < 1e-6).all())


def groups_at(recording: Recording, vehicle: str, times: Array) -> IntArray:
    """Return the group of a vehicle at some instants (s), as numbers in GROUPS, (n,).

    During a reaction or a command, and for a second before and after it, the vehicle belongs to that group; of several,
    the latest counts. At all other times it drives naturally.
    """
    group = np.zeros(len(times), np.int64)
    for command in sorted(recording.commands_to.get(vehicle, ()), key=lambda command: command.start):
        near = (times >= command.start - COMMAND_REACH_S) & (times <= command.end + COMMAND_REACH_S)
        group[near] = GROUPS.index("reaction" if command.cause else "commanded")
    return group
