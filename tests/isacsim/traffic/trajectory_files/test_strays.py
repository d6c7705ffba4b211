"""States at the ends of a road that no vehicle can have driven to are found, and nothing else is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.traffic.trajectory_files.strays import check_strays, strays

VEHICLES, STATES, RATE_HZ = 6, 40, 25.0
FILE = Path("folder/file.csv")
FAR_M = st.floats(5e3, 1e6) | st.floats(-1e6, -5e3)


def driven() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vehicles at 20 to 45 m/s, one after the other: numbers, frames, and metres along the road."""
    vehicle = np.repeat(np.arange(VEHICLES, dtype=np.int32), STATES)
    frame = np.tile(np.arange(STATES), VEHICLES) + 10 * vehicle
    return vehicle, frame, 100.0 * vehicle + (20.0 + 5.0 * vehicle) * frame / RATE_HZ


@settings(deadline=None)
@given(
    wrong=st.dictionaries(st.integers(0, VEHICLES * STATES - 1), FAR_M, max_size=8),
    order=st.permutations(range(VEHICLES * STATES)),
)
def test_wrong_states_are_found_in_any_order(wrong: dict[int, float], order: list[int]) -> None:
    vehicle, frame, along = driven()
    for row, value in wrong.items():
        along[row] = value * (1.0 + row)  # two of them never lie beside each other
    found = strays(vehicle[order], frame[order], RATE_HZ, along[order])
    assert sorted(np.array(order)[found].tolist()) == sorted(wrong)


def test_a_value_that_stands_for_missing_ones_is_found_where_it_lasts() -> None:
    vehicle, frame, along = driven()
    along[50:58] = -9999.0
    along[80:83] = 0.0  # 200 m behind: the first states of a vehicle, but within the road
    assert np.flatnonzero(strays(vehicle, frame, RATE_HZ, along)).tolist() == [*range(50, 58)]
    along[80:83] = -30.0
    assert np.flatnonzero(strays(vehicle, frame, RATE_HZ, along)).tolist() == [*range(50, 58), 80, 81, 82]


def test_a_vehicle_that_is_not_seen_for_a_while_is_none() -> None:
    vehicle, frame, along = driven()
    frame[20:40] += 1000  # 40 s, in which it has driven 800 m
    along[20:40] += 800.0
    assert not strays(vehicle, frame, RATE_HZ, along).any()


def test_what_is_said_names_the_row_and_how_far_it_is_away() -> None:
    vehicle, frame, along = driven()
    number = np.arange(len(vehicle), dtype=np.int32) + 2
    none = strays(vehicle, frame, RATE_HZ, along)
    assert check_strays(none, vehicle, along, number, FILE) == []
    along[45] = along[44] - 1e6
    found = strays(vehicle, frame, RATE_HZ, along)
    (line,) = check_strays(found, vehicle, along, number, FILE)
    assert (
        line
        == "file.csv: row 47 lies 1e+06 m from where its vehicle is otherwise: 1 such state(s) are left out; fix them"
    )


def test_positions_that_are_wrong_as_a_rule_are_refused() -> None:
    vehicle, frame, along = driven()
    number = np.arange(len(vehicle), dtype=np.int32) + 2
    many = along.copy()
    many[::10] *= 1e4
    with pytest.raises(
        InputError, match=r"^folder/file\.csv: row \d+ lies .* and so do rows of 6 of 6 vehicles; fix their"
    ):
        check_strays(strays(vehicle, frame, RATE_HZ, many), vehicle, many, number, FILE)
    metres = along * 1e3
    none = np.zeros(len(along), bool)
    with pytest.raises(
        InputError, match=r"^folder/file\.csv: its road would be \d+ km long, for the sake of row 241; give pos"
    ):
        check_strays(none, vehicle, metres, number, FILE)
