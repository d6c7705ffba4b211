"""Which vehicles are connected, and which of them is paired with a target."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.samples.uv_choice import PairSettings, around_tv, choose_uv, connected, may_be_tv
from tests.support.drives import WIDTH_M, Drive, Road, record

ALL = PairSettings()


def scene(**kinds: str) -> Recording:
    """A TV with a leader 60 m ahead, a nearer vehicle 20 m behind to the left, and a far one."""
    return record(
        Road(),
        Drive("tv", 500.0, lateral=WIDTH_M, kind=kinds.get("tv", "passenger")),
        Drive("leader", 560.0, lateral=WIDTH_M, kind=kinds.get("leader", "passenger")),
        Drive("near", 480.0, lateral=2 * WIDTH_M, kind=kinds.get("near", "passenger")),
        Drive("far", 650.0, lateral=0.0),
    )


def test_the_leader_comes_before_a_nearer_vehicle() -> None:
    pair = choose_uv(Surroundings(scene()), "tv", 5.0, ALL)
    assert pair is not None
    assert (pair.uv, pair.relation, pair.gap_m) == ("leader", "ahead", pytest.approx(60.0))


def test_without_a_connected_leader_the_nearest_on_the_carriageway() -> None:
    cars = PairSettings(uv_kinds=("passenger",), fall_back=True)
    pair = choose_uv(Surroundings(scene(leader="truck")), "tv", 5.0, cars)
    assert pair is not None
    assert (pair.uv, pair.relation, pair.gap_m) == ("near", "left", pytest.approx(-20.0))
    strict = PairSettings(uv_kinds=("passenger",))
    assert choose_uv(Surroundings(scene(leader="truck")), "tv", 5.0, strict) is None


def test_nobody_within_range() -> None:
    assert choose_uv(Surroundings(scene()), "tv", 5.0, PairSettings(range_m=15.0)) is None
    assert choose_uv(Surroundings(scene()), "tv", 0.5, ALL) is None
    assert choose_uv(Surroundings(scene()), "tv", 5.0, PairSettings(connected_share=0.0)) is None


def test_all_around_nearest_first() -> None:
    surroundings = Surroundings(scene())
    assert [pair.uv for pair in around_tv(surroundings, "tv", 5.0, ALL)] == ["near", "leader"]
    wide = around_tv(surroundings, "tv", 5.0, PairSettings(range_m=200.0))
    assert [(pair.uv, pair.relation) for pair in wide] == [("near", "left"), ("leader", "ahead"), ("far", "right")]


@given(low=st.floats(0.0, 1.0), high=st.floats(0.0, 1.0))
@settings(max_examples=20, deadline=None)
def test_who_is_connected_at_a_share_is_so_at_a_greater_one(low: float, high: float) -> None:
    recording = scene()
    low, high = sorted((low, high))
    for track in recording.tracks.values():
        few, many = (connected(recording, track, PairSettings(connected_share=s)) for s in (low, high))
        assert many or not few


def test_the_connected_share_is_the_share() -> None:
    recording = record(Road(), *(Drive(f"v{k}", 10.0 * k, duration_s=0.01) for k in range(400)))
    share = np.mean([connected(recording, t, PairSettings(connected_share=0.3)) for t in recording.tracks.values()])
    assert share == pytest.approx(0.3, abs=0.07)


def test_which_kinds_may_be_targets() -> None:
    recording = scene(tv="truck")
    assert may_be_tv(recording.tracks["tv"], ALL)
    assert not may_be_tv(recording.tracks["tv"], PairSettings(tv_kinds=("passenger",)))
