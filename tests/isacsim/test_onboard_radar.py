"""The onboard radar: its accuracy, what each condition takes away, and whom it sees."""

import numpy as np
import pytest

from isacsim.errors import InputError
from isacsim.onboard_radar import Carrier, RadarSettings, _scan, sense_onboard
from isacsim.radio.blockage import TRUCK_HEIGHT_M, Blockers
from tests.support.sensing_road import RATE_HZ, drive, hard_brake

RECORDS = 8
KEYS = [("radar", k) for k in range(RECORDS)]


def scene(gap: float = 30.0, snapshots: int = 2000) -> tuple[np.ndarray, Carrier]:
    """A TV that brakes hard behind a UV that drives on at its first speed."""
    truth = np.stack([hard_brake(snapshots)] * RECORDS)
    time = np.arange(snapshots // 4) / 100
    own = np.zeros((RECORDS, 6, len(time)))
    own[:, 0] = truth[0, 0, 0] + gap + 30 * time
    own[:, 1] = truth[0, 1, 0]
    own[:, 2] = 30
    return truth, Carrier(own, 100.0)


def rms(records: list, truth: np.ndarray, part: slice) -> float:
    return float(np.sqrt(np.mean((np.stack([r.state for r in records]) - truth)[:, part] ** 2)))


def test_clear_weather_is_as_accurate_as_the_radar() -> None:
    truth, own = scene()
    records = sense_onboard(truth, RATE_HZ, own, RadarSettings(), KEYS)
    assert all(r.usable and r.n_sites == 1 and r.detected > 0.95 for r in records)
    assert rms(records, truth, slice(0, 2)) < 0.2
    assert rms(records, truth, slice(2, 4)) < 0.4
    # About 0.4 m along the line of sight before the filter, seen where a cycle was measured.
    raw = (np.stack([r.fixes for r in records]) - truth[:, :4])[:, 0]
    changed = np.diff(np.stack([r.fixes for r in records])[:, 0], axis=1) != 0
    assert raw[:, 1:][changed].std() == pytest.approx(0.4, rel=0.15)


@pytest.mark.parametrize("pattern", ["random", "contiguous"])
def test_partial_sight_drops_three_quarters(pattern: str) -> None:
    truth, own = scene()
    clear = sense_onboard(truth, RATE_HZ, own, RadarSettings(), KEYS)
    partial = sense_onboard(truth, RATE_HZ, own, RadarSettings(condition="nlos", pattern=pattern), KEYS)
    assert [r.detected for r in partial] == pytest.approx([0.25] * RECORDS, abs=0.03)
    assert rms(partial, truth, slice(0, 2)) > 1.5 * rms(clear, truth, slice(0, 2))
    longest = [
        np.diff(np.flatnonzero(np.diff(r.fixes[0]) != 0), prepend=0, append=2000).max() / RATE_HZ for r in partial
    ]
    if pattern == "random":
        assert max(longest) < 2
    else:
        assert min(longest) > 0.75 * 5 - 0.2


def test_weather_takes_20_db_and_cycles() -> None:
    truth, own = scene()
    clear = sense_onboard(truth, RATE_HZ, own, RadarSettings(), KEYS)
    weather = sense_onboard(truth, RATE_HZ, own, RadarSettings(condition="weather"), KEYS)
    assert clear[0].snr_db - weather[0].snr_db == pytest.approx(20)
    assert np.mean([r.detected for r in weather]) == pytest.approx(0.7, abs=0.1)
    assert rms(weather, truth, slice(0, 2)) > rms(clear, truth, slice(0, 2))


def test_rain_at_77_ghz_is_felt() -> None:
    truth, own = scene(gap=100.0)
    dry = sense_onboard(truth[:1], RATE_HZ, Carrier(own.state[:1], 100.0), RadarSettings(), KEYS[:1])
    wet = sense_onboard(truth[:1], RATE_HZ, Carrier(own.state[:1], 100.0), RadarSettings(rain_mm_per_h=50), KEYS[:1])
    distance = np.mean(np.abs(truth[0, 0] - np.interp(np.arange(2000) / 400, np.arange(500) / 100, own.state[0, 0])))
    assert dry[0].snr_db - wet[0].snr_db == pytest.approx(2 * distance / 1000 * 18.8, rel=0.15)


def test_a_truck_between_the_two_takes_the_line_of_sight() -> None:
    truth, own = scene(gap=60.0)
    moving = np.arange(500) * 0.3
    truck = Blockers(
        ["t"],
        0.01,
        truth[0, 0, 0] + 30 + moving[None],
        np.full((1, 500), truth[0, 1, 0]),
        np.tile([1.0, 0.0], (1, 500, 1)),
        np.array([12.0]),
        np.array([2.5]),
        np.array([TRUCK_HEIGHT_M]),
    )
    settings = RadarSettings(condition="nlos", pattern="line_of_sight")
    hidden = sense_onboard(truth, RATE_HZ, own, settings, KEYS, [truck] * RECORDS)
    assert all(r.detected == 0 for r in hidden)
    beside = Blockers(["t"], 0.01, truck.x, truck.y + 5, truck.heading, truck.length_m, truck.width_m, truck.height_m)
    assert all(r.detected > 0.95 for r in sense_onboard(truth, RATE_HZ, own, settings, KEYS, [beside] * RECORDS))


def test_a_forward_radar_does_not_see_behind() -> None:
    truth, own = scene()
    behind = sense_onboard(truth, RATE_HZ, own, RadarSettings(half_width_deg=60), KEYS)
    assert not any(r.usable for r in behind)
    assert all(np.isfinite(r.state).all() for r in behind)
    ahead, own = scene(gap=-60.0, snapshots=400)
    assert all(r.usable for r in sense_onboard(ahead, RATE_HZ, own, RadarSettings(half_width_deg=60), KEYS))


def test_the_fixes_say_how_good_they_are() -> None:
    """Position errors against their covariance; a TV in the next lane, at every bearing of a passing."""
    time_s = np.arange(8000) / RATE_HZ
    tv = drive(8000, -40.0, 3.5, 29.0)
    own = np.stack([25 * time_s, np.zeros(8000), np.full(8000, 25.0), np.zeros(8000)])
    values = []
    for k in range(20):
        fixes = _scan(tv, time_s, own, RadarSettings(), ("nees", k), None).fixes
        error = (fixes.state - tv[:4].T)[fixes.valid]
        information = np.linalg.inv(fixes.covariance[fixes.valid])
        values.append(np.einsum("na,nab,nb->n", error[:, :2], information[:, :2, :2], error[:, :2]))
    assert np.concatenate(values).mean() == pytest.approx(2, rel=0.06)


def test_a_record_does_not_depend_on_its_company() -> None:
    truth, own = scene(snapshots=400)
    together = sense_onboard(truth, RATE_HZ, own, RadarSettings(condition="weather"), KEYS)
    alone = sense_onboard(
        truth[5:6], RATE_HZ, Carrier(own.state[5:6], 100.0), RadarSettings(condition="weather"), KEYS[5:6]
    )
    assert np.array_equal(alone[0].state, together[5].state)


def test_arguments_that_do_not_fit_are_refused() -> None:
    truth, own = scene(snapshots=400)
    with pytest.raises(InputError, match="one of each"):
        sense_onboard(truth, RATE_HZ, own, RadarSettings(), KEYS[:2])
    with pytest.raises(InputError, match="line_of_sight"):
        sense_onboard(truth, RATE_HZ, own, RadarSettings(condition="nlos", pattern="line_of_sight"), KEYS)
