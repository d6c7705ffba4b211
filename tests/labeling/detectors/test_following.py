"""Following: where it is found, and what interrupts it."""

import numpy as np
import pytest

from isacsim.traffic.recording import Recording
from labeling.detectors.following import FollowingSettings
from labeling.detectors.settings import LabelSettings
from labeling.events import label
from labeling.intentions import Event, Intention
from tests.support.drives import WIDTH_M, Drive, Road, Stretch, ramps, record, sweep

ROAD = Road((Stretch(900.0), Stretch(4.0, internal=True), Stretch(6000.0)))


def followings(recording: Recording, vehicle: str = "tv", **settings: float) -> list[Event]:
    labels = label(recording, LabelSettings(preset="other", following=FollowingSettings(**settings)))
    return [event for event in labels.of(Intention.FOLLOWING) if event.vehicle == vehicle]


def test_steady_following_gives_events_at_the_spacing() -> None:
    events = followings(record(ROAD, Drive("tv", 0.0, duration_s=60), Drive("lead", 60.0, duration_s=60)))
    assert [event.onset for event in events] == pytest.approx([10.0, 20.0, 30.0, 40.0, 50.0])
    assert all(event.commit == event.onset and event.other == "lead" for event in events)


def test_a_leader_beyond_the_headway_is_not_followed() -> None:
    far = record(ROAD, Drive("tv", 0.0, 30.0, duration_s=60), Drive("lead", 96.0, 30.0, duration_s=60))
    assert followings(far) == []
    assert len(followings(far, headway_s=3.1)) == 5


def test_nothing_else_within_ten_seconds() -> None:
    brake = ramps((0, 30), (30, 30), (31.5, 21), (33, 21), (36, 30), (100, 30))
    recording = record(ROAD, Drive("tv", 0.0, brake, duration_s=60), Drive("lead", 60.0, brake, duration_s=60))
    brake = label(recording, LabelSettings()).of(Intention.HARD_BRAKE)[0]
    events = followings(recording)
    assert events
    assert all(event.onset <= brake.onset - 10 or event.onset >= brake.end + 10 for event in events)


def test_no_following_near_a_crossing_even_one_that_is_no_lane_change() -> None:
    poke = ramps((0, 1.4), (29, 1.4), (30, 1.7), (31, 1.4))
    recording = record(ROAD, Drive("tv", 0.0, 30.0, poke, 60), Drive("lead", 60.0, duration_s=60))
    assert label(recording, LabelSettings()).counts["dithering"] == 2
    assert all(abs(event.onset - 30.0) > 10 for event in followings(recording))
    assert followings(recording)


def test_a_change_of_leader_meanwhile_breaks_it() -> None:
    recording = record(
        ROAD,
        Drive("tv", 0.0, duration_s=60),
        Drive("lead", 80.0, duration_s=60),
        Drive("cuts_in", 40.0, lateral=lambda t: WIDTH_M + sweep(28.0, 4.0, -WIDTH_M)(t), duration_s=60),
    )
    events = followings(recording, spacing_s=0.5)
    assert {event.other for event in events} == {"lead", "cuts_in"}
    # The vehicle cuts in at 30 s; the leader is checked every 0.5 s of the 5 s.
    assert all(abs(event.onset - 30.0) >= 2.0 for event in events)
    times = np.array([event.onset for event in events])
    assert times.min() == 10.0
    assert times.max() == 50.0
