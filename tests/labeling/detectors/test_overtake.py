"""Overtakes: the verdict on a left lane change, and which pair it is about."""

import pytest

from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.detectors.events import Labels, label
from isac_cosim.labeling.detectors.overtake import OvertakeDetector, OvertakeSettings
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Event, Intention
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.samples.candidates import for_pair
from tests.support.drives import WIDTH_M, Drive, Road, Stretch, record, sweep, total

ROAD = Road((Stretch(700.0), Stretch(6.0, internal=True), Stretch(250.0, (-1, 0, 1, 2)), Stretch(6000.0)))


def traffic(
    returns_at: float | None,
    gap: float = 40.0,
    tv_speed: float = 32.0,
    uv_speed: float = 24.0,
    duration_s: float = 70.0,
) -> Recording:
    """A vehicle pulls out at 10 s, its front `gap` m behind that of a slower one, and returns later."""
    lateral = sweep(10.0, 4.0, WIDTH_M)
    if returns_at is not None:
        lateral = total(lateral, sweep(returns_at, 4.0, -WIDTH_M))
    return record(
        ROAD,
        Drive("tv", 0.0, tv_speed, lateral, duration_s),
        Drive("uv", gap + 10 * (tv_speed - uv_speed), uv_speed, 0.0, duration_s),
    )


def pulling_out(recording: Recording) -> tuple[Event, Labels]:
    labels = label(recording, LabelSettings())
    left = [event for event in labels.events if event.intention in (Intention.LEFT_LANE_CHANGE, Intention.OVERTAKE)]
    assert len(left) == 1
    return left[0], labels


def test_divert_pass_return_is_an_overtake_of_that_vehicle() -> None:
    event, labels = pulling_out(traffic(returns_at=20.0))
    assert event.intention is Intention.OVERTAKE
    assert event.other == "uv"
    assert event.commit == pytest.approx(12.0, abs=0.03)
    assert event.end == pytest.approx(22.0, abs=0.03)
    assert event.busy_until == pytest.approx(13.6, abs=0.2)  # slower than 0.2 m/s from there on
    assert [event.commit for event in labels.of(Intention.RIGHT_LANE_CHANGE)] == [event.end]


def test_return_before_passing_is_a_left_lane_change() -> None:
    event, _ = pulling_out(traffic(returns_at=13.0))
    assert (event.intention, event.mark) == (Intention.LEFT_LANE_CHANGE, None)


@pytest.mark.parametrize("returns_at", [None, 42.0])
def test_pass_without_return_in_time_is_marked(returns_at: float | None) -> None:
    event, _ = pulling_out(traffic(returns_at))
    assert (event.intention, event.mark, event.other) == (Intention.LEFT_LANE_CHANGE, "passed_did_not_return", "uv")


def test_no_pass_within_the_horizon_is_a_left_lane_change() -> None:
    event, _ = pulling_out(traffic(None, tv_speed=25.0, uv_speed=24.5))
    assert (event.intention, event.mark) == (Intention.LEFT_LANE_CHANGE, None)


@pytest.mark.parametrize("duration_s", [18.0, 30.0])
def test_end_of_the_track_before_the_outcome_is_unresolved(duration_s: float) -> None:
    event, _ = pulling_out(traffic(None, duration_s=duration_s))
    assert event.mark == "unresolved"


@pytest.mark.parametrize(("duration_s", "mark"), [(13.5, None), (18.0, "passed_did_not_return")])
def test_a_short_track_may_be_judged_by_what_is_seen_of_it(duration_s: float, mark: str | None) -> None:
    """The vehicle crosses the marking at 12 s, and its rear has passed the other's front at about 16 s."""
    settings = LabelSettings.model_validate({"preset": "isac-2-as-seen"})
    assert settings.overtake.judged == "track"
    labels = label(traffic(None, duration_s=duration_s), settings)
    [event] = [event for event in labels.events if event.intention in (Intention.LEFT_LANE_CHANGE, Intention.OVERTAKE)]
    assert (event.intention, event.mark) == (Intention.LEFT_LANE_CHANGE, mark)
    whole = label(traffic(returns_at=20.0), settings)
    assert len(whole.of(Intention.OVERTAKE)) == 1


@pytest.mark.parametrize(("returns_at", "duration_s"), [(20.0, 70.0), (None, 70.0), (None, 18.0)])
def test_every_pull_out_may_be_a_lane_change(returns_at: float | None, duration_s: float) -> None:
    settings = LabelSettings.model_validate({"preset": "isac-2-one-change"})
    recording = traffic(returns_at, duration_s=duration_s)
    labels = label(recording, settings)
    [event] = labels.of(Intention.LEFT_LANE_CHANGE)
    assert (event.mark, labels.of(Intention.OVERTAKE)) == (None, [])
    for_uv = for_pair(Surroundings(recording), labels, event, "uv")
    assert (for_uv.intention, for_uv.mark) == (Intention.LEFT_LANE_CHANGE, None)


def test_passing_is_by_the_rear_over_the_front() -> None:
    """A vehicle that returns before its rear has passed the other's front has passed nothing."""
    recording = traffic(returns_at=14.6, gap=40.0)
    changes = label(recording, LabelSettings()).changes["tv"]
    # The fronts are level at 10 + 40 / 8 = 15 s, the rear is past at 15.6 s; the return crosses at 16.6 s.
    overtake = OvertakeDetector(OvertakeSettings())
    assert overtake.outcome(Surroundings(recording), changes, changes[0], "uv").verdict == "overtaken"
    earlier = traffic(returns_at=13.4, gap=40.0)
    changes = label(earlier, LabelSettings()).changes["tv"]
    assert overtake.outcome(Surroundings(earlier), changes, changes[0], "uv").verdict == "not_passed"


def test_an_overtake_is_about_the_pair() -> None:
    """The same left lane change overtakes the slow vehicle, but not the one far ahead nor the one behind."""
    recording = traffic(returns_at=20.0)
    extra = record(ROAD, Drive("far", 400.0, 32.0), Drive("behind", -0.0, 20.0, lateral=2 * WIDTH_M))
    recording = Recording("scripted", 7, 0.01, recording.lanes, {**extra.tracks, **recording.tracks})
    surroundings, changes = Surroundings(recording), label(recording, LabelSettings()).changes["tv"]
    overtake = OvertakeDetector(OvertakeSettings())
    verdicts = {other: overtake.outcome(surroundings, changes, changes[0], other).verdict for other in extra.tracks}
    assert verdicts == {"far": "not_passed", "behind": "not_passed"}


def test_two_lanes_out_and_one_back_is_not_back() -> None:
    lateral = total(sweep(10.0, 4.0, WIDTH_M), sweep(16.0, 4.0, WIDTH_M), sweep(22.0, 4.0, -WIDTH_M))
    recording = record(ROAD, Drive("tv", 0.0, 32.0, lateral, 70.0), Drive("uv", 120.0, 24.0, 0.0, 70.0))
    first, *_ = label(recording, LabelSettings()).events
    assert first.mark == "passed_did_not_return"


def test_free_road_ahead_is_a_left_lane_change() -> None:
    event, _ = pulling_out(record(ROAD, Drive("tv", 0.0, 32.0, sweep(10.0, 4.0, WIDTH_M), 20.0)))
    assert (event.intention, event.mark, event.other) == (Intention.LEFT_LANE_CHANGE, None, None)
