"""What it costs to read and label a long file: processor time and memory, with 200 vehicles at once.

    python -m isac_cosim.benchmarks.findings.trajectories.long_file [fcd|highd|exid|ngsim] [--minutes M]

Vehicles drive along the bundled straight road, one after the other in four lanes, and change lanes: at 25 Hz, and at
10 Hz for NGSIM. Prints the numbers of states and events, the processor time to read the file and to label its blocks,
s, and the most memory used, MB.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.sources.protocol import recorded
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.generation.settings import DatasetStudy

SCENARIO = "straight_road"
AT_ONCE, RATE_HZ, NGSIM_HZ = 200, 25.0, 10.0
SPEED_MPS = 28.0
LENGTH_M, WIDTH_M, LANE_M, FOOT_M = 4.5, 1.8, 3.6, 0.3048
PIECE = 1500
"""Steps that are written at once."""
Columns = dict[str, Any]


@dataclass(frozen=True)
class DrivenPiece:
    """States in the order of time, shape (n,): number of the step and of the vehicle; metres along the road, and place
    between the lanes, where 0 is the centre of the rightmost one and 1 that of the next."""

    step: IntArray
    vehicle: IntArray
    along: Array
    place: Array

    @property
    def lane(self) -> IntArray:
        """Number of the lane, from the right, (n,)."""
        return np.floor(self.place + 0.5).astype(np.int64)


def driven(minutes: float, lanes: int, length_m: float, rate_hz: float) -> tuple[int, Iterator[DrivenPiece]]:
    """Return how many vehicles there are, and yield their states, a minute at a time.

    Each vehicle has a speed of its own around 28 m/s, and changes its lane once.
    """
    rng = np.random.default_rng(7)
    every_s = length_m / SPEED_MPS / AT_ONCE
    steps = int(minutes * 60.0 * rate_hz)
    drawn = rng.uniform((0.9, 10.0), (1.1, 80.0), (int(minutes * 60.0 / every_s), 2))
    speeds, turns_s = SPEED_MPS * drawn[:, 0], drawn[:, 1]
    firsts = np.ceil(np.arange(len(drawn)) * every_s * rate_hz).astype(int)
    ends = np.minimum(firsts + (length_m / speeds * rate_hz).astype(int), steps)

    def pieces() -> Iterator[DrivenPiece]:
        for begin in range(0, steps, PIECE):
            number = np.flatnonzero((firsts < begin + PIECE) & (ends > begin))
            spans = [np.arange(max(firsts[k], begin), min(ends[k], begin + PIECE)) for k in number.tolist()]
            step, vehicle = np.concatenate(spans), np.repeat(number, [len(span) for span in spans])
            order = np.argsort(step, kind="stable")
            step, vehicle = step[order], vehicle[order]
            after_s = (step - firsts[vehicle]) / rate_hz
            share = np.clip((after_s - turns_s[vehicle]) / 4.0, 0.0, 1.0)
            share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
            before = vehicle % lanes
            beside = np.minimum(before + 1, lanes - 1)
            yield DrivenPiece(step, vehicle, after_s * speeds[vehicle], before + share * (beside - before))

    return int((ends > firsts).sum()), pieces()


def write(path: Path, minutes: float) -> None:
    """Write FCD in Parquet."""
    lanes = road_lanes()
    names, sides = pa.array([lane.id for lane in lanes]), np.array([lane.shape[0, 1] for lane in lanes])
    _, pieces = driven(minutes, len(lanes), lanes[0].length_m, RATE_HZ)
    writer: pq.ParquetWriter | None = None
    for piece in pieces:
        table = pa.table(
            {
                "timestep_time": np.round(piece.step / RATE_HZ, 3),
                "vehicle_id": pa.array(piece.vehicle).cast(pa.string()),
                "vehicle_x": np.round(lanes[0].shape[0, 0] + piece.along, 2),
                "vehicle_y": np.round(np.interp(piece.place, np.arange(len(sides)), sides), 2),
                "vehicle_lane": names.take(pa.array(piece.lane)),
            }
        )
        writer = writer or pq.ParquetWriter(path, table.schema)
        writer.write_table(table)
    if writer:
        writer.close()


def road_lanes() -> list[Lane]:
    """Return the lanes of the straight road, from the right."""
    return [lane for lane in load(SCENARIO).lanes if not lane.edge.startswith(":")]


def write_highd(path: Path, minutes: float) -> None:
    """Write `01_tracks.csv` in the format of highD, with as many columns, and the files beside it."""
    vehicles, pieces = driven(minutes, 4, road_lanes()[0].length_m, RATE_HZ)

    def columns(piece: DrivenPiece) -> Columns:
        down = (4.0 - piece.place) * LANE_M  # y points down, and the lower carriageway leads to the right
        return {
            "frame": piece.step + 1, "id": piece.vehicle + 1, "x": np.round(piece.along - LENGTH_M, 2),
            "y": np.round(down - WIDTH_M / 2.0, 2), "width": LENGTH_M, "height": WIDTH_M, "xVelocity": SPEED_MPS,
            "yVelocity": 0.0, **{f"other{k}": -1.25 for k in range(16)}, "laneId": 4 - piece.lane,
        }  # fmt: skip

    _write_csv(path, map(columns, pieces))
    kinds = {"width": LENGTH_M, "height": WIDTH_M, "class": "Car", "drivingDirection": 2}
    _write_csv(path.with_name("01_tracksMeta.csv"), [{"id": np.arange(vehicles) + 1, **kinds}])
    markings = ";".join(f"{(k + 0.5) * LANE_M:.2f}" for k in range(5))
    meta = {"id": [1], "frameRate": RATE_HZ, "upperLaneMarkings": "", "lowerLaneMarkings": markings}
    _write_csv(path.with_name("01_recordingMeta.csv"), [meta])


def write_exid(path: Path, minutes: float) -> None:
    """Write `01_tracks.csv` in the format of exiD, on the straight road, and the files beside it."""
    lanes = road_lanes()
    sides = np.array([lane.shape[0, 1] for lane in lanes])
    vehicles, pieces = driven(minutes, len(lanes), lanes[0].length_m, RATE_HZ)

    def columns(piece: DrivenPiece) -> Columns:
        x, y = lanes[0].shape[0, 0] + piece.along, np.interp(piece.place, np.arange(len(sides)), sides)
        return {
            "recordingId": 1, "trackId": piece.vehicle, "frame": piece.step, "xCenter": np.round(x - LENGTH_M / 2.0, 5),
            "yCenter": np.round(y, 5), "heading": 0.0, "width": WIDTH_M, "length": LENGTH_M, "xVelocity": SPEED_MPS,
            "yVelocity": 0.0, **{f"other{k}": -1.25 for k in range(8)}, "laneletId": "12;13",
        }  # fmt: skip

    _write_csv(path, map(columns, pieces))
    kinds = {"width": WIDTH_M, "length": LENGTH_M, "class": "car"}
    _write_csv(path.with_name("01_tracksMeta.csv"), [{"trackId": np.arange(vehicles), **kinds}])
    meta = {"recordingId": [1], "locationId": 0, "frameRate": RATE_HZ, "xUtmOrigin": 0.0, "yUtmOrigin": 0.0}
    _write_csv(path.with_name("01_recordingMeta.csv"), [meta])


def write_ngsim(path: Path, minutes: float) -> None:
    """Write columns without a header, with blanks between them, in the format of NGSIM."""
    _, pieces = driven(minutes, 4, road_lanes()[0].length_m, NGSIM_HZ)

    def columns(piece: DrivenPiece) -> Columns:
        across, along = (4.0 - piece.place) * LANE_M / FOOT_M, piece.along / FOOT_M
        return {
            "id": piece.vehicle, "frame": piece.step, "frames": 900, "time": 1118846980200 + 100 * piece.step,
            "x": np.round(across, 3), "y": np.round(along, 3), "east": 6451137.641, "north": 1873344.962,
            "length": 14.8, "width": 5.9, "class": 2, "speed": 91.86, "acceleration": 0.0,
            "lane": 4 - piece.lane, **{f"other{k}": -1.25 for k in range(4)},
        }  # fmt: skip

    _write_csv(path, map(columns, pieces), header=False, delimiter=" ")


def _write_csv(
    path: Path, tables: Iterator[Columns] | Sequence[Columns], header: bool = True, delimiter: str = ","
) -> None:
    """Write tables below each other. A column is an array, or one value for all rows."""
    with path.open("wb") as out:
        for columns in tables:
            rows = max(len(column) for column in columns.values() if isinstance(column, np.ndarray | list))
            whole = {
                name: column if isinstance(column, np.ndarray | list) else pa.repeat(column, rows)
                for name, column in columns.items()
            }
            pa_csv.write_csv(
                pa.table(whole),
                out,
                pa_csv.WriteOptions(include_header=header, delimiter=delimiter, quoting_style="none"),
            )
            header = False


FORMATS: dict[str, tuple[str, str, Callable[[Path, float], None]]] = {
    "fcd": ("fcd", "drive.parquet", write),
    "highd": ("levelx", "01_tracks.csv", write_highd),
    "exid": ("levelx", "01_tracks.csv", write_exid),
    "ngsim": ("ngsim", "trajectories.txt", write_ngsim),
}
"""Source, name of the file, and what writes it."""


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("format", nargs="?", choices=[*FORMATS], default="fcd")
    parser.add_argument("--minutes", type=float, default=60.0)
    arguments = parser.parse_args()
    name, file, writer = FORMATS[arguments.format]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / file
        writer(path, arguments.minutes)
        before_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
        settings = {name: {"network": SCENARIO}} if arguments.format in ("fcd", "exid") else {}
        content = {"source": name, "scenarios": [str(path)], **settings}
        study = DatasetStudy.model_validate(content)
        source = motion_source(study)
        began = time.process_time()
        place = source.load(str(path))
        read_s = time.process_time() - began
        events = 0
        for seed in source.seeds(place) or ():
            events += len(label(recorded(source, place, seed), study.labels).events)
        whole_s = time.process_time() - began
        print(source.remarks(place)[0])
        print(f"events {events}, read {read_s:.1f} s, labelled {whole_s - read_s:.1f} s", end=", ")
        print(f"most memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3:.0f} MB ({before_mb:.0f} before)")


if __name__ == "__main__":
    main()
