"""Fields of settings that name the source of their default, and ranges that values are drawn from."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, ValidatorFunctionWrapHandler, WrapValidator

LARGEST_MPS3 = 20.0
"""Largest jerk of a vehicle under command, m/s3."""

Range = tuple[float, float]
"""The low and the high end of a range, in the unit at the end of the setting's name."""
Instant = Annotated[float, Field(ge=-1e3, le=1e3)]
"""Time after an instant of a record, s; negative is before."""
WindowEnds = tuple[Instant, Instant]
"""The earliest and the latest end of a window after an instant of its record, s."""
Seed = Annotated[int, Field(ge=0, le=2**32 - 1)]
"""Seed of a random generator: what each of the libraries here takes."""


def range_within(least: float, most: float) -> WrapValidator:
    """Return a validator of a range: low <= high, both between least and most."""

    def check(value: Any, parse: ValidatorFunctionWrapHandler) -> Range:
        if not isinstance(value, list | tuple) or len(value) != 2:
            raise ValueError("must be a range [low, high]")
        low, high = parse(value)
        if low > high:
            raise ValueError("must be a range [low, high] with low <= high")
        if low < least or high > most:
            raise ValueError(f"must be a range [low, high] between {least:g} and {most:g}")
        return low, high

    return WrapValidator(check)


def sourced(
    default: Any,
    description: str,
    source: str,
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
) -> Any:
    """Return a field whose default names its source: "published: …", "measured: …", or "chosen: why"."""
    return Field(default, description=description, json_schema_extra={"source": source}, ge=ge, gt=gt, le=le)
