"""Numbers and times, held against SUMO's own reading."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from isacsim.scenarios.sumo_values import in_full, seconds
from isacsim.traffic.sumo_library import load_libsumo
from tests.support.roads import straight_road

TIMES = ["01:00:00", "1:2:3:4", "0:0:30.5", "1.5:0:0", "1e3", "5.", ".5", "+5", "1:-2:3", "00:00:1e1", "123456.75"]
NO_TIMES = ["5s", "1:00", "1:2:3:4:5", "1_0", "inf", "nan", "", "::"]


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_in_full_reads_as_the_same_number(number: float) -> None:
    text = in_full(number)
    assert float(text) == number
    assert "e" not in text.lower()


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return straight_road(tmp_path_factory.mktemp("road"), "") / "r.net.xml"


@pytest.mark.parametrize("text", TIMES)
def test_times_are_read_as_sumo_reads_them(network: Path, text: str) -> None:
    libsumo = load_libsumo()
    libsumo.start(["sumo", f"--net-file={network}", f"--begin={text}", "--step-length=0.01", "--no-step-log=true"])
    try:
        assert libsumo.simulation.getTime() == pytest.approx(seconds(text), abs=1e-9)
    finally:
        libsumo.close()


@pytest.mark.parametrize("text", NO_TIMES)
def test_what_sumo_does_not_read_is_no_time(text: str) -> None:
    with pytest.raises(ValueError, match="is not a"):
        seconds(text)
