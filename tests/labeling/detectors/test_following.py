"""Following: where it is found, and what interrupts it."""

from dataclasses import replace

import numpy as np
import pytest

from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.following import FollowingDetector, FollowingSettings
from isac_cosim.labeling.detectors.protocol import vehicle_view
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Event, Intention
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


@pytest.mark.parametrize(("speed", "lead_m", "count"), [(30.0, 4.0, 0), (30.0, 6.0, 5), (0.0, 4.0, 0), (0.0, 6.0, 0)])
def test_a_vehicle_alongside_is_no_leader_and_one_that_stands_follows_nobody(
    speed: float, lead_m: float, count: int
) -> None:
    """Vehicles are 5 m long: 4 m apart, they stand side by side in a wide lane."""
    recording = record(ROAD, Drive("tv", 0.0, speed, duration_s=60), Drive("lead", lead_m, speed, duration_s=60))
    assert len(followings(recording)) == count


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


def wobble(times: np.ndarray) -> np.ndarray:
    """A lateral position that drifts at 0.3 m/s for a second around 30 s."""
    return np.interp(times, [29.5, 30.5], [-0.15, 0.15])


UNSTEADY = {
    "lateral_mps": Drive("tv", 0.0, 30.0, wobble, 60),
    "acceleration_mps2": Drive("tv", 0.0, ramps((0, 30), (29.5, 30), (30.5, 27), (60, 27)), duration_s=60),
}
"""A vehicle that drives steadily but around 30 s: it moves aside at 0.3 m/s, or slows down at 3 m/s2."""


@pytest.mark.parametrize("bound", UNSTEADY)
def test_no_following_while_the_vehicle_is_unsteady(bound: str) -> None:
    """Records of 5 s with 2.6 s before the instant hold none of it, wherever a shift of up to 0.2 s moves them."""
    recording = record(ROAD, UNSTEADY[bound], Drive("lead", 70.0, 28.5, duration_s=60))
    labels = label(recording, LabelSettings())
    assert not [e for e in labels.events if e.vehicle == "tv" and e.intention is not Intention.FOLLOWING]
    onsets = np.array([event.onset for event in followings(recording, spacing_s=0.5)])
    assert np.all((onsets + 2.6 <= 29.5) | (onsets - 2.8 >= 30.5))
    assert onsets.min() < 27.0
    assert onsets.max() > 33.0
    settings = FollowingSettings(spacing_s=0.5).model_copy(update={bound: None})
    unbounded = label(recording, LabelSettings(preset="other", following=settings)).of(Intention.FOLLOWING)
    assert 30.0 in {event.onset for event in unbounded}


def test_every_record_of_following_is_steady() -> None:
    """A vehicle that drifts and slows down a little all the time: what is kept stays within both bounds."""
    tv = Drive(
        "tv",
        0.0,
        lambda t: 30.0 + 1.5 * np.sin(0.9 * t) * np.sin(0.05 * t),
        lambda t: 0.6 * np.sin(0.5 * t) * np.sin(0.03 * t),
        100.0,
    )
    recording = record(ROAD, tv, Drive("lead", 60.0, 30.0, duration_s=100))
    events = followings(recording, spacing_s=0.5)
    assert 10 < len(events) < 140
    track, times = recording.tracks["tv"], recording.times(recording.tracks["tv"])
    for event in events:
        inside = (times > event.onset - 2.8) & (times < event.onset + 2.6)
        assert np.abs(np.gradient(track.lane_lat, 0.01)[inside]).max() < 0.21
        assert np.abs(np.gradient(track.speed, 0.01)[inside]).max() < 2.1


@pytest.mark.parametrize("seed", range(5))
def test_it_stands_at_the_first_instants_around_which_every_sample_is_steady(seed: int) -> None:
    """Each instant is looked at by itself; the leader never changes."""
    settings = FollowingSettings(clear_s=0.0, spacing_s=1.0)
    view = vehicle_view(record(ROAD, Drive("tv", 0.0, duration_s=60), Drive("lead", 60.0, duration_s=60)), "tv")
    rng, times = np.random.default_rng(seed), view.motion.times
    hasty = rng.random((2, len(times))) < 0.004
    motion = replace(view.motion, vq=np.where(hasty[0], -0.21, 0.2), a=np.where(hasty[1], -2.1, 2.0))
    expected: list[float] = []
    for time in np.arange(0.0, times[-1], settings.check_s):
        during = (times >= time - settings.before_s) & (times <= time + settings.after_s)
        on_road = times[0] <= time - settings.before_s and time + settings.after_s <= times[-1]
        spaced = not expected or time - expected[-1] >= settings.spacing_s
        if on_road and spaced and not hasty[:, during].any():
            expected.append(float(time))
    assert 0 < len(expected) < 50
    events = FollowingDetector(settings).detect(replace(view, motion=motion))
    assert [event.onset for event in events] == expected
