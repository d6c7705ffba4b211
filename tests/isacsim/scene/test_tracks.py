"""Which track stands for a vehicle, when tracks are swapped, end and are taken up again."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from isac_cosim.isacsim.scene.tracks import FollowedVehicle, SceneTracks, TrackedInstant

HZ = 10.0


def scene(*instants: Mapping[int, tuple[str | None, float]]) -> SceneTracks:
    """Tracks along the x axis at 20 m/s: at each instant, for each number its vehicle and its position, m."""
    tracks = SceneTracks(HZ)
    for fix, there in enumerate(instants):
        count = len(there)
        state = np.zeros((count, 6))
        state[:, 0] = [place for _, place in there.values()]
        state[:, 2] = 20.0
        whole = np.full(count, 3)
        covariance = np.tile(np.diag([0.005, 0.005]), (count, 1, 1))
        tracks.instants[fix] = TrackedInstant(
            np.array(list(there), np.int64), state, covariance, whole + 1, whole, np.full(count, 12.0),
            tuple(vehicle for vehicle, _ in there.values()),
        )  # fmt: skip
    return tracks


def followed(tracks: SceneTracks, count: int) -> FollowedVehicle:
    found = tracks.followed("a", np.arange(4 * count) / (4 * HZ))
    assert found is not None
    return found


def test_between_instants_a_track_is_predicted_from_the_latest() -> None:
    of = followed(scene(*({7: ("a", 2.0 * k + 0.5 * k)} for k in range(3))), 3)
    # Each instant is 0.5 m farther than the speed says: the prediction never sees the next one.
    expected = [2.5 * k + 20.0 * late for k in range(3) for late in (0.0, 0.025, 0.05, 0.075)]
    assert of.state[0] == pytest.approx(expected)
    assert (of.track, of.right_share, of.breaks, of.n_sites) == (7, 1.0, 0, 4)
    assert of.detected == pytest.approx(0.75)
    assert (of.snr_db, of.position_sd_m) == (12.0, pytest.approx(0.1))


def test_a_swapped_track_is_followed_on() -> None:
    tracks = scene({1: ("a", 0.0), 2: ("b", 50.0)}, {1: ("b", 2.0), 2: ("a", 52.0)}, {1: (None, 4.0), 2: ("a", 54.0)})
    of = followed(tracks, 3)
    assert of.state[0, ::4] == pytest.approx([0.0, 2.0, 4.0])
    assert of.right_share == pytest.approx(1 / 3)
    assert of.breaks == 0


def test_a_lost_track_is_taken_up_where_the_vehicle_should_be() -> None:
    of = followed(scene({1: ("a", 0.0)}, {2: ("b", 90.0)}, {2: ("b", 92.0)}, {2: ("b", 94.0), 5: ("a", 6.5)}), 4)
    assert of.state[0, ::4] == pytest.approx([0.0, 2.0, 4.0, 6.5])
    assert (of.track, of.breaks, of.right_share, of.n_sites) == (1, 1, 0.5, 0)


def test_a_vehicle_without_a_track_at_the_beginning_is_not_known() -> None:
    tracks = scene({1: ("b", 0.0)}, {1: ("a", 2.0)})
    assert tracks.followed("a", np.array([0.0, 0.1])) is None
    assert tracks.followed("a", np.array([0.1])) is not None
    assert tracks.followed("a", np.array([7.0])) is None


def held(tracks: SceneTracks, count: int, lost_s: float, watched: list[bool] | None = None) -> list[bool]:
    """Twice an instant: what is between two instants is as at the earlier one."""
    times, at = np.arange(2 * count) / (2 * HZ), np.array(watched or [True] * count).repeat(2)
    of_instants = tracks.held("a", times, at, lost_s).reshape(count, 2)
    assert (of_instants[:, 0] == of_instants[:, 1]).all()
    return of_instants[:, 0].tolist()


def test_a_track_is_held_until_it_has_been_lost_for_too_long() -> None:
    """Two instants without a track are bridged, the third is not; the vehicle's next track begins anew."""
    tracks = scene({}, {1: ("a", 0.0)}, {}, {}, {}, {}, {4: ("b", 12.0)}, {4: ("b", 14.0), 5: ("a", 60.0)})
    assert held(tracks, 8, lost_s=0.2) == [False, True, True, True, False, False, False, True]
    assert held(tracks, 8, lost_s=9.0) == [False, *[True] * 7]


def test_a_swapped_track_is_held() -> None:
    tracks = scene({1: ("a", 0.0)}, *({1: ("b", 2.0 * k), 2: ("a", 50.0 + 2.0 * k)} for k in range(1, 6)))
    assert held(tracks, 6, lost_s=0.2) == [True] * 6


def test_a_vehicle_out_of_view_is_not_held() -> None:
    tracks = scene({1: ("a", 0.0)}, {1: ("a", 2.0)}, {1: ("b", 4.0)}, {1: ("b", 6.0), 2: ("a", 50.0)})
    watched = [True, False, True, True]
    assert held(tracks, 4, lost_s=9.0, watched=watched) == [True, False, False, True]
