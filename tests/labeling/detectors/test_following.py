import numpy as np
import pytest

from isacsim.traffic.recording import Recording
from labeling.detectors.following import FollowingSettings
from labeling.detectors.settings import LabelSettings
from labeling.events import label
from labeling.intentions import Event, Intention
from tests.support.drives import WIDTH_M, Drive, Road, Stretch, ramps, record, sweep

ROAD = Road((Stretch(900.0), Stretch(4.0, internal=True), Stretch(6000.0)))


def windows(recording: Recording, vehicle: str = "tv", **settings: float) -> list[Event]:
    labels = label(recording, LabelSettings(preset="mine", following=FollowingSettings(**settings)))
    return [event for event in labels.of(Intention.FOLLOWING) if event.vehicle == vehicle]


def test_steady_following_gives_windows_at_the_spacing() -> None:
    found = windows(record(ROAD, Drive("tv", 0.0, duration_s=60), Drive("lead", 60.0, duration_s=60)))
    assert [e.onset for e in found] == pytest.approx([10.0, 20.0, 30.0, 40.0, 50.0])
    assert all(e.commit == e.onset and e.other == "lead" for e in found)


def test_a_leader_beyond_the_headway_is_not_followed() -> None:
    far = record(ROAD, Drive("tv", 0.0, 30.0, duration_s=60), Drive("lead", 96.0, 30.0, duration_s=60))
    assert windows(far) == []
    assert len(windows(far, headway_s=3.1)) == 5


def test_nothing_else_within_ten_seconds() -> None:
    brake = ramps((0, 30), (30, 30), (31.5, 21), (33, 21), (36, 30), (100, 30))
    recording = record(ROAD, Drive("tv", 0.0, brake, duration_s=60), Drive("lead", 60.0, brake, duration_s=60))
    (event,) = label(recording, LabelSettings()).of(Intention.HARD_BRAKE)[:1]
    found = windows(recording)
    assert found
    assert all(e.onset <= event.onset - 10 or e.onset >= event.end + 10 for e in found)


def test_no_window_near_a_lane_change_even_one_that_was_not_completed() -> None:
    poke = ramps((0, 1.4), (29, 1.4), (30, 1.7), (31, 1.4))
    recording = record(ROAD, Drive("tv", 0.0, 30.0, poke, 60), Drive("lead", 60.0, duration_s=60))
    assert label(recording, LabelSettings()).counts["dithering"] == 2
    assert all(abs(e.onset - 30.0) > 10 for e in windows(recording))
    assert windows(recording)


def test_a_change_of_leader_within_the_window_breaks_it() -> None:
    recording = record(
        ROAD,
        Drive("tv", 0.0, duration_s=60),
        Drive("lead", 80.0, duration_s=60),
        Drive("cuts_in", 40.0, lateral=lambda t: WIDTH_M + sweep(28.0, 4.0, -WIDTH_M)(t), duration_s=60),
    )
    found = windows(recording, spacing_s=0.5)
    assert {e.other for e in found} == {"lead", "cuts_in"}
    # The cut-in crosses at 30 s; the leader is looked at every 0.5 s of the 5 s.
    assert all(abs(e.onset - 30.0) >= 2.0 for e in found)
    times = np.array([e.onset for e in found])
    assert times.min() == 10.0
    assert times.max() == 50.0
