"""Episodes and records as tables in CSV files, in the scenario's plane. Numbers have all their digits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow as pa
from pyarrow import csv

from isac_cosim.base.errors import writing
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.dataset.dataset import SCALARS, STATE, Dataset, Sample
from isac_cosim.labeling.dataset.record_point import in_plane

Columns = Mapping[str, npt.NDArray[Any] | list[object]]
VEHICLES_FILE, SITES_FILE, SAMPLES_FILE, TV_FILE, UV_FILE = (
    "vehicles.csv", "sites.csv", "samples.csv", "tv.csv", "uv.csv"
)  # fmt: skip


def write_vehicles(recording: Recording, folder: Path, every: int) -> int:
    """Write the states of all vehicles of a recording, one vehicle after the other. Returns how many were written.

    every: of so many steps one is written, those whose number it divides. Raises OutputError.
    """
    count = 0
    names = np.array([lane.id for lane in recording.lanes], dtype=object)
    path = folder / VEHICLES_FILE
    with writing(path), path.open("wb") as file:
        header = True
        for track in recording.tracks.values():
            steps = np.arange(track.first_step, track.first_step + len(track))
            rows = np.flatnonzero(steps % every == 0)
            columns = {
                "time_s": np.round(steps[rows] * recording.step_s, 6),
                "vehicle": np.full(len(rows), track.vehicle, dtype=object),
                "kind": np.full(len(rows), track.kind, dtype=object),
                "length_m": np.full(len(rows), track.length_m),
                "width_m": np.full(len(rows), track.width_m),
                "x_m": track.x[rows],
                "y_m": track.y[rows],
                "speed_mps": track.speed[rows],
                "lane": names[track.lane[rows]],
                "lane_pos_m": track.lane_pos[rows],
                "lane_lat_m": track.lane_lat[rows],
            }
            csv.write_csv(_table(columns), file, csv.WriteOptions(include_header=header))
            header, count = False, count + len(rows)
    return count


def write_sites(sites: Iterable[Site], folder: Path) -> None:
    """Write the sites of a scenario. Raises OutputError."""
    rows = [(site.id, site.x, site.y, site.height_m, site.azimuth_deg) for site in sites]
    columns = zip(*rows, strict=True) if rows else [()] * 5
    names = ("site", "x_m", "y_m", "height_m", "azimuth_deg")
    _write({name: list(column) for name, column in zip(names, columns, strict=True)}, folder / SITES_FILE)


def write_samples(dataset: Dataset, folder: Path, rows: list[int] | slice = slice(None)) -> int:
    """Write what a dataset says of its samples, a row each, all columns but the states. Returns how many.

    rows: of the dataset, all of them if absent. Raises OutputError.
    """
    frame: pd.DataFrame = dataset.frame(list(SCALARS)).iloc[rows]
    _write({str(name): frame[name].to_numpy() for name in frame}, folder / SAMPLES_FILE)
    return len(frame)


def write_record(sample: Sample, rates_hz: tuple[float, float], folder: Path) -> int:
    """Write the states of a sample's TV, sensed and true, and of its UV. Returns how many instants were written.

    rates_hz: of the TV's and of the UV's states. Times are those of the simulation. Raises OutputError.
    """
    count = 0
    sides = (
        (TV_FILE, rates_hz[0], {"": sample.tv, "_true": sample.tv_truth}),
        (UV_FILE, rates_hz[1], {"": sample.uv}),
    )
    for name, rate_hz, states in sides:
        placed = {suffix: in_plane(values, sample.x0, sample.y0) for suffix, values in states.items()}
        n = placed[""].shape[1]
        columns = {"time_s": np.round(sample.t_start + np.arange(n) / rate_hz, 6)}
        columns |= {f"{state}{suffix}": placed[suffix][k] for suffix in placed for k, state in enumerate(STATE)}
        _write(columns, folder / name)
        count += n
    return count


def _write(columns: Columns, path: Path) -> None:
    with writing(path):
        csv.write_csv(_table(columns), path)


def _table(columns: Columns) -> pa.Table:
    return pa.table({name: pa.array(values) for name, values in columns.items()})
