"""Which events count, which are neutral, and who caused them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.isacsim.traffic.recordings.recording import Command, Recording
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.near_misses import NearMissSettings
from isac_cosim.labeling.intentions import Intention
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.streams.events import (
    GROUPS,
    HAS_UV,
    NEAR_MISS,
    NOT_WATCHED,
    LiveEvent,
    events_of,
    groups_at,
)

ALWAYS = np.round(np.arange(0, 500) * 0.1, 9)


def events(
    recording: Recording, study: LiveStudy, decisions: np.ndarray = ALWAYS, alone: bool = False
) -> dict[str, LiveEvent]:
    surroundings = Surroundings(recording)
    labels = label(recording, study.dataset.labels, surroundings)
    watched = dict.fromkeys(recording.tracks, decisions)
    return {event.intention: event for event in events_of(surroundings, labels, study.dataset, watched, 0.1, alone)}


def test_the_events_are_those_of_the_labels(recording: Recording, study: LiveStudy) -> None:
    live_events = events(recording, study)
    assert set(live_events) == {"hard_brake", "left_lane_change"}
    labels = label(recording, study.dataset.labels)
    for intention in (Intention.HARD_BRAKE, Intention.LEFT_LANE_CHANGE):
        (event,) = labels.of(intention)
        live = live_events[intention.text]
        assert (live.vehicle, live.onset, live.commit, live.end) == (
            event.vehicle, event.onset, event.commit, event.busy_until,
        )  # fmt: skip
        assert live.group == "natural"


@pytest.mark.parametrize(("missing", "counts"), [("at the onset", False), ("at the commit", False), ("before", True)])
def test_an_event_counts_if_its_vehicle_was_predicted_from_onset_to_commit(
    recording: Recording, study: LiveStudy, missing: str, counts: bool
) -> None:
    change = events(recording, study)["left_lane_change"]
    first = np.ceil(change.onset * 10) / 10
    at = {"at the onset": first, "at the commit": np.floor(change.commit * 10) / 10, "before": first - 0.1}[missing]
    decisions = ALWAYS[np.abs(ALWAYS - at) > 0.01]
    change_then = events(recording, study, decisions)["left_lane_change"]
    assert (change_then.left_out is None) == counts
    if not counts:
        assert change_then.left_out == NOT_WATCHED


def test_a_near_miss_is_neutral_and_comes_in_order_of_onset(recording: Recording, study: LiveStudy) -> None:
    """A hard brake that the labels ask too much of is a near miss, and no event."""
    labels = study.dataset.labels.model_copy(
        update={"hard_brake": study.dataset.labels.hard_brake.model_copy(update={"hold_s": 9.0})}
    )
    surroundings = Surroundings(recording)
    found = label(recording, labels, surroundings, NearMissSettings())
    live = events_of(surroundings, found, study.dataset, dict.fromkeys(recording.tracks, ALWAYS), 0.1)
    assert {event.intention: event.left_out for event in live} == {"hard_brake": NEAR_MISS, "left_lane_change": None}
    assert [event.onset for event in live] == sorted(event.onset for event in live)


@pytest.mark.parametrize("watched", [True, False])
def test_the_open_outcome_of_a_pull_out_is_named_last(recording: Recording, study: LiveStudy, watched: bool) -> None:
    """With five intentions a pulling-out with an open outcome counts, but not where nobody watched."""
    surroundings = Surroundings(recording)
    labels = study.dataset.labels
    overtake = labels.overtake.model_copy(update={"horizon_s": 300.0})
    found = label(recording, labels.model_copy(update={"overtake": overtake}), surroundings)
    decisions = dict.fromkeys(recording.tracks, ALWAYS if watched else ALWAYS[:1])
    live = events_of(surroundings, found, study.dataset, decisions, 0.1)
    (change,) = [event for event in live if event.intention == "left_lane_change"]
    assert change.left_out == ("unresolved" if watched else NOT_WATCHED)


def test_without_a_connected_vehicle_ahead_an_event_is_neutral(recording: Recording, study: LiveStudy) -> None:
    pairs = study.dataset.pairs.model_copy(update={"connected_share": 0.0})
    alone = study.model_copy(update={"dataset": study.dataset.model_copy(update={"pairs": pairs})})
    assert {event.left_out for event in events(recording, alone).values()} == {"no_uv"}
    assert {event.left_out for event in events(recording, alone, alone=True).values()} == {None}
    assert {event.left_out for event in events(recording, study, alone=True).values()} == {HAS_UV}


@pytest.mark.parametrize(("cause", "group"), [("", "commanded"), ("debris", "reaction")])
def test_an_event_under_command_or_in_a_reaction_is_so_grouped(
    recording: Recording, study: LiveStudy, cause: str, group: str
) -> None:
    brake = events(recording, study)["hard_brake"]
    command = Command(brake.vehicle, "hard_brake", brake.onset - 0.5, brake.commit + 0.5, cause=cause)
    commanded = replace(recording, commands=(command,))
    groups = {intention: event.group for intention, event in events(commanded, study).items()}
    assert groups == {"hard_brake": group, "left_lane_change": "natural"}
    times = np.array([command.start - 1.1, command.start - 0.9, command.end + 0.9, command.end + 1.1])
    number = GROUPS.index(group)  # type: ignore[arg-type]
    assert groups_at(commanded, brake.vehicle, times).tolist() == [0, number, number, 0]
    assert not groups_at(commanded, "lead0", times).any()
