"""A long file takes little more memory while it is read than its states take afterwards."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

from isac_cosim.benchmarks.findings.trajectories.long_file import SCENARIO, write
from isac_cosim.isacsim.traffic.sources.fcd import FcdSettings, FcdSource

MOST_BYTES = 80
"""For each state, while its file is read; it takes 28 afterwards, or 32 with a speed."""


def test_reading_takes_little_memory(tmp_path: Path) -> None:
    file = tmp_path / "drive.parquet"
    write(file, 2.0)
    source = FcdSource(fcd=FcdSettings(network=SCENARIO))
    source.open(file)  # what is read once, such as the network, does not count
    tracemalloc.start()
    try:
        read = source.open(file)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(read.observed) > 300_000
    assert peak < MOST_BYTES * len(read.observed)
