"""The onboard radar: its accuracy, what each condition takes away, and what it sees."""

from dataclasses import replace

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.radio.blockage import TRUCK_HEIGHT_M, Blockers
from isac_cosim.isacsim.sensing.onboard_radar import (
    RADAR_PRESETS,
    UNKNOWN_SPEED_MPS,
    Cycles,
    Pose,
    RadarSettings,
    azimuth_deviation,
    scan,
)
from isac_cosim.isacsim.sensing.passages import Carrier, Passage, WatchedTraffic
from isac_cosim.isacsim.sensing.sensors import watch
from isac_cosim.isacsim.sensing.sensors.protocol import SensorSettings
from tests.support.sensing_road import RATE_HZ, drive, hard_brake, sense_onboard

RECORDS = 8
KEYS = [("radar", k) for k in range(RECORDS)]


def scene(gap: float = 30.0, snapshots: int = 2000) -> tuple[np.ndarray, list[Carrier]]:
    """A TV that brakes hard behind a UV that drives on at its first speed."""
    truth = np.stack([hard_brake(snapshots)] * RECORDS)
    time = np.arange(snapshots // 4) / 100
    state = np.zeros((6, len(time)))
    state[0] = truth[0, 0, 0] + gap + 30 * time
    state[1] = truth[0, 1, 0]
    state[2] = 30
    return truth, [Carrier(state, 100.0)] * RECORDS


def rms(records: list, truth: np.ndarray, part: slice) -> float:
    return float(np.sqrt(np.mean((np.stack([r.state for r in records]) - truth)[:, part] ** 2)))


def test_clear_weather_is_as_accurate_as_the_radar() -> None:
    truth, carriers = scene()
    records = sense_onboard(truth, carriers, RadarSettings(), KEYS)
    assert all(r.usable and r.n_sites == 0 and r.detected > 0.95 for r in records)
    assert rms(records, truth, slice(0, 2)) < 0.2
    assert rms(records, truth, slice(2, 4)) < 0.4
    # About 0.4 m along the line of sight before the filter, seen where a cycle was measured.
    raw = (np.stack([r.fixes for r in records]) - truth[:, :4])[:, 0]
    changed = np.diff(np.stack([r.fixes for r in records])[:, 0], axis=1) != 0
    assert raw[:, 1:][changed].std() == pytest.approx(0.4, rel=0.15)


@pytest.mark.parametrize("pattern", ["random", "contiguous"])
def test_partial_sight_drops_three_quarters(pattern: str) -> None:
    truth, carriers = scene()
    clear = sense_onboard(truth, carriers, RadarSettings(), KEYS)
    partial = sense_onboard(truth, carriers, RadarSettings(condition="nlos", pattern=pattern), KEYS)
    assert [r.detected for r in partial] == pytest.approx([0.25] * RECORDS, abs=0.03)
    assert rms(partial, truth, slice(0, 2)) > 1.5 * rms(clear, truth, slice(0, 2))
    longest = [
        np.diff(np.flatnonzero(np.diff(r.fixes[0]) != 0), prepend=0, append=2000).max() / RATE_HZ for r in partial
    ]
    if pattern == "random":
        assert max(longest) < 2
    else:
        assert min(longest) > 0.75 * 5 - 0.2


def test_the_azimuth_is_best_ahead_and_behind() -> None:
    settings = RadarSettings()
    off = np.radians([0, 22.5, 45, 90, 157.5, 180, -22.5])
    expected = [0.1, 0.55, 1.0, 1.0, 0.55, 0.1, 0.55]
    np.testing.assert_allclose(np.degrees(azimuth_deviation(off, settings)), expected, atol=1e-9)
    given = RadarSettings.model_validate({"azimuth_sd_deg": 0.3})
    np.testing.assert_allclose(np.degrees(azimuth_deviation(off, given)), 0.3, atol=1e-9)


def test_a_target_to_the_side_is_placed_less_well() -> None:
    """Errors of fixes across the line of sight, of a TV 30 m ahead and of one 30 m to the side, over their distance."""
    spread = {}
    for name, place in (("ahead", (30.0, 0.0)), ("side", (0.0, 30.0))):
        truth, carriers = scene()
        still = np.zeros_like(truth)
        for k in range(RECORDS):
            still[k, :2] = carriers[0].state[:2].repeat(4, axis=1) + np.array(place)[:, None]
            still[k, 2] = 30.0
        # Strong echoes, so that the deviations are those of the settings.
        settings = RadarSettings(strong_snr_db=0.0)
        records = sense_onboard(still, carriers, settings, KEYS)
        across = 1 if name == "ahead" else 0
        fixes = np.stack([record.fixes for record in records])
        changed = np.diff(fixes[:, 0], axis=1) != 0
        error = (fixes - still[:, :4])[:, across, 1:][changed]
        spread[name] = np.degrees(np.median(np.abs(error)) / 0.6745 / 30.0)
    assert spread["ahead"] == pytest.approx(0.1, rel=0.25)
    assert spread["side"] == pytest.approx(1.0, rel=0.25)


def test_the_framework_radar_in_weather_errs_ten_times_as_much() -> None:
    truth, carriers = scene()
    preset = RADAR_PRESETS["framework"]
    chosen = [RadarSettings.model_validate({**preset, "condition": name}) for name in ("clear", "weather")]
    clear, weather = (sense_onboard(truth, carriers, settings, KEYS) for settings in chosen)
    assert min(record.detected for record in weather) > 0.95
    errors = [np.stack([record.fixes for record in records]) - truth[:, :4] for records in (clear, weather)]
    assert errors[1][:, 0].std() == pytest.approx(10 * errors[0][:, 0].std(), rel=0.1)


def test_weather_takes_20_db_and_cycles() -> None:
    truth, carriers = scene()
    clear = sense_onboard(truth, carriers, RadarSettings(), KEYS)
    weather = sense_onboard(truth, carriers, RadarSettings(condition="weather"), KEYS)
    assert clear[0].snr_db - weather[0].snr_db == pytest.approx(20)
    assert np.mean([r.detected for r in weather]) == pytest.approx(0.7, abs=0.1)
    assert rms(weather, truth, slice(0, 2)) > rms(clear, truth, slice(0, 2))


def test_rain_at_77_ghz_is_felt() -> None:
    truth, carriers = scene(gap=100.0)
    dry = sense_onboard(truth[:1], carriers[:1], RadarSettings(), KEYS[:1])
    wet = sense_onboard(truth[:1], carriers[:1], RadarSettings(rain_mm_per_h=50), KEYS[:1])
    distance = np.mean(
        np.abs(truth[0, 0] - np.interp(np.arange(2000) / 400, np.arange(500) / 100, carriers[0].state[0]))
    )
    assert dry[0].snr_db - wet[0].snr_db == pytest.approx(2 * distance / 1000 * 18.8, rel=0.15)


def test_a_truck_between_the_two_takes_the_line_of_sight() -> None:
    truth, carriers = scene(gap=60.0)
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
    beside = replace(truck, y=truck.y + 5)
    time_s = np.arange(2000) / RATE_HZ
    pose = Pose.of(carriers[0], time_s, ("truck",))
    hidden, free = (scan(truth[0], time_s, pose, settings, ("truck",), others) for others in (truck, beside))
    assert hidden.detected == 0
    assert free.detected > 0.95


def test_a_forward_radar_does_not_see_behind() -> None:
    truth, carriers = scene()
    behind = sense_onboard(truth, carriers, RadarSettings(half_width_deg=60), KEYS)
    assert not any(r.usable for r in behind)
    assert all(np.isfinite(r.state).all() for r in behind)
    ahead, carriers = scene(gap=-60.0, snapshots=400)
    assert all(r.usable for r in sense_onboard(ahead, carriers, RadarSettings(half_width_deg=60), KEYS))


def parked(x: float, y: float, snapshots: int = 500) -> np.ndarray:
    """A UV that stands, (6, C)."""
    state = np.zeros((6, snapshots))
    state[:2] = [[x], [y]]
    return state


def detected(state: np.ndarray, tv: np.ndarray, half_width_deg: float = 60.0) -> np.ndarray:
    """Which thirds of a record a radar with a narrow field of view detects the TV in."""
    settings = RadarSettings(half_width_deg=half_width_deg)
    record = sense_onboard(tv[None], [Carrier(state, 100.0)], settings, [("parked", 0)])[0]
    changes = np.flatnonzero(np.any(np.diff(record.fixes, axis=1) != 0, axis=0))
    return np.array([((changes >= begin) & (changes < begin + 600)).any() for begin in (0, 700, 1400)])


def test_a_uv_that_stops_looks_where_it_drove() -> None:
    """It brakes to a stop within 1 s, along +x or along -y; the TV stays ahead of the first and right of the second."""
    time = np.arange(500) / 100
    speed = np.maximum(10 - 10 * time, 0.0)
    ahead = drive(2000, 40.0, 0.0, 5.0)
    east, south = parked(0.0, 0.0), parked(0.0, 0.0)
    for state, axis, sign in ((east, 0, 1), (south, 1, -1)):
        state[2 + axis] = sign * speed
        state[axis] = sign * np.cumsum(speed) / 100
    assert detected(east, ahead).all()
    assert not detected(south, ahead).any()


def test_a_uv_that_drives_off_looks_there_before() -> None:
    time = np.arange(500) / 100
    state = parked(0.0, 0.0)
    state[3] = np.maximum(3 * (time - 3), 0.0)
    state[1] = np.cumsum(state[3]) / 100
    state[5] = 3 * (time > 3)
    assert detected(state, drive(2000, -10.0, 60.0, 4.0)).all()
    assert not detected(state, drive(2000, 40.0, 0.0, 4.0))[:2].any()


def test_a_uv_that_never_moves_faces_the_target_of_the_records_start() -> None:
    assert detected(parked(0.0, 0.0), drive(2000, -40.0, 0.0, -5.0)).all()
    passing = detected(parked(0.0, 0.0), drive(2000, -30.0, 3.0, 20.0))
    assert passing.tolist() == [True, False, False]


@pytest.mark.parametrize("bearing", [0.0, 0.8, np.pi / 2, 2.5])
def test_the_covariance_is_that_of_the_fixes(bearing: float) -> None:
    """By Monte Carlo: errors of range, speed and azimuth, and of what the UV reports, drawn and put through the fix."""
    count = 200_000
    rng = np.random.default_rng(4)
    radar = np.array([[3.0], [-2.0], [24.0], [7.0]])
    offset = 35 * np.array([[np.cos(bearing)], [np.sin(bearing)]])
    true = Cycles.of(offset, np.array([[4.0], [-3.0]]), 0.3)
    deviation = np.array([[0.4], [0.03], [np.radians(0.3)]])
    noise = rng.standard_normal((3, count)) * deviation
    reported = radar + np.array([[0.02], [0.02], [0.05], [0.05]]) * rng.standard_normal((4, count))
    fixes = Cycles(true.distance + noise[0], true.speed + noise[1], true.bearing + noise[2], 0.3).fix(reported)
    covariance = true.covariance(radar[2:], deviation, 0.02, 0.05)[0]
    across = np.array([-np.sin(bearing), np.cos(bearing)])
    covariance[2:, 2:] -= UNKNOWN_SPEED_MPS**2 * np.outer(across, across)
    sampled = np.cov(fixes.T)
    scale = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)))
    assert np.abs(covariance - sampled).max() < 0.02 * scale.max()
    assert np.abs((covariance - sampled) / scale).max() < 0.02
    # The one azimuth error shows in both: without the blocks between position and velocity this fails.
    along = np.array([np.cos(bearing), np.sin(bearing)])
    shared = across @ sampled[:2, 2:] @ along
    assert shared == pytest.approx(35 * np.radians(0.3) ** 2 * (radar[2:, 0] @ across), rel=0.05)


