"""The events that alarms are held against: which of them count, and which are neutral."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from isacsim.arrays import Array, IntArray
from isacsim.settings import Settings
from isacsim.traffic.motion import excess
from isacsim.traffic.recording import Recording
from labeling.events import COMMAND_REACH_S, Labels, Origin, provenance
from labeling.generation.settings import DatasetStudy
from labeling.intentions import Event, Intention
from labeling.road.surroundings import Surroundings
from labeling.samples.candidates import for_pair
from labeling.samples.uv_choice import choose_uv, may_be_tv

GROUPS: tuple[Origin, ...] = ("natural", "reaction", "commanded")
"""The groups of events that are reported apart: by their origin."""
NOT_WATCHED = "not_watched"
"""Why an event is left out whose vehicle was not predicted throughout, from onset to commit."""
HAS_UV = "has_uv"
"""Why an event is left out where only vehicles without a UV are predicted."""


class LiveEvent(Settings):
    """One event of the traffic.

    onset, commit: s of simulation time. end: end of the event's own motion, s. group: its origin. left_out: why the
    event is neutral, or None if it counts: alarms for a neutral event are neither right nor false.
    """

    vehicle: str
    intention: str
    onset: float
    commit: float
    end: float
    group: Origin
    left_out: str | None = None


def events_of(
    surroundings: Surroundings,
    labels: Labels,
    study: DatasetStudy,
    decisions: Mapping[str, Array],
    decision_s: float,
    alone: bool = False,
) -> list[LiveEvent]:
    """Return the events of a recording, without `following`, by onset.

    decisions: the instants at which each vehicle was predicted, s, in order. decision_s: time between two of them.
    alone: whether events of vehicles without a UV count, and those of the others are neutral, instead of the reverse.
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
        live_events.append(
            LiveEvent(
                vehicle=event.vehicle,
                intention=judged.intention.text,
                onset=event.onset,
                commit=event.commit,
                end=judged.busy_until,
                group=provenance(recording, event).origin,
                left_out=reason,
            )
        )
    return live_events


def _judged(
    surroundings: Surroundings, labels: Labels, event: Event, study: DatasetStudy, alone: bool
) -> tuple[str | None, Event]:
    """Return why an event is neutral, if it is, and the event as what it is for its UV. As in a dataset.

    Without a UV, an event is what it is for any vehicle.
    """
    if not may_be_tv(surroundings.recording.tracks[event.vehicle], study.pairs):
        return "vehicle_class", event
    pair = choose_uv(surroundings, event.vehicle, event.onset, study.pairs)
    if alone == (pair is not None):
        return HAS_UV if alone else "no_uv", event
    if any(event.onset <= time <= event.commit for time in labels.jumps.get(event.vehicle, ())):
        return "jump", event
    judged = event if pair is None else for_pair(surroundings, labels, event, pair.uv)
    return judged.mark, judged


def _watched(event: Event, decisions: Array, decision_s: float) -> bool:
    """Return whether a vehicle was predicted at every instant due between onset and commit, or the last one before."""
    last = np.floor(event.commit / decision_s + 1e-6)
    first = min(np.ceil(event.onset / decision_s - 1e-6), last)
    due = np.arange(first, last + 1) * decision_s
    if not len(decisions):
        return False
    nearest = np.clip(np.searchsorted(decisions, due - decision_s / 2), 0, len(decisions) - 1)
    return bool((np.abs(decisions[nearest] - due) < 1e-6).all())


def groups_at(recording: Recording, vehicle: str, times: Array) -> IntArray:
    """Return the group that a vehicle belongs to at some instants (s), numbers in GROUPS, (n,).

    A vehicle is in the group of the latest reaction or command that it is under, or was or will be within a second;
    otherwise it drives naturally.
    """
    group = np.zeros(len(times), np.int64)
    for command in sorted(recording.commands_to.get(vehicle, ()), key=lambda command: command.start):
        near = (times >= command.start - COMMAND_REACH_S) & (times <= command.end + COMMAND_REACH_S)
        group[near] = GROUPS.index("reaction" if command.cause else "commanded")
    return group
