"""Hard braking and hard acceleration."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.base.arrays import Array
from isac_cosim.labeling.detectors.hard_accel import HardAccelDetector, HardAccelSettings
from isac_cosim.labeling.detectors.hard_brake import HardBrakeDetector, HardBrakeSettings
from isac_cosim.labeling.detectors.protocol import Detector, vehicle_view
from isac_cosim.labeling.intentions import Event, Intention
from tests.support.drives import Drive, Road, record

BRAKE, ACCEL = HardBrakeDetector(HardBrakeSettings()), HardAccelDetector(HardAccelSettings())


def events(detector: Detector, *corners: tuple[float, float], start: float = 35.0) -> list[Event]:
    """The events that a detector finds where the acceleration is linear between corners (s, m/s2)."""

    def speed(t: Array) -> Array:
        fine = np.arange(0.0, 40.0, 0.001)
        accel = np.interp(fine, *zip(*corners, strict=True))
        return np.asarray(np.interp(t, fine, start + np.cumsum(accel) * 0.001))

    recording = record(Road(), Drive("tv", speed=speed, duration_s=38.0))
    return detector.detect(vehicle_view(recording, "tv"))


@given(peak=st.floats(4.5, 9.0), rise=st.floats(0.3, 1.5), hold=st.floats(0.8, 2.0))
@settings(max_examples=25, deadline=None)
def test_times_of_a_brake_with_a_trapezoid_of_deceleration(peak: float, rise: float, hold: float) -> None:
    (event,) = events(BRAKE, (10, 0), (10 + rise, -peak), (10 + rise + hold, -peak), (10 + 2 * rise + hold, 0))
    assert event.intention is Intention.HARD_BRAKE
    assert event.onset == pytest.approx(10 + 0.5 * rise / peak, abs=0.2)
    assert event.commit == pytest.approx(10 + 4 * rise / peak, abs=0.12)
    assert event.end == pytest.approx(10 + 2 * rise + hold - 0.5 * rise / peak, abs=0.2)
    assert event.peak == pytest.approx(-peak, rel=0.05)
    assert event.onset < event.commit < event.end


@pytest.mark.parametrize(("peak", "hold", "number"), [(3.9, 2.0, 0), (4.2, 2.0, 1), (6.0, 0.2, 0), (6.0, 0.6, 1)])
def test_a_brake_needs_the_deceleration_and_the_time(peak: float, hold: float, number: int) -> None:
    assert len(events(BRAKE, (10, 0), (10.1, -peak), (10.1 + hold, -peak), (10.2 + hold, 0))) == number


@pytest.mark.parametrize(("peak", "hold", "number"), [(2.4, 3.0, 0), (2.7, 3.0, 1), (4.0, 0.7, 0), (4.0, 1.2, 1)])
def test_an_acceleration_needs_the_size_and_the_time(peak: float, hold: float, number: int) -> None:
    accelerations = events(ACCEL, (10, 0), (10.1, peak), (10.1 + hold, peak), (10.2 + hold, 0), start=15.0)
    assert len(accelerations) == number
    assert all(event.intention is Intention.HARD_ACCEL for event in accelerations)
    assert [event.peak for event in accelerations] == pytest.approx([peak] * number, rel=0.05)


def test_a_brake_is_not_an_acceleration_nor_an_acceleration_a_brake() -> None:
    assert events(ACCEL, (10, 0), (10.5, -6), (12, -6), (12.5, 0)) == []
    assert events(BRAKE, (10, 0), (10.5, 4.5), (13, 4.5), (13.5, 0), start=10.0) == []


def test_onset_after_long_light_braking_is_three_seconds_before_the_commit() -> None:
    (event,) = events(BRAKE, (5, 0), (6, -1.0), (14, -1.0), (14.3, -6), (15.5, -6), (16, 0), start=40.0)
    assert event.onset == pytest.approx(event.commit - 3.0)


def test_pumping_the_brake_is_one_event() -> None:
    twice = [(10, 0), (10.3, -6), (11.3, -6), (11.6, -2), (11.9, -6), (12.9, -6), (13.2, 0)]
    (event,) = events(BRAKE, *twice)
    assert event.end > 13.0


def test_chatter_of_a_driver_model_is_not_a_brake() -> None:
    """The acceleration jumps between -4.5 and 2.6 m/s2 from one 0.1 s action step to the next."""
    corners = []
    for k in range(60):
        value = -4.5 if k % 2 else 2.6
        corners += [(10 + 0.1 * k, value), (10 + 0.1 * k + 0.099, value)]
    assert events(BRAKE, (0, 0), (9.9, 0), *corners, (16.1, 0)) == []