def test_the_fixes_say_how_good_they_are() -> None:
    """Errors against their covariance, the speed across the line of sight left out; a TV passes in the next lane."""
    time_s = np.arange(8000) / RATE_HZ
    tv = drive(8000, -40.0, 3.5, 29.0)
    state = np.stack([25 * time_s, np.zeros(8000), np.full(8000, 25.0), np.zeros(8000)])
    pose = Pose(state, state, np.zeros(8000))
    values, places = [], []
    for k in range(20):
        fixes = scan(tv, time_s, pose, RadarSettings(), ("nees", k), None).fixes
        error = (fixes.state - tv[:4].T)[fixes.valid]
        bearing = np.arctan2(*(tv[:2] - state[:2])[::-1])[fixes.valid]
        seen = np.zeros((len(error), 3, 4))
        seen[:, 0, 0] = seen[:, 1, 1] = 1
        seen[:, 2, 2], seen[:, 2, 3] = np.cos(bearing), np.sin(bearing)
        error, covariance = (seen @ error[..., None])[..., 0], seen @ fixes.covariance[fixes.valid] @ seen.mT
        values.append(np.einsum("na,nab,nb->n", error, np.linalg.inv(covariance), error))
        places.append(np.einsum("na,nab,nb->n", error[:, :2], np.linalg.inv(covariance[:, :2, :2]), error[:, :2]))
    assert np.concatenate(places).mean() == pytest.approx(2, rel=0.06)
    # A degree, as to the side, turns the UV's speed by more than the first order of the covariance says.
    assert np.concatenate(values).mean() == pytest.approx(3, rel=0.1)


