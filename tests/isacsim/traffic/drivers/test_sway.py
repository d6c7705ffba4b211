"""Sway: its spread and spectrum, where it fades, and that it triggers no events."""

import numpy as np
import pytest

from isac_cosim.base.seeding import stream
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.drivers.sway import SwaySettings, add_sway, sway, wandering
from isac_cosim.isacsim.traffic.recordings.recording import Track
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Intention

STEP = 0.01
LANES = (
    Lane("e_0", "e", 0, 3.6, 9e4, np.array([[0.0, 1.8], [9e4, 1.8]]), ()),
    Lane("e_1", "e", 1, 3.6, 9e4, np.array([[0.0, 5.4], [9e4, 5.4]]), ()),
)
NONE = ManeuverSettings(**{name: 0.0 for name in ManeuverSettings.model_fields if name.endswith("_hour")})


def track(speed: np.ndarray, change_row: int | None = None, width_m: float = 1.8) -> Track:
    x = np.cumsum(speed) * STEP
    lane, lateral = np.zeros(len(x), np.int64), np.zeros(len(x))
    if change_row is not None:
        lane[change_row:] = 1
        lateral = np.clip((np.arange(len(x)) - change_row) * STEP, -1.8, 1.8) * 1.0
        lateral[change_row:] -= 3.6
        lateral[np.abs(np.arange(len(x)) - change_row) > 180] = 0.0
    y = np.array([1.8, 5.4])[lane] + lateral
    return Track("v", "passenger", 4.5, width_m, 0, x.copy(), y, speed, lane, x.copy(), lateral)


def test_the_process_has_unit_variance_and_the_correlation_of_two_lags() -> None:
    """The autocorrelation of noise through two lags a and b is (a e^(-t/a) - b e^(-t/b)) / (a - b)."""
    settings = SwaySettings()
    values = wandering(400_000, 0.1, settings.lags_s, np.random.default_rng(1))
    assert values.std() == pytest.approx(1.0, rel=0.05)
    slow, fast = settings.wander_s, settings.steering_s
    for lag_s in (0.5, 2.0, 5.0):
        lag = round(lag_s / 0.1)
        measured = float(np.mean(values[lag:] * values[:-lag]))
        expected = (slow * np.exp(-lag_s / slow) - fast * np.exp(-lag_s / fast)) / (slow - fast)
        assert measured == pytest.approx(expected, abs=0.05)


def test_each_driver_sways_by_its_own_measure_within_the_lane() -> None:
    spreads, slow_spreads = [], []
    for seed in range(60):
        values = sway(track(np.full(12_000, 25.0)), np.full(12_000, 3.6), STEP, SwaySettings(), stream("test", seed))
        spreads.append(values.std())
        truck = track(np.full(12_000, 25.0), width_m=2.5)
        slow_spreads.append(sway(truck, np.full(12_000, 3.2), STEP, SwaySettings(), stream("test", seed)).std())
    assert 0.14 < np.sqrt(np.mean(np.square(spreads))) < 0.24
    assert max(slow_spreads) < 0.4 * 0.35 * 2.0


def test_in_a_narrow_lane_a_driver_sways_by_what_room_there_is() -> None:
    """A truck of 2.5 m comes into a lane of 2.75 m, and out of it: beside it are 12.5 cm, of which it uses 5 cm."""
    widths_m = np.full(36_000, 3.75)
    widths_m[12_000:24_000] = 2.75
    truck = track(np.full(36_000, 25.0), width_m=2.5)
    narrow, before, after = [], [], []
    for seed in range(30):
        values = sway(truck, widths_m, STEP, SwaySettings(), stream("narrow", seed))
        wide = sway(truck, np.full(36_000, 3.75), STEP, SwaySettings(), stream("narrow", seed))
        narrow.append(values[12_000:24_000].std())
        before.append(np.ptp((values - wide)[:11_000]))
        after.append(np.ptp((values - wide)[25_000:]))
        assert np.abs(np.diff(values)).max() / STEP < 0.6
    assert np.sqrt(np.mean(np.square(narrow))) < 0.06
    assert max(*before, *after) < 1e-12


def test_a_vehicle_that_stands_keeps_its_place() -> None:
    speed = np.concatenate([np.full(2000, 20.0), np.zeros(2000)])
    values = sway(track(speed), np.full(4000, 3.6), STEP, SwaySettings(), stream("test", 1))
    assert np.ptp(values[:2000]) > 0.1
    assert np.ptp(values[2000:]) == 0.0


def test_it_fades_where_a_marking_is_crossed_and_moves_all_states_alike() -> None:
    moved = track(np.full(4000, 25.0), change_row=2000)
    before = {name: getattr(moved, name).copy() for name in ("x", "y", "lane_lat", "lane_pos", "speed")}
    add_sway([moved], LANES, STEP, SwaySettings(), False, "road", 7)
    shift = moved.lane_lat - before["lane_lat"]
    np.testing.assert_allclose(moved.y - before["y"], shift, atol=1e-12)
    for name in ("x", "lane_pos", "speed"):
        np.testing.assert_allclose(getattr(moved, name), before[name], atol=1e-12)
    assert np.abs(shift[1995:2005]).max() < 1e-5
    assert np.abs(shift[:1500]).max() > 0.03
    again = track(np.full(4000, 25.0), change_row=2000)
    add_sway([again], LANES, STEP, SwaySettings(), False, "road", 7)
    np.testing.assert_array_equal(again.lane_lat, moved.lane_lat)
    mirrored = track(np.full(4000, 25.0), change_row=2000)
    add_sway([mirrored], LANES, STEP, SwaySettings(), True, "road", 7)
    np.testing.assert_allclose(mirrored.lane_lat - before["lane_lat"], -shift, atol=1e-12)
    untouched = track(np.full(4000, 25.0), change_row=2000)
    add_sway([untouched], LANES, STEP, SwaySettings(sd_m=(0.0, 0.0)), False, "road", 7)
    np.testing.assert_array_equal(untouched.lane_lat, before["lane_lat"])


@pytest.mark.slow
def test_swaying_drivers_have_the_events_of_those_that_do_not() -> None:
    """An hour of natural driving on the motorway, with and without sway: the same events, at nearly the same times."""
    hours, only_with, only_without, common, shifts = 0.0, 0, 0, 0, []
    for seed in range(1, 9):
        pair = []
        for settings in (SwaySettings(sd_m=(0.0, 0.0)), SwaySettings()):
            recording = record(load("motorway"), seed, TrafficSettings(duration_s=60.0, sway=settings), NONE)
            events = label(recording, LabelSettings()).events
            pair.append([event for event in events if event.intention is not Intention.FOLLOWING])
        hours += sum(len(t) for t in recording.tracks.values()) * STEP / 3600.0
        left = list(pair[0])
        for event in pair[1]:
            same = [e for e in left if (e.vehicle, e.intention) == (event.vehicle, event.intention)]
            match = min(same, key=lambda e: abs(e.commit - event.commit), default=None)
            if match is None or abs(match.commit - event.commit) > 0.5:
                only_with += 1
                continue
            left.remove(match)
            common += 1
            shifts.append(event.onset - match.onset)
        only_without += len(left)
    print(f"\n{hours:.1f} vehicle-hours: {common} events in both, {only_with} only with sway, {only_without} without")
    print("onset with sway minus without, s, 5, 50, 95 %:", np.quantile(shifts, [0.05, 0.5, 0.95]).round(2))
    assert hours > 1.0
    assert only_with <= 0.01 * common
    assert only_without <= 0.01 * common
