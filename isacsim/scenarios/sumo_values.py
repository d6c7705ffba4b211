"""Numbers and times as SUMO reads and writes them."""

from __future__ import annotations

import re
from decimal import Decimal

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_UNITS_S = {3: (3600.0, 60.0, 1.0), 4: (86_400.0, 3600.0, 60.0, 1.0)}
"""Seconds of each part of a time with colons: hours, minutes and seconds, with days before them or not."""


def seconds(text: str) -> float:
    """Return a time as SUMO reads it: seconds, `HH:MM:SS` or `DD:HH:MM:SS`, of which every part may have decimals.

    Raises ValueError for anything else.

    >>> seconds("01:00:00"), seconds("1:2:3:4.5"), seconds("-0:0:30"), seconds("1e3")
    (3600.0, 93784.5, -30.0, 1000.0)
    """
    text = text.strip()
    if ":" not in text:
        return _number(text)
    sign, digits = (-1.0, text[1:]) if text.startswith("-") else (1.0, text)
    parts = digits.split(":")
    if len(parts) not in _UNITS_S:
        raise ValueError(f"{text!r} is not a time")
    return sign * sum(unit * _number(part) for unit, part in zip(_UNITS_S[len(parts)], parts, strict=True))


def in_full(number: float) -> str:
    """Return a number with all its digits and without an exponent, so that reading it gives the same number.

    >>> in_full(1000003.0), in_full(123456.75), in_full(1e-7), in_full(0.1)
    ('1000003', '123456.75', '0.0000001', '0.1')
    """
    return format(Decimal(repr(float(number))), "f").removesuffix(".0")


def _number(text: str) -> float:
    if not _NUMBER.fullmatch(text):
        raise ValueError(f"{text!r} is not a number")
    return float(text)