def test_errors_of_the_uvs_own_position_reach_the_fixes() -> None:
    """The radar rides on the true UV, and adds what it measures to where the UV believes to be."""
    truth, carriers = scene()
    offset = np.zeros((6, 500))
    offset[1] = 1.5
    moved = [replace(carrier, reported=carrier.state + offset) for carrier in carriers]
    right = sense_onboard(truth, carriers, RadarSettings(tracking={"run_in_s": 0.0}), KEYS)
    wrong = sense_onboard(truth, moved, RadarSettings(tracking={"run_in_s": 0.0}), KEYS)
    for one, other in zip(right, wrong, strict=True):
        np.testing.assert_allclose(
            other.fixes - one.fixes, np.array([[0], [1.5], [0], [0]]) + np.zeros(2000), atol=1e-9
        )
    noisy = [replace(carrier, position_sd_m=0.5) for carrier in carriers]
    spread = _scan_run_in(truth, noisy) - _scan_run_in(truth, carriers)
    assert spread.std() == pytest.approx(0.4, rel=0.25)


def _scan_run_in(truth: np.ndarray, carriers: list[Carrier]) -> np.ndarray:
    """Fixes at the start of the records, which the run-in made."""
    return np.stack([r.fixes[:2, 0] for r in sense_onboard(truth, carriers, RadarSettings(), KEYS)])


def test_a_record_does_not_depend_on_its_company() -> None:
    truth, carriers = scene(snapshots=400)
    together = sense_onboard(truth, carriers, RadarSettings(condition="weather"), KEYS)
    alone = sense_onboard(truth[5:6], carriers[5:6], RadarSettings(condition="weather"), KEYS[5:6])
    assert np.array_equal(alone[0].state, together[5].state)


def test_a_tv_without_a_uv_is_not_usable() -> None:
    passage = Passage("tv", 0.0, hard_brake(400), ("alone",))
    picture = watch("radar", WatchedTraffic("road", 1, [], RATE_HZ), SensorSettings()).picture
    assert not picture.in_view(passage).any()
    assert not picture.record([passage])[0].usable


def test_a_line_of_sight_needs_the_other_vehicles() -> None:
    truth, carriers = scene(snapshots=400)
    with pytest.raises(InputError, match="line_of_sight"):
        sense_onboard(truth, carriers, RadarSettings(condition="nlos", pattern="line_of_sight"), KEYS)
