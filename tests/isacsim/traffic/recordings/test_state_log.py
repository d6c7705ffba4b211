"""States are stored by vehicle, and the memory for them does not grow with simulated time."""

import numpy as np
import pytest

from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.recordings.recording import COLUMNS
from isac_cosim.isacsim.traffic.recordings.state_log import ROWS, RowSorter
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record

LIFE = 7
"""Number of steps that each made-up vehicle is on the road. One arrives and one leaves every step."""


def values(vehicle: int, step: int) -> list[float]:
    return [1000.0 * vehicle + step + 0.1 * row for row in range(ROWS)]


def made_up(steps: int) -> list[tuple[int, int]]:
    """Vehicle and step of every row, step by step."""
    return [(vehicle, step) for step in range(steps) for vehicle in range(max(0, step - LIFE + 1), step + 1)]


@pytest.mark.parametrize("batch", [1, 5, 64, 10_000])
def test_rows_are_sorted_by_vehicle_for_any_size_of_batch(batch: int) -> None:
    rows, sorter = made_up(50), RowSorter()
    for start in range(0, len(rows), batch):
        part = rows[start : start + batch]
        present = sorted({vehicle for vehicle, _ in part}, reverse=True)
        sorter.add(
            [f"v{vehicle}" for vehicle in present],
            np.array([present.index(vehicle) for vehicle, _ in part]),
            np.array([step for _, step in part]),
            np.array([values(*row) for row in part]).T,
        )
    blocks = list(sorter.blocks())
    assert [(name, first) for name, first, _ in blocks] == [(f"v{k}", k) for k in range(50)]
    for vehicle, (_, _, block) in enumerate(blocks):
        steps = range(vehicle, min(vehicle + LIFE, 50))
        np.testing.assert_array_equal(block, np.array([values(vehicle, step) for step in steps]).T)


def test_only_rows_of_vehicles_on_the_road_wait_in_memory() -> None:
    """Rows of the last LIFE + 1 steps, however long the simulation is."""
    sorter, most = RowSorter(), 0
    for step in range(2000):
        vehicles = range(max(0, step - LIFE + 1), step + 1)
        names = [f"v{vehicle}" for vehicle in vehicles]
        block = np.array([values(vehicle, step) for vehicle in vehicles]).T
        sorter.add(names, np.arange(len(names)), np.full(len(names), step), block)
        most = max(most, sorter.waiting_rows)
    assert LIFE * (LIFE + 1) / 2 <= most <= (LIFE + 1) * (LIFE + 2) / 2 + LIFE
    assert len(list(sorter.blocks())) == 2000


@pytest.mark.parametrize("sample_s", [0.01, 0.1])
def test_reading_in_small_batches_changes_nothing(sample_s: float, monkeypatch: pytest.MonkeyPatch) -> None:
    traffic = TrafficSettings(sample_s=sample_s, run_in_s=40.0, duration_s=8.0)
    whole = record(load("motorway"), 3, traffic, ManeuverSettings())
    monkeypatch.setattr("isac_cosim.isacsim.traffic.recordings.state_log.BATCH_ROWS", 997)
    monkeypatch.setattr("isac_cosim.isacsim.traffic.recordings.sampled_log.MANY", 997)
    monkeypatch.setattr("isac_cosim.isacsim.traffic.recordings.sampled_log.SAMPLES_AT_ONCE", 99)
    parts = record(load("motorway"), 3, traffic, ManeuverSettings())
    assert list(whole.tracks) == list(parts.tracks)
    for name, track in whole.tracks.items():
        for column in COLUMNS:
            np.testing.assert_array_equal(getattr(track, column), getattr(parts.tracks[name], column))
