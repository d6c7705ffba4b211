"""Lane changes: their times, and crossings that are none."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.base.arrays import Array
from isac_cosim.labeling.detectors.lane_change import LaneChangeDetector, LaneChangeSettings
from isac_cosim.labeling.detectors.protocol import VehicleView, vehicle_view
from isac_cosim.labeling.intentions import Event, Intention
from tests.support.drives import WIDTH_M, Drive, Road, Stretch, ramps, record, sweep, total

LEFT, RIGHT = Intention.LEFT_LANE_CHANGE, Intention.RIGHT_LANE_CHANGE
DETECTOR = LaneChangeDetector(LaneChangeSettings())


def view_of(lateral: object, duration_s: float = 60.0, road: Road = Road()) -> VehicleView:  # noqa: B008
    return vehicle_view(record(road, Drive("tv", lateral=lateral, duration_s=duration_s)), "tv")


def changes(lateral: object, road: Road = Road()) -> list[Event]:  # noqa: B008
    return DETECTOR.detect(view_of(lateral, 40.0, road))


def glide(start: float, accel: float, top: float, distance: float) -> tuple[float, Array, Array]:
    """A trapezoid of lateral speed, as the sublane model drives it: its duration (s), times (s) and positions (m)."""
    cruise = distance / top - top / accel
    times = np.arange(0.0, 40.0, 0.001)
    corners = start + np.cumsum([0.0, top / accel, cruise, top / accel])
    speed = np.interp(times, corners, [0.0, top, top, 0.0])
    return float(corners[-1] - corners[0]), times, np.cumsum(speed) * 0.001


@given(accel=st.floats(0.6, 1.6), top=st.floats(0.8, 1.2), left=st.booleans())
@settings(max_examples=25, deadline=None)
def test_times_of_a_lane_change_with_a_trapezoid_of_speed(accel: float, top: float, left: bool) -> None:
    duration, times, y = glide(10.0, accel, top, WIDTH_M)
    base, sign = (0.0, 1.0) if left else (WIDTH_M, -1.0)
    (event,) = changes(lambda t: base + sign * np.interp(t, times, y))
    assert event.intention is (LEFT if left else RIGHT)
    # The ramp reaches 0.2 m/s after 0.2 / accel; the kernel blurs its start by less than the kernel width.
    assert event.onset == pytest.approx(10.0 + 0.2 / accel, abs=0.15)
    assert event.commit == pytest.approx(10.0 + duration / 2, abs=0.02)
    assert event.end == pytest.approx(10.0 + duration - 0.2 / accel, abs=0.15)
    assert abs(event.peak) == pytest.approx(accel, rel=0.15)
    leaves_band = times[np.flatnonzero(y > 0.05)[0]]
    assert abs(event.onset - leaves_band) < 0.2


def test_a_centre_across_for_less_than_a_second_is_no_change() -> None:
    def poke(hold: float) -> object:
        return total(1.2, ramps((10.0, 0.0), (10.5, 0.6), (10.5 + hold, 0.6), (11.0 + hold, 0.0)))

    assert changes(poke(0.5)) == []
    assert [event.intention for event in changes(poke(1.5))] == [LEFT, RIGHT]


def test_dithering_before_the_change_counts_once() -> None:
    lateral = total(1.55, ramps((10, 0.0), (10.2, 0.2), (10.4, 0.0), (10.6, 0.2), (10.8, 0.0), (11.0, 0.2), (14, 1.65)))
    crossings = DETECTOR.crossings(view_of(lateral).motion)
    assert [crossing.left for crossing in crossings.completed] == [True]
    assert crossings.completed[0].time == pytest.approx(10.85, abs=0.02)
    assert (crossings.dithering, crossings.cut_off) == (4, 0)


def test_a_crossing_just_before_the_end_of_the_track_is_cut_off() -> None:
    crossings = DETECTOR.crossings(view_of(sweep(10.0, 4.0, WIDTH_M), 12.5).motion)
    assert (crossings.completed, crossings.dithering, crossings.cut_off) == ([], 0, 1)


@pytest.mark.parametrize(("after_s", "completed"), [(0.97, 0), (0.99, 0), (1.0, 1), (1.01, 1), (1.04, 1)])
def test_the_second_across_counts_up_to_the_very_end_of_the_track(after_s: float, completed: int) -> None:
    lateral = ramps((10.0, 0.0), (14.0, WIDTH_M))
    (crossing,) = view_of(lateral, 20.0).motion.crossings
    crossings = DETECTOR.crossings(view_of(lateral, round(crossing.time + after_s, 2)).motion)
    assert (len(crossings.completed), crossings.cut_off) == (completed, 1 - completed)


def test_two_lanes_in_one_motion_are_two_changes_separated_at_the_middle_lane() -> None:
    first, second = changes(ramps((10.0, 0.0), (16.4, 2 * WIDTH_M)))
    assert first.intention is second.intention is LEFT
    assert [first.commit, second.commit] == pytest.approx([11.6, 14.8], abs=0.02)
    assert first.end == second.onset == pytest.approx(13.2, abs=0.03)


def test_a_short_pause_does_not_hide_the_first_motion_and_a_long_one_does() -> None:
    def paused(pause: float) -> object:
        return ramps((10.0, 0.0), (11.0, 1.0), (11.0 + pause, 1.0), (13.0 + pause, 3.2))

    assert changes(paused(0.4))[0].onset == pytest.approx(10.0, abs=0.2)
    assert changes(paused(2.0))[0].onset == pytest.approx(13.0, abs=0.2)


@given(curvature=st.floats(-0.01, 0.01), length=st.floats(20.0, 200.0), wobble=st.floats(0.0, 1.0))
@settings(max_examples=25, deadline=None)
def test_driving_within_the_lane_through_bends_and_junctions_is_no_change(
    curvature: float, length: float, wobble: float
) -> None:
    stretches = (Stretch(length), Stretch(3.0, internal=True), Stretch(200.0, (-1, 0, 1)), Stretch(5000.0))
    lateral = lambda t: wobble * np.sin(0.7 * t)  # noqa: E731
    assert changes(lateral, road=Road(stretches, curvature)) == []
