"""Evasive swerves: their times, and what is not one."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.labeling.detectors.evasive_swerve import EvasiveSwerveDetector, EvasiveSwerveSettings
from isac_cosim.labeling.detectors.protocol import VehicleView, vehicle_view
from isac_cosim.labeling.intentions import Event, Intention
from tests.support.drives import WIDTH_M, Drive, Road, record, sweep, total

DETECTOR = EvasiveSwerveDetector(EvasiveSwerveSettings())


def view(lateral: object, threat: bool = False) -> VehicleView:
    """A vehicle at 30 m/s, 300 m from its start at 10 s. threat: whether another one stands still at 370 m."""
    standing = [Drive("standing", 370.0, 0.0, duration_s=30.0)] if threat else []
    return vehicle_view(record(Road(), Drive("tv", lateral=lateral, duration_s=30.0), *standing), "tv")


def swerves(lateral: object, threat: bool = False) -> list[Event]:
    return DETECTOR.detect(view(lateral, threat))


def conditioned(peak: float, duration: float) -> float:
    """The peak of a sine of that period behind the kernel of 0.15 s."""
    return float(peak * np.exp(-((2 * np.pi / duration * 0.15) ** 2) / 2))


@given(distance=st.floats(0.9, 1.7), peak=st.floats(4.2, 6.5), hold=st.floats(0.0, 1.0), left=st.booleans())
@settings(max_examples=25, deadline=None)
def test_out_and_back_is_one_swerve(distance: float, peak: float, hold: float, left: bool) -> None:
    duration = float(np.sqrt(2 * np.pi * distance / peak))
    sign = 1.0 if left else -1.0
    out, back = sweep(10.0, duration, sign * distance), sweep(10.0 + duration + hold, duration, -sign * distance)
    (event,) = swerves(total(WIDTH_M, out, back))
    assert event.intention is Intention.EVASIVE_SWERVE
    assert event.onset == pytest.approx(10.0, abs=0.35)
    assert event.commit == pytest.approx(10.0 + duration, abs=0.35)
    assert event.end == pytest.approx(10.0 + 2 * duration + hold, abs=0.35)
    assert np.sign(event.peak) == sign
    assert abs(event.peak) == pytest.approx(conditioned(peak, duration), rel=0.12)


def test_an_ordinary_lane_change_is_not_a_swerve_even_under_threat() -> None:
    assert swerves(sweep(10.0, 4.0, WIDTH_M), threat=True) == []


def test_a_swerve_on_top_of_a_lane_change_begins_with_the_swerve() -> None:
    drift = lambda t: np.clip(t - 8.5, 0.0, 1.5)  # noqa: E731
    (event,) = swerves(total(drift, sweep(10.0, 1.2, 1.2), sweep(12.0, 1.2, -1.2)))
    assert event.onset == pytest.approx(10.0, abs=0.2)


def test_a_hard_move_to_the_next_lane_is_a_swerve_only_under_threat() -> None:
    move = sweep(10.0, 2.0, WIDTH_M)
    assert swerves(move, threat=False) == []
    (event,) = swerves(move, threat=True)
    assert event.end == event.commit == pytest.approx(12.0, abs=0.3)


def test_a_return_that_stays_too_far_aside_does_not_count() -> None:
    assert swerves(total(sweep(10.0, 1.3, 1.5), sweep(12.0, 1.0, -0.5))) == []
    assert len(swerves(total(sweep(10.0, 1.3, 1.5), sweep(12.0, 1.2, -0.9)))) == 1


def test_a_twitch_does_not_go_far_enough_aside() -> None:
    twitch = view(total(sweep(10.0, 0.5, 0.35), sweep(10.5, 0.5, -0.35)), threat=True)
    threshold = float(np.abs(twitch.motion.aq).max()) * 0.8
    loose = EvasiveSwerveSettings(aside_m=0.1, threshold_mps2=threshold)
    assert EvasiveSwerveDetector(loose).detect(twitch)
    assert EvasiveSwerveDetector(EvasiveSwerveSettings(threshold_mps2=threshold)).detect(twitch) == []


def test_a_late_reversal_does_not_count() -> None:
    """The vehicle jerks aside and straightens out slowly."""
    lateral = lambda t: np.where(t < 10, 0.0, 3.0 * (1 - np.exp(-np.clip(t - 10, 0, None) / 1.5)))  # noqa: E731
    slow = view(lateral, threat=True)
    assert np.abs(slow.motion.aq).max() > 3.0
    assert DETECTOR.detect(slow) == []


def test_a_second_swing_belongs_to_the_swerve() -> None:
    (event,) = swerves(total(sweep(10.0, 1.2, 1.0), sweep(11.4, 1.4, -1.5), sweep(13.0, 1.2, 1.0)))
    assert event.end == pytest.approx(12.8, abs=0.3)


def test_a_jump_of_the_simulator_is_not_a_swerve() -> None:
    jumped = view(lambda t: np.where((t > 10) & (t < 11.5), 0.9, 0.0), threat=True)
    assert np.abs(jumped.motion.aq).max() > 3.0
    assert DETECTOR.detect(jumped) == []
    assert DETECTOR.detect(replace(jumped, motion=replace(jumped.motion, jumps=()))) != []
