"""A long file is read in parts, as if it were read in one, and takes little more memory than its states afterwards."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.benchmarks.findings.trajectories.long_file import FORMATS, SCENARIO
from isac_cosim.isacsim.traffic.sources import levelx
from isac_cosim.isacsim.traffic.sources.recorded_files import FileSource
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.isacsim.traffic.trajectory_files import lane_places, ngsim_table, tables
from isac_cosim.labeling.generation.settings import DatasetStudy

MOST_BYTES = {"fcd": 80, "highd": 80, "exid": 80, "ngsim": 150}
"""For each state, while its file is read; it takes 28 afterwards, or 32 with a speed."""


def source_of(kind: str) -> FileSource:
    name = FORMATS[kind][0]
    settings = {name: {"network": SCENARIO}} if kind in ("fcd", "exid") else {}
    source = motion_source(DatasetStudy.model_validate({"source": name, "scenarios": ["unused"], **settings}))
    assert isinstance(source, FileSource)
    return source


def small_parts(monkeypatch: pytest.MonkeyPatch, rows: int) -> None:
    monkeypatch.setattr(levelx, "AT_ONCE", rows)
    monkeypatch.setattr(ngsim_table, "CHUNK", rows)
    monkeypatch.setattr(lane_places, "AT_ONCE", 3 * rows)


@pytest.mark.parametrize("kind", FORMATS)
def test_a_file_is_read_in_parts_as_in_one(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, name, write = FORMATS[kind]
    write(tmp_path / name, 0.2)
    whole = source_of(kind).open(tmp_path / name).observed
    small_parts(monkeypatch, 100)
    monkeypatch.setattr(tables, "BLOCK", 1 << 13)
    monkeypatch.setattr(tables, "BATCH", 100)
    parts = source_of(kind).open(tmp_path / name).observed
    assert len(whole) > 500
    assert parts.vehicles == whole.vehicles
    for column in ("starts", "step", "x", "y", "lane", "speed"):
        one, other = getattr(whole, column), getattr(parts, column)
        assert (one is None and other is None) or one.tobytes() == other.tobytes()


def test_time_that_runs_backwards_between_two_parts_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, name, write = FORMATS["highd"]
    write(tmp_path / name, 0.2)
    header, *rows = (tmp_path / name).read_text().splitlines(keepends=True)
    (tmp_path / name).write_text("".join([header, *rows[600:], *rows[:600]]))
    monkeypatch.setattr(tables, "BLOCK", 1 << 13)
    with pytest.raises(InputError, match=r"row \d+: time runs backwards, from frame \d+ to 1 of vehicle 1; sort the"):
        source_of("highd").open(tmp_path / name)


@pytest.mark.parametrize("kind", FORMATS)
def test_reading_takes_little_memory(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small_parts(monkeypatch, 20_000)
    _, file, write = FORMATS[kind]
    write(tmp_path / file, 2.0)
    source = source_of(kind)
    source.open(tmp_path / file)  # what is read once, such as the network, does not count
    tracemalloc.start()
    try:
        read = source.open(tmp_path / file)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(read.observed) > 100_000
    assert peak < MOST_BYTES[kind] * len(read.observed)
