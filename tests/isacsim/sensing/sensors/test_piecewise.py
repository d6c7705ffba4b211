"""A vehicle is known as well piece by piece as from a whole record: what a sensor does is the same either way."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.sensing.onboard_radar import Pose, RadarSettings, scan
from isac_cosim.isacsim.sensing.passages import Carrier, Passage, Piece, WatchedTraffic
from isac_cosim.isacsim.sensing.sensors import SCENE, SENSORS, Watch, watch
from isac_cosim.isacsim.sensing.sensors.protocol import SensorSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from tests.support.sensing_road import RATE_HZ, drive, road_sites

TRAFFIC = WatchedTraffic("road", 1, road_sites(), RATE_HZ)
QUIET = SensorSettings.model_validate(
    {
        "sensing": {"channel": {"kind": "fixed", "snr_db": 80.0}},
        "radar": {
            "range_sd_m": 1e-5,
            "speed_sd_mps": 1e-5,
            "azimuth_sd_deg": 1e-5,
            "strong_snr_db": -60.0,
            "cycle_s": 0.01,
        },
    }
)
"""Sensors without noise worth the name, and a radar that measures often: what is left is what they make of motion."""
PLAIN = SensorSettings.model_validate({"sensing": {"channel": {"kind": "fixed", "snr_db": 5.0}}})
SETTLED = 500
"""Snapshots after which a filter has forgotten how it began."""


def pieces(vehicles: Mapping[str, np.ndarray], length: int) -> Iterator[Piece]:
    """Motions (6, S) cut into pieces, as a running world gives them."""
    nothing = np.zeros(1)
    for end in range(length, next(iter(vehicles.values())).shape[1] + 1, length):
        motion = np.stack([states[:, end - length : end] for states in vehicles.values()])
        tracks = {
            name: Track(name, "truck", 12.0, 2.5, 0, nothing, nothing, nothing, nothing, nothing, nothing)
            for name in vehicles
        }
        yield Piece(end / RATE_HZ, tuple(vehicles), motion, motion[:, :, ::4], Recording("road", 1, 0.01, (), tracks))


def stepped(sensor: Watch, vehicles: Mapping[str, np.ndarray], length: int) -> np.ndarray:
    """What is known of "tv", (6, S), NaN where nothing is."""
    states = []
    for piece in pieces(vehicles, length):
        sensed = sensor.step(piece, {"tv": "uv"})
        states.append(sensed.state[0] if sensed.names else np.full((6, length), np.nan))
    return np.concatenate(states, axis=1)


def whole(sensor: Watch, vehicles: Mapping[str, np.ndarray], key: int = 0) -> np.ndarray:
    """The same as one record."""
    report = TRAFFIC.report
    carrier = Carrier(vehicles["uv"], RATE_HZ, None, report.position_sd_m, report.speed_sd_mps)
    (record,) = sensor.record([Passage("tv", 0.0, vehicles["tv"], ("whole", key), find_carrier=lambda: carrier)])
    assert record.usable
    return record.state


def pair(speed: float, along: float, aside: float, snapshots: int = 1200) -> dict[str, np.ndarray]:
    """A TV that speeds up or brakes and turns a little, and the UV ahead of it."""
    wave = np.sin(2 * np.pi * np.arange(snapshots) / 1200)
    tv = drive(snapshots, 60.0, 0.0, speed, along=along * wave, aside=aside * wave)
    return {"tv": tv, "uv": drive(snapshots, 100.0, 0.0, speed)}


@settings(max_examples=10, deadline=None)
@given(
    name=st.sampled_from(sorted({*SENSORS} - {SCENE})),
    speed=st.floats(10.0, 35.0),
    along=st.floats(-4.0, 3.0),
    aside=st.floats(-1.0, 1.0),
    length=st.sampled_from([40, 60, 80, 200, 400]),
)
def test_without_noise_pieces_give_what_the_record_gives(
    name: str, speed: float, along: float, aside: float, length: int
) -> None:
    vehicles = pair(speed, along, aside)
    record = whole(watch(name, TRAFFIC, QUIET), vehicles)
    known = stepped(watch(name, TRAFFIC, QUIET), vehicles, length)
    difference = np.abs(known - record)[:, SETTLED:]
    within = {"truth": (0.0, 0.0), "isac": (2e-5, 1e-3), "radar": (3e-3, 3e-2)}[name]
    assert difference[:2].max() <= within[0]
    assert difference[2:4].max() <= within[1]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["isac", pytest.param("radar", marks=pytest.mark.slow)])
def test_with_noise_pieces_are_as_accurate_as_records(name: str) -> None:
    vehicles = pair(25.0, -3.0, 0.5, snapshots=2400)
    errors: dict[str, list[np.ndarray]] = {"whole": [], "pieces": []}
    for seed in range(12):
        traffic = replace(TRAFFIC, seed=seed)
        record = whole(watch(name, traffic, PLAIN), vehicles, seed)
        known = stepped(watch(name, traffic, PLAIN), vehicles, 40)
        for way, states in (("whole", record), ("pieces", known)):
            errors[way].append((states - vehicles["tv"])[:4, 1200:])
    rms = {way: np.sqrt(np.mean(np.square(of), axis=(0, 2))) for way, of in errors.items()}
    # A position errs for about a second in one direction: three dozen independent errors of each way.
    np.testing.assert_allclose(rms["pieces"][:2], rms["whole"][:2], rtol=0.3)
    np.testing.assert_allclose(rms["pieces"][2:], rms["whole"][2:], rtol=0.1)


@pytest.mark.parametrize("name", ["isac", "truth"])
def test_company_changes_nothing_about_a_record(name: str) -> None:
    passages = [Passage(str(k), 0.0, drive(60 + 20 * k, 50.0 * k, 0.0, 25.0), ("company", k)) for k in range(4)]
    together = watch(name, TRAFFIC, SensorSettings()).record(passages)
    for passage, record in zip(passages, together, strict=True):
        (alone,) = watch(name, TRAFFIC, SensorSettings()).record([passage])
        np.testing.assert_array_equal(alone.state, record.state)


@pytest.mark.parametrize(
    ("condition", "left"), [({"condition": "nlos", "dropped": 0.6}, 0.4), ({"condition": "weather"}, 0.7)]
)
def test_a_condition_takes_as_many_cycles_of_pieces_as_of_records(condition: dict[str, object], left: float) -> None:
    """Of a record it takes a share; piece by piece, each of the 55 cycles has that chance. Nobody moves."""
    vehicles = {name: np.tile(states[:, :1], 1600) for name, states in pair(0.0, 0.0, 0.0).items()}
    radar = RadarSettings.model_validate(condition)
    carrier = Carrier(vehicles["uv"], RATE_HZ)
    passages = [Passage("tv", 0.0, vehicles["tv"], ("nlos", k), find_carrier=lambda: carrier) for k in range(4)]
    records = watch("radar", TRAFFIC, SensorSettings(radar=radar)).record(passages)
    assert np.mean([record.detected for record in records]) == pytest.approx(left, abs=0.08)
    time_s, cycles = np.arange(40) / RATE_HZ, {}
    for settings_of in (radar, RadarSettings()):
        cycles[settings_of.condition] = sum(
            int(
                scan(
                    motion, time_s, pose, settings_of, ("nlos", f"{piece.end_s:.6f}", k), None, whole=False
                ).fixes.valid.sum()
            )
            for piece in pieces(vehicles, 40)
            for motion, uv in [piece.tv]
            for pose in [Pose(uv[:4], uv[:4], np.zeros(40))]
            for k in range(4)
        )
    assert cycles[radar.condition] / cycles["clear"] == pytest.approx(left, abs=0.08)


def test_one_lost_stretch_of_a_record_means_nothing_in_running_traffic() -> None:
    settings_of = RadarSettings(condition="nlos", pattern="contiguous")
    sensor = watch("radar", TRAFFIC, SensorSettings(radar=settings_of))
    with pytest.raises(InputError, match="contiguous is one stretch of a record, which running traffic has not"):
        stepped(sensor, pair(25.0, 0.0, 0.0), 40)


def test_a_truck_in_between_hides_the_tv_from_the_uv_in_running_traffic() -> None:
    radar = SensorSettings(radar=RadarSettings(condition="nlos", pattern="line_of_sight"))
    vehicles = {**pair(25.0, 0.0, 0.0), "truck": drive(1200, 85.0, 0.0, 25.0)}
    assert np.isnan(stepped(watch("radar", TRAFFIC, radar), vehicles, 40)).all()
    beside = {**vehicles, "truck": drive(1200, 85.0, 4.0, 25.0)}
    assert np.isfinite(stepped(watch("radar", TRAFFIC, radar), beside, 40)[:, SETTLED:]).all()
