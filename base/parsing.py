"""Ranges and SNRs as people write them, on the command line and in study files."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from isac_cosim.base.errors import InputError

LINK = "link"
"""The SNR that stands for the link budget."""


def number_range(text: str, option: str, kind: Callable[[str], Any], example: str) -> tuple[Any, Any]:
    """Return both ends of a range A:B, where A is at most B.

    option: what the user wrote it behind, for messages. example: a range as it should be written.
    Raises InputError for anything else.
    """
    try:
        low, high = (kind(part) for part in text.split(":"))
    except ValueError:
        raise InputError(f"{option} {text}: is not a range; write it like {example}") from None
    if not low <= high:
        raise InputError(f"{option} {text}: is not a range: its first end is above its second; write it like {example}")
    return low, high


def channel(snr: str, option: str = "--snr") -> dict[str, Any]:
    """Return the settings of the channel that an SNR stands for: LO:HI or one value, dB, or `link`.

    option: what the user wrote it behind, for messages. Raises InputError for anything else.
    """
    if snr == LINK:
        return {"kind": "link"}
    if ":" in snr:
        return {"kind": "uniform", "snr_range_db": number_range(snr, option, float, "0:10")}
    try:
        return {"kind": "fixed", "snr_db": float(snr)}
    except ValueError:
        raise InputError(f"{option} {snr}: is not a range, a value or link; write it like 0:10, 5 or link") from None
