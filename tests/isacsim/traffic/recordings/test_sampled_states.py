"""States between samples are those of a vehicle that was moved step by step."""

import numpy as np
import pytest

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.recordings.sampled_road import Road
from isac_cosim.isacsim.traffic.recordings.sampled_states import (
    LANE,
    LANE_LAT,
    LANE_POS,
    SPEED,
    Samples,
    X,
    Y,
    at_every_step,
)

STEP_S = 0.01
ACTION_STEPS = 10


def lane(name: str, shape: list[tuple[float, float]], index: int = 0, successors: tuple[str, ...] = ()) -> Lane:
    points = np.array(shape)
    length = float(np.hypot(*np.diff(points, axis=0).T).sum())
    return Lane(name, name[0], index, 3.2, length, points, successors)


BENT = (lane("a0", [(0.0, 0.0), (40.0, 0.0), (80.0, 30.0)]),)
JOINED = (
    lane("a0", [(0.0, 0.0), (50.0, 0.0)], successors=("b0",)),
    lane("b0", [(50.0, 0.0), (50.4, 0.0)], successors=("c0",)),
    lane("c0", [(50.4, 0.0), (200.0, 0.0)]),
    lane("c1", [(50.4, 3.2), (200.0, 3.2)], 1),
)


def drive(accelerations: Array, acted: int, speed: float, count: int) -> tuple[Array, Array]:
    """Speed and position after every step; the acceleration is the next one from each action step on. Stops at 0."""
    position, number = 0.0, 0
    speeds, positions = [speed], [position]
    for step in range(count):
        if step % ACTION_STEPS == acted:
            number += 1
        moved_s = STEP_S
        if speed + accelerations[number] * STEP_S < 0.0:
            moved_s = -speed / accelerations[number]
        position += speed * moved_s + 0.5 * accelerations[number] * moved_s**2
        speed = speed + accelerations[number] * moved_s if moved_s == STEP_S else 0.0
        speeds.append(speed)
        positions.append(position)
    return np.array(speeds), np.array(positions)


def sampled(states: Array, steps: Array, acted: int, last: int, lanes: tuple[Lane, ...]) -> Array:
    commanded = np.zeros(len(steps), np.bool_)
    counts, decisions, action_steps, lasts = np.array([[len(steps)], [acted + 1000], [ACTION_STEPS], [last + 1000]])
    samples = Samples.of(steps + 1000, states[:, steps], commanded, counts, decisions, action_steps, lasts)
    return at_every_step(samples, Road(lanes), STEP_S)


@pytest.mark.parametrize("acted", [0, 1, 5, 9])
def test_motion_along_a_bent_lane_is_exact_wherever_the_driver_decides(acted: int) -> None:
    """Also where the lane turns between two samples, and after the last one."""
    rng = np.random.default_rng(acted)
    speed, position = drive(rng.uniform(-3.0, 2.0, 40), acted, 20.0, 309)
    along = np.exp(1j * np.arctan2(30.0, 40.0))
    centre = np.where(position < 40.0, position, 40.0 + (position - 40.0) * along)
    plane = centre + 0.5j * np.where(position < 40.0, 1.0, along)
    truth = np.stack([plane.real, plane.imag, speed, position, np.full(310, 0.5), np.zeros(310)])
    assert position[-1] > 50.0
    rebuilt = sampled(truth, np.arange(0, 301, 10), acted, 300 + acted, BENT)
    np.testing.assert_allclose(rebuilt, truth[:, : rebuilt.shape[1]], atol=1e-9)


def test_a_vehicle_that_stops_between_two_samples_stands_from_then_on() -> None:
    speed, position = drive(np.full(10, -4.0), 0, 1.5, 60)
    truth = np.stack([position, 0.0 * position, speed, position, 0.0 * position, 0.0 * position])
    assert speed[37] > 0.0 == speed[38]
    rebuilt = sampled(truth, np.arange(0, 61, 10), 0, 60, BENT)
    np.testing.assert_allclose(rebuilt, truth, atol=1e-4)
    assert (rebuilt[SPEED] >= 0.0).all()


def test_the_speed_of_a_vehicle_that_speeds_up_and_stops_between_two_samples_is_that_of_its_motion() -> None:
    """As in a queue: it creeps on until the driver decides, and stops at once. Nothing is left over for a jump."""
    speed, position = drive(np.array([0.0, 1.2, -12.0, 0.0, 0.0]), 7, 0.15, 40)
    assert speed[10] > 0.15
    assert speed[20] == 0.0 < speed[18]
    truth = np.stack([position, 0.0 * position, speed, position, 0.0 * position, 0.0 * position])
    rebuilt = sampled(truth, np.arange(0, 41, 10), 7, 40, BENT)
    driven = np.cumsum(np.append(0.0, rebuilt[SPEED, 1:] + rebuilt[SPEED, :-1])) / 2.0 * STEP_S
    np.testing.assert_allclose(driven, rebuilt[LANE_POS], atol=1e-4)
    np.testing.assert_allclose(rebuilt[LANE_POS], position, atol=2e-3)


