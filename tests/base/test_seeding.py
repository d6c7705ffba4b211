"""Keys of random streams: what they hold names the stream, whatever type holds it."""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isac_cosim.base.seeding import stream


def first(*keys: Any) -> int:
    """The first draw of a stream."""
    return int(stream(*keys).integers(2**62))


@given(st.integers(-(2**31), 2**31 - 1), st.sampled_from([np.int32, np.int64]))
def test_a_whole_number_names_the_same_stream_whoever_holds_it(number: int, kind: Callable[[int], Any]) -> None:
    assert first("echo", kind(number)) == first("echo", number)


@given(st.text())
def test_a_text_names_the_same_stream_whoever_holds_it(text: str) -> None:
    # NumPy's own text drops zeros at its end.
    assert first(np.str_(text)) == first(str(np.str_(text)))


def test_a_member_of_an_enumeration_is_its_number() -> None:
    class Kind(IntEnum):
        FIRST = 3

    assert first(Kind.FIRST) == first(3)


def test_a_number_is_not_its_text() -> None:
    assert first(1) != first("1")


@pytest.mark.parametrize(
    ("keys", "drawn"),
    [
        (("echo", "motorway", 7, 3), 3702209243711890439),
        (("split", 0), 3889550728869416158),
        (("it's", -1), 770965992749696183),
    ],
)
def test_the_draws_of_stored_datasets_stay(keys: tuple[str | int, ...], drawn: int) -> None:
    assert first(*keys) == drawn


@pytest.mark.parametrize("key", [True, np.True_, 1.0, np.float64(1.0), None, b"text", ("a",)], ids=repr)
def test_other_keys_are_refused(key: object) -> None:
    with pytest.raises(TypeError, match="must be text or a whole number"):
        stream("echo", key)  # type: ignore[arg-type]
