"""Conditioned motion is what vehicles can do: on straights, in curves, across markings and from edge to edge."""

import numpy as np
import pytest

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.motion import MotionSettings, states
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record

NONE = ManeuverSettings(**{name: 0.0 for name in ManeuverSettings.model_fields if name.endswith("_hour")})
MARGIN_S = 0.8


@pytest.fixture(scope="module", params=["motorway", "urban"])
def settled(request: pytest.FixtureRequest) -> Recording:
    return record(load(request.param), 5, TrafficSettings(run_in_s=80.0, duration_s=20.0), NONE)


def at_400_hz(recording: Recording, track: Track) -> Array | None:
    times = recording.times(track)
    inner = np.arange(times[0] + MARGIN_S, times[-1] - MARGIN_S, 0.0025)
    return states(recording, track, inner, MotionSettings()) if len(inner) > 400 else None


def test_settled_traffic_has_no_jump_and_little_jerk(settled: Recording) -> None:
    """Position, velocity and acceleration follow from each other sample to sample; jerk rms under 2 m/s3."""
    jerks, raw, curved = [], [], 0
    for track in settled.tracks.values():
        state = at_400_hz(settled, track)
        if state is None:
            continue
        step = 0.0025
        predicted = state[0:2, :-1] + step * state[2:4, :-1] + 0.5 * step**2 * state[4:6, :-1]
        assert np.abs(state[0:2, 1:] - predicted).max() < 1e-6
        jerk = np.diff(state[4:6], axis=1) / step
        assert np.abs(state[2:4, 1:] - state[2:4, :-1] - step * state[4:6, :-1]).max() < 0.6 * step**2 * 60.0
        assert np.abs(jerk).max() < 60.0
        jerks.append((jerk**2).sum(axis=0))
        raw.append((np.diff(track.speed, 2) / settled.step_s**2) ** 2)
        curved += len(np.unique(track.lane)) > 2
    assert curved > 3
    conditioned_rms, raw_rms = (float(np.sqrt(np.concatenate(squares).mean())) for squares in (jerks, raw))
    print(f"{settled.scenario}: jerk rms {conditioned_rms:.2f} m/s3 conditioned, {raw_rms:.2f} raw, along the lane")
    assert conditioned_rms < 2.0
    assert conditioned_rms < raw_rms


def test_maneuvers_stay_within_what_a_car_can_do() -> None:
    """Up to 9 m/s2 and 25 m/s3 while a driver reacts or is under command, lateral and longitudinal together.

    One in twenty may brake and steer at once by a little more: datasets leave such vehicles out, and count them.
    """
    stimulus = ManeuverSettings(
        hard_brake_per_vehicle_hour=60.0,
        swerve_per_vehicle_hour=100.0,
        debris_per_vehicle_hour=100.0,
        hard_accel_per_vehicle_hour=60.0,
    )
    recording = record(load("motorway"), 6, TrafficSettings(run_in_s=40.0, duration_s=20.0), stimulus)
    largest = []
    for command in recording.commands:
        track = recording.tracks.get(command.vehicle)
        if track is None or command.maneuver not in ("hard_brake", "evasive_swerve", "evasion"):
            continue
        times = recording.times(track)
        if command.start < times[0] + MARGIN_S or command.end > times[-1] - MARGIN_S:
            continue
        end = command.end if command.maneuver == "evasive_swerve" else min(command.end, command.start + 4.0)
        state = states(recording, track, np.arange(command.start, end, 0.0025), MotionSettings())
        acceleration = state[4:6]
        if command.maneuver == "evasive_swerve":  # along the road SUMO's driver drives, and may brake for others
            heading = state[2:4] / np.hypot(*state[2:4])
            acceleration = np.stack([heading[0] * state[5] - heading[1] * state[4], np.zeros(state.shape[1])])
        largest.append(np.hypot(*acceleration).max())
        assert largest[-1] < 10.0, command
        assert np.hypot(*np.diff(acceleration, axis=1)).max() / 0.0025 < 25.0, command
    assert len(largest) > 10
    assert np.mean(np.array(largest) >= 9.0) <= 0.05
