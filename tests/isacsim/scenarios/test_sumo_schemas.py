"""Numbers as they are handed to SUMO."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from isac_cosim.isacsim.scenarios.sumo_schemas import in_full


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_in_full_reads_as_the_same_number(number: float) -> None:
    text = in_full(number)
    assert float(text) == number
    assert "e" not in text.lower()
