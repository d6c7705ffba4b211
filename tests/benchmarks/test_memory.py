"""The benchmark of memory says where it runs, and what it reports."""

from pathlib import Path

import pytest

import benchmarks.memory
from isacsim.errors import InputError


def test_where_there_is_no_proc_the_message_names_linux(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(benchmarks.memory, "STATUS", tmp_path / "status")
    with pytest.raises(InputError, match="which only Linux has: run it there"):
        benchmarks.memory.run(1.0)


@pytest.mark.skipif(not benchmarks.memory.STATUS.is_file(), reason="reads /proc, which only Linux has")
def test_memory_that_is_held_shows() -> None:
    with benchmarks.memory.sampled() as samples:
        held = bytearray(b"x" * 2**26)
    largest, before = benchmarks.memory.peaks(samples), samples[0]
    assert len(held) == 2**26
    for quantity in benchmarks.memory.QUANTITIES:
        assert largest[quantity] >= before[quantity] + 60.0
