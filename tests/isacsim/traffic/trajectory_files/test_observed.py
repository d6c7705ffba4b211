"""States of a file: sorted by vehicle and time, cut into blocks, made into pieces."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.traffic.trajectory_files.blocks import blocks, seen_before
from isac_cosim.isacsim.traffic.trajectory_files.lane_places import LanePlaces
from isac_cosim.isacsim.traffic.trajectory_files.observed import FileStates, FileVehicle, Rows, observed
from isac_cosim.isacsim.traffic.trajectory_files.tracks import pieces

LANES = [Lane(f"e_{k}", "e", k, 3.2, 5000.0, np.array([[0.0, 3.2 * k], [5000.0, 3.2 * k]]), ()) for k in range(3)]


def rows_of(seen: dict[str, list[int]], order: np.ndarray | None = None) -> tuple[Rows, list[FileVehicle]]:
    """Vehicles at 20 m/s in lane 0, seen at steps of 0.1 s. order: of the rows."""
    vehicle = np.concatenate([np.full(len(steps), k, np.int32) for k, steps in enumerate(seen.values())])
    step = np.concatenate([np.array(steps, np.int64) for steps in seen.values()])
    order = np.arange(len(step)) if order is None else order
    rows = Rows(
        vehicle[order], step[order] * 100, 2.0 * step[order], np.zeros(len(step)), np.zeros(len(step), np.int32), None,
        np.arange(len(step)),
    )  # fmt: skip
    return rows, [FileVehicle(name, "passenger", 4.5, 1.8) for name in seen]


@settings(deadline=None)
@given(st.permutations(range(40)))
def test_the_order_of_rows_does_not_matter(order: list[int]) -> None:
    seen = {"b": list(range(3, 23)), "a": list(range(20))}
    first = observed(*rows_of(seen), "file")
    again = observed(*rows_of(seen, np.array(order)), "file")
    assert [vehicle.id for vehicle in again.vehicles] == ["a", "b"]
    assert again.starts.tolist() == first.starts.tolist() == [0, 20, 40]
    assert (again.step == first.step).all()
    assert (again.x == first.x).all()


@settings(deadline=None)
@given(st.sets(st.integers(0, 200), min_size=10))
def test_a_vehicle_that_is_not_seen_for_long_has_several_pieces(steps: set[int]) -> None:
    seen = sorted(steps)
    states = observed(*rows_of({"v": seen, "steady": list(range(201))}), "file")
    number = [vehicle.id for vehicle in states.vehicles].index("v")
    found, _, _ = pieces(states, number, LanePlaces(LANES), np.empty(0, np.int64))
    runs = np.split(np.array(seen), np.flatnonzero(np.diff(seen) > 3) + 1)
    long = [run.tolist() for run in runs if len(run) >= 3]
    assert [piece.step.tolist() for piece in found] == long
    assert [piece.name for piece in found] == ["v", *(f"v#{k + 2}" for k in range(len(long) - 1))][: len(long)]


@settings(deadline=None)
@given(st.integers(100, 30_000), st.floats(20.0, 600.0), st.floats(0.0, 60.0))
def test_blocks_are_equal_and_apart(length: int, block_s: float, gap_s: float) -> None:
    states = observed(*rows_of({"v": list(range(7, 7 + length))}), "file")
    cut = blocks(states, block_s, gap_s)
    assert (cut[0].first, cut[-1].last) == (7, 6 + length)
    lengths = [block.last - block.first + 1 for block in cut]
    assert max(lengths) - min(lengths) <= 2
    assert all(later.first - earlier.last - 1 >= gap_s / 0.1 - 2 for earlier, later in pairwise(cut))


def test_stretches_of_time_with_nobody_between_have_blocks_of_their_own() -> None:
    states = observed(
        *rows_of({"a": list(range(300)), "b": list(range(1200, 2000)), "c": list(range(1950, 2600))}), "f"
    )
    cut = blocks(states, 80.0, 10.0)
    assert [(block.first, block.last) for block in cut] == [(0, 299), (1200, 1849), (1950, 2599)]
    assert len(blocks(states, 80.0, 100.0)) == len(blocks(states, 3600.0, 100.0)) + 1


def test_who_was_there_before() -> None:
    states = observed(
        *rows_of({"early": list(range(100)), "late": list(range(850, 1000)), "both": list(range(1000))}), "f"
    )
    cut = blocks(states, 40.0, 20.0)
    assert len(cut) == 2
    seen = {
        vehicle.id: bool(there) for vehicle, there in zip(states.vehicles, seen_before(states, cut, 1), strict=True)
    }
    assert seen == {"early": True, "both": True, "late": False}
    assert not seen_before(states, cut, 0).any()


def test_two_states_at_one_time_are_refused_with_their_rows() -> None:
    with pytest.raises(InputError, match=r"file: vehicle v has two states at 0\.3 s \(rows 3 and 4\)"):
        observed(*rows_of({"v": [0, 1, 2, 3, 3, 4]}), "file")


def test_states_far_apart_are_refused() -> None:
    with pytest.raises(InputError, match=r"are 2 s apart"):
        observed(*rows_of({"v": [0, 20, 40]}), "file")


def test_an_observation_knows_its_length() -> None:
    assert isinstance(states := observed(*rows_of({"v": [0, 1, 2]}), "f"), FileStates)
    assert len(states) == 3
