"""What it costs to read and label a long file: processor time and memory of FCD at 25 Hz with 200 vehicles at once.

    python -m isac_cosim.benchmarks.findings.trajectories.long_file [--minutes M]

Vehicles drive along the bundled straight road, one after the other in four lanes, and change lanes. Prints the numbers
of states and events, the processor time to read the file and to label its blocks, s, and the most memory used, MB.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.sources.protocol import recorded
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.generation.settings import DatasetStudy

SCENARIO = "straight_road"
AT_ONCE, RATE_HZ = 200, 25.0
SPEED_MPS = 28.0
PIECE = 1500
"""Steps that are written at once."""


def write(path: Path, minutes: float) -> None:
    """Write FCD, a minute at a time. Each vehicle has a speed of its own around 28 m/s, and changes its lane once."""
    rng = np.random.default_rng(7)
    lanes = [lane for lane in load(SCENARIO).lanes if not lane.edge.startswith(":")]
    names = pa.array([lane.id for lane in lanes])
    start_m, length_m = float(lanes[0].shape[0, 0]), lanes[0].length_m
    every_s = length_m / SPEED_MPS / AT_ONCE
    steps = int(minutes * 60.0 * RATE_HZ)
    drawn = rng.uniform((0.9, 10.0), (1.1, 80.0), (int(minutes * 60.0 / every_s), 2))
    speeds, turns_s = SPEED_MPS * drawn[:, 0], drawn[:, 1]
    firsts = np.ceil(np.arange(len(drawn)) * every_s * RATE_HZ).astype(int)
    ends = np.minimum(firsts + (length_m / speeds * RATE_HZ).astype(int), steps)
    sides = np.array([lane.shape[0, 1] for lane in lanes])
    writer: pq.ParquetWriter | None = None
    for begin in range(0, steps, PIECE):
        number = np.flatnonzero((firsts < begin + PIECE) & (ends > begin))
        spans = [np.arange(max(firsts[k], begin), min(ends[k], begin + PIECE)) for k in number.tolist()]
        step, vehicle = np.concatenate(spans), np.repeat(number, [len(span) for span in spans])
        order = np.argsort(step, kind="stable")
        step, vehicle = step[order], vehicle[order]
        after_s = (step - firsts[vehicle]) / RATE_HZ
        share = np.clip((after_s - turns_s[vehicle]) / 4.0, 0.0, 1.0)
        share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        before = vehicle % len(lanes)
        beside = np.minimum(before + 1, len(lanes) - 1)
        table = pa.table(
            {
                "timestep_time": np.round(step / RATE_HZ, 3),
                "vehicle_id": pa.array(vehicle).cast(pa.string()),
                "vehicle_x": np.round(start_m + after_s * speeds[vehicle], 2),
                "vehicle_y": np.round(sides[before] + share * (sides[beside] - sides[before]), 2),
                "vehicle_lane": names.take(pa.array(np.where(share < 0.5, before, beside))),
            }
        )
        writer = writer or pq.ParquetWriter(path, table.schema)
        writer.write_table(table)
    if writer:
        writer.close()


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drive.parquet"
        write(path, arguments.minutes)
        before_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
        content = {"source": "fcd", "scenarios": [str(path)], "fcd": {"network": SCENARIO}}
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
