"""The batched filter against filterpy, one record at a time."""

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter
from scipy import stats

from isac_cosim.isacsim.tracking.kalman import TrackingSettings, process_noise, start, track, transition

STEP_S = 1 / 400


def random_fixes(records: int, snapshots: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fixes about a line, with a covariance of its own at every step, a few of them missing."""
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(records, snapshots, 4, 4)) * 0.1
    covariance = factor @ factor.transpose(0, 1, 3, 2) + 1e-4 * np.eye(4)
    noise = np.einsum("...ab,...b->...a", np.linalg.cholesky(covariance), rng.normal(size=(records, snapshots, 4)))
    time = np.arange(snapshots) * STEP_S
    line = np.stack([5 + 30 * time, 2 - time, np.full(snapshots, 30.0), np.full(snapshots, -1.0)], axis=-1)
    valid = rng.random((records, snapshots)) > 0.05
    valid[:, 0] = True
    return line + noise, covariance, valid


def test_equals_filterpy_over_a_record() -> None:
    settings = TrackingSettings()
    fixes, covariance, valid = random_fixes(3, 2000, 1)
    tracks = track(fixes, covariance, valid, STEP_S, settings)
    for record in range(3):
        reference = KalmanFilter(dim_x=6, dim_z=4)
        state, spread = start(fixes[record, :1], covariance[record, :1], settings)
        reference.x, reference.P = state[0].copy(), spread[0].copy()
        reference.F, reference.H = transition(STEP_S), np.eye(4, 6)
        reference.Q = process_noise(STEP_S, settings.jerk_density)
        for k in range(1, 2000):
            reference.predict()
            if valid[record, k]:
                reference.update(fixes[record, k], R=covariance[record, k])
            assert np.abs(reference.x - tracks.state[record, k]).max() < 1e-6
        assert np.abs(reference.P - tracks.covariance[record]).max() < 1e-6


def plain_track(
    fixes: np.ndarray, covariances: np.ndarray, valid: np.ndarray, settings: TrackingSettings
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The filter as its equations are written: states, covariances after the last step, innovations, outliers."""
    move, noise = transition(STEP_S), process_noise(STEP_S, settings.jerk_density)
    states, innovations = np.empty((*valid.shape, 6)), np.zeros(valid.shape)
    state, spread = start(fixes[:, 0], covariances[:, 0], settings)
    states[:, 0], refused = state, np.zeros(len(fixes), dtype=np.int64)
    for k in range(1, valid.shape[1]):
        state = (move @ state[..., None])[..., 0]
        spread = move @ spread @ move.T + noise
        weight = np.linalg.inv(spread[:, :4, :4] + covariances[:, k])
        weight[~valid[:, k]] = 0.0
        surprise = (fixes[:, k] - state[:, :4])[..., None]
        innovations[:, k] = (surprise.transpose(0, 2, 1) @ (weight @ surprise))[:, 0, 0]
        outlier = innovations[:, k] > settings.gate
        refused = np.where(outlier, refused + 1, np.where(valid[:, k], 0, refused))
        weight[outlier] = 0.0
        gain = spread[:, :, :4] @ weight
        state = state + (gain @ surprise)[..., 0]
        spread = spread - gain @ spread[:, :4]
        spread = (spread + spread.transpose(0, 2, 1)) / 2
        lost = refused > settings.reacquire_s / STEP_S
        state[lost], spread[lost] = start(fixes[lost, k], covariances[lost, k], settings)
        refused[lost] = 0
        states[:, k] = state
    return states, spread, innovations, refused


@pytest.mark.parametrize("records", [1, 5, 40])
def test_steps_in_buffers_are_the_plain_steps_to_the_last_bit(records: int) -> None:
    """With fixes missing, with outliers now and then, and with vehicles that are lost and found again."""
    fixes, covariance, valid = random_fixes(records, 300, 10)
    fixes[:, 50:250:29, 1] += 200.0
    fixes[::2, 120:, 0] += 300.0
    fixes[::3, -20:, 0] -= 300.0
    tracks = track(fixes, covariance, valid, STEP_S, TrackingSettings())
    state, spread, innovation, refused = plain_track(fixes, covariance, valid, TrackingSettings())
    assert refused.max() > 10
    assert (innovation[:, 200] < 1000).all()
    assert (tracks.state == state).all()
    assert (tracks.covariance == spread).all()
    assert (tracks.innovation == innovation).all()
    assert (tracks.refused == refused).all()


def test_process_noise_is_filterpys() -> None:
    noise = process_noise(0.01, 7.0)
    one_axis = Q_continuous_white_noise(3, 0.01, 7.0)
    assert noise[::2, ::2] == pytest.approx(one_axis, rel=1e-12)
    assert np.all(noise[::2, 1::2] == 0)


def test_transition_is_constant_acceleration() -> None:
    state = transition(0.5) @ np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    assert state == pytest.approx([1 + 1.5 + 0.625, 2 + 2 + 0.75, 3 + 2.5, 4 + 3, 5, 6])


def test_a_record_does_not_depend_on_its_company() -> None:
    fixes, covariance, valid = random_fixes(7, 60, 2)
    together = track(fixes, covariance, valid, STEP_S, TrackingSettings())
    for k in (0, 6):
        alone = track(fixes[k : k + 1], covariance[k : k + 1], valid[k : k + 1], STEP_S, TrackingSettings())
        assert np.array_equal(alone.state[0], together.state[k])


def test_missing_fixes_are_coasted_over() -> None:
    fixes, covariance, valid = random_fixes(1, 40, 3)
    valid[0, 20:] = False
    fixes[0, 20:] = 1e6
    state = track(fixes, covariance, valid, STEP_S, TrackingSettings()).state[0]
    assert state[20:] == pytest.approx(
        np.stack([np.linalg.matrix_power(transition(STEP_S), k + 1) @ state[19] for k in range(20)])
    )


def consistent_fixes(states: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Fixes of true states (B, S, 6) and their covariance, of the size that four sites give."""
    rng = np.random.default_rng(seed)
    factor = np.array([[0.03, 0, 0, 0], [0.01, 0.04, 0, 0], [0, 0, 0.05, 0], [0.005, 0, 0.02, 0.1]])
    covariance = np.broadcast_to(factor @ factor.T, (*states.shape[:2], 4, 4))
    return states[..., :4] + rng.normal(size=(*states.shape[:2], 4)) @ factor.T, covariance


def assert_in_chi_square_band(values: np.ndarray, freedom: int) -> None:
    """The mean of independent values lies in its 95 % band."""
    low, high = stats.chi2.ppf([0.025, 0.975], freedom * values.size) / values.size
    assert low < values.mean() < high


@pytest.mark.parametrize(("density", "true_density"), [(10.0, 10.0), (1e-6, 0.0)])
def test_errors_are_as_large_as_the_filter_says(density: float, true_density: float) -> None:
    """Truth of the filter's own kind: white jerk; and constant acceleration, with a filter that expects it."""
    records, snapshots = 150, 300
    rng = np.random.default_rng(7)
    settings = TrackingSettings(jerk_density=density, start_acceleration_mps2=2.0)
    states = np.zeros((records, snapshots, 6))
    states[:, 0] = np.concatenate([rng.normal(0, 30, (records, 4)), rng.normal(0, 2, (records, 2))], axis=1)
    jerk = np.linalg.cholesky(process_noise(STEP_S, 1.0)) * np.sqrt(true_density)
    for k in range(1, snapshots):
        states[:, k] = states[:, k - 1] @ transition(STEP_S).T + rng.normal(size=(records, 6)) @ jerk.T
    fixes, covariance = consistent_fixes(states, 8)
    tracks = track(fixes, covariance, np.ones((records, snapshots), dtype=bool), STEP_S, settings)
    error = tracks.state[:, -1] - states[:, -1]
    assert_in_chi_square_band(np.einsum("na,nab,nb->n", error, np.linalg.inv(tracks.covariance), error), 6)
    assert_in_chi_square_band(tracks.innovation[:, 1:], 4)


def test_outliers_are_left_out_and_a_lost_vehicle_is_found_again() -> None:
    states = np.zeros((1, 400, 6))
    states[0, :, 0], states[0, :, 2] = 20 * np.arange(400) * STEP_S, 20.0
    fixes, covariance = consistent_fixes(states, 9)
    valid = np.ones((1, 400), dtype=bool)
    clean = track(fixes, covariance, valid, STEP_S, TrackingSettings())
    fixes[0, 100:400:25, :2] += 300.0
    spoiled = track(fixes, covariance, valid, STEP_S, TrackingSettings())
    assert np.abs(spoiled.state[0, 60:, :2] - clean.state[0, 60:, :2]).max() < 0.02
    open_gate = track(fixes, covariance, valid, STEP_S, TrackingSettings(gate=1e12))
    assert np.abs(open_gate.state[0, 60:, :2] - states[0, 60:, :2]).max() > 5
    fixes[0, 200:, :2] += 300.0
    moved = track(fixes, covariance, valid, STEP_S, TrackingSettings())
    assert np.abs(moved.state[0, 238, :2] - states[0, 238, :2]).max() < 0.1
    assert np.abs(moved.state[0, -1, :2] - 300 - states[0, -1, :2]).max() < 0.1


@pytest.mark.parametrize("cuts", [(40,), (1, 2, 77)])
def test_a_record_filtered_piece_by_piece_is_the_record(cuts: tuple[int, ...]) -> None:
    fixes, covariance, valid = random_fixes(3, 120, 4)
    fixes[:, 60:100, :2] += 300.0  # outliers, then a new start
    whole = track(fixes, covariance, valid, STEP_S, TrackingSettings())
    before, states = None, []
    for part in np.split(np.arange(120), cuts):
        before = track(fixes[:, part], covariance[:, part], valid[:, part], STEP_S, TrackingSettings(), before)
        states.append(before.state)
    assert (np.concatenate(states, axis=1) == whole.state).all()
    assert before is not None
    assert (before.covariance == whole.covariance).all()
    assert (before.refused == whole.refused).all()
