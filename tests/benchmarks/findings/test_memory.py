"""The benchmark of memory says where it runs, and what it reports."""

from pathlib import Path

import pytest

import isac_cosim.benchmarks.findings.memory
from isac_cosim.base.errors import InputError


def test_where_there_is_no_proc_the_message_names_linux(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(isac_cosim.benchmarks.findings.memory, "STATUS", tmp_path / "status")
    with pytest.raises(InputError, match="which only Linux has: run it there"):
        isac_cosim.benchmarks.findings.memory.run(1.0)


@pytest.mark.skipif(
    not isac_cosim.benchmarks.findings.memory.STATUS.is_file(), reason="reads /proc, which only Linux has"
)
def test_memory_that_is_held_shows() -> None:
    with isac_cosim.benchmarks.findings.memory.sampled() as samples:
        held = bytearray(b"x" * 2**26)
    largest, before = isac_cosim.benchmarks.findings.memory.peaks(samples), samples[0]
    assert len(held) == 2**26
    for quantity in isac_cosim.benchmarks.findings.memory.QUANTITIES:
        assert largest[quantity] >= before[quantity] + 60.0