def test_a_vehicle_drives_on_through_lanes_that_are_passed_between_two_samples() -> None:
    speed, position = drive(np.linspace(2.0, -2.0, 30), 0, 25.0, 250)
    number = np.searchsorted([50.0, 50.4], position)
    truth = np.stack(
        [position, 0.0 * position, speed, position - np.array([0.0, 50.0, 50.4])[number], 0.0 * position, number]
    )
    steps = np.arange(0, 251, 10)
    assert not (number[steps] == 1).any(), "the short lane is passed unseen"
    rebuilt = sampled(truth, steps, 0, 250, JOINED)
    np.testing.assert_allclose(rebuilt, truth, atol=1e-9)
    assert (rebuilt[LANE] == 1).any()


@pytest.mark.parametrize("flip_m", [80.0, 51.0])
def test_a_lane_changes_where_the_marking_is_crossed(flip_m: float) -> None:
    """At a steady lateral speed, which a cubic follows; also where the lane ends between the same two samples."""
    position = 0.25 * np.arange(500.0)
    aside = 0.01 * (position - flip_m) / 0.25 + 1.6
    across, number = aside > 1.6, np.searchsorted([50.0, 50.4], position)
    lane_pos = position - np.array([0.0, 50.0, 50.4])[number]
    truth = np.stack(
        [position, aside, np.full(500, 25.0), lane_pos, aside - 3.2 * across, np.where(across, 3.0, number)]
    )[:, 100:411]
    rebuilt = sampled(truth, np.arange(0, 311, 10), 0, 310, JOINED)
    different = rebuilt[LANE] != truth[LANE]
    assert different.sum() <= 1
    np.testing.assert_allclose(rebuilt[:LANE_LAT], truth[:LANE_LAT], atol=1e-9)
    np.testing.assert_allclose(rebuilt[LANE_LAT, ~different], truth[LANE_LAT, ~different], atol=1e-9)


def test_many_vehicles_at_once_are_what_each_is_alone() -> None:
    """To the last bit, whoever comes before and after: some change lanes, stop, are commanded, or have one sample."""
    rng = np.random.default_rng(3)
    alone, parts = [], []
    for number in range(12):
        speed, position = drive(rng.uniform(-3.0, 2.0, 30), number % 10, 2.5 * number, 250)
        position += 30.0
        steps = np.arange(0, 251, 10 if number % 3 else 4) if number else np.array([7])
        lane = np.searchsorted([50.0, 50.4], position)
        within = position - np.array([0.0, 50.0, 50.4])[lane]
        lane[(position > 60.0) & (number % 2 == 0)] = 3
        aside = rng.uniform(-1.6, 1.6) * np.sin(np.arange(251) / 40.0)
        states = np.stack([position, aside, speed, within, aside, lane])
        facts = [np.array([value]) for value in (len(steps), number % 10, ACTION_STEPS, steps[-1] + number % 7)]
        parts.append((steps, states[:, steps], rng.random(len(steps)) < 0.3, *facts))
        alone.append(at_every_step(Samples.of(*parts[-1]), Road(JOINED), STEP_S))
    together = [np.concatenate(values, axis=-1) for values in zip(*parts, strict=True)]
    rebuilt = at_every_step(Samples.of(*together), Road(JOINED), STEP_S)
    np.testing.assert_array_equal(rebuilt, np.concatenate(alone, axis=1))
    assert set(rebuilt[LANE]) == {0.0, 1.0, 2.0, 3.0}
    assert (rebuilt[SPEED] == 0.0).any()


def test_a_jump_is_placed_halfway() -> None:
    count = 40
    states = np.stack([np.full(count, 10.0), np.zeros(count), *np.zeros((4, count))])
    states[LANE_POS] = 10.0
    states[LANE_LAT, 20:] = states[Y, 20:] = 0.9
    rebuilt = sampled(states, np.arange(1, count, 10), 0, 39, BENT)
    assert np.flatnonzero(np.diff(rebuilt[LANE_LAT]) != 0.0).tolist() == [14]
    np.testing.assert_array_equal(rebuilt[Y], rebuilt[LANE_LAT])
    np.testing.assert_array_equal(rebuilt[X], 10.0)


def test_a_vehicle_does_not_slide_along_before_it_jumps_aside_to_where_it_parks() -> None:
    """SUMO puts it 3.2 m aside and some centimetres ahead of where its place along the lane is."""
    count = 21
    states = np.zeros((6, count))
    states[LANE_POS] = states[X] = 40.0
    states[X, 20], states[Y, 20] = 40.05, -3.2
    rebuilt = sampled(states, np.array([0, 10, 20]), 0, 20, (lane("a0", [(0.0, 0.0), (80.0, 0.0)]),))
    np.testing.assert_allclose(rebuilt, states, atol=1e-9)


def test_a_lane_to_which_no_way_leads_begins_at_its_sample() -> None:
    lanes = (lane("a0", [(0.0, 0.0), (50.0, 0.0)]), lane("z0", [(500.0, 9.0), (600.0, 9.0)]))
    states = np.zeros((6, 21))
    states[SPEED], states[LANE_POS], states[X] = 10.0, 0.1 * np.arange(21), 0.1 * np.arange(21)
    states[LANE, 20], states[X, 20], states[Y, 20] = 1.0, 502.0, 9.0
    rebuilt = sampled(states, np.array([0, 10, 20]), 0, 20, lanes)
    np.testing.assert_allclose(rebuilt[LANE_POS, :20], 0.1 * np.arange(20), atol=1e-9)
    assert (np.diff(rebuilt[LANE]) != 0).nonzero()[0].tolist() == [19]
    np.testing.assert_array_equal(rebuilt[:, 20], states[:, 20])
