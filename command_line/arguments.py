"""What the arguments of the command line say, as settings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from isacsim.errors import InputError
from isacsim.settings import checked
from labeling.dataset.dataset import Dataset
from labeling.generation.resense import ResenseSettings, own_sensing
from labeling.generation.settings import DatasetStudy

WHERE = "arguments"
SEEDS_WITH_WINDOWS = (1, 1000)
"""The seeds that --windows may use up where no --seeds bound them."""
LINK = "link"


def number_range(text: str, option: str, kind: Callable[[str], Any], example: str) -> tuple[Any, Any]:
    """Both ends of a range A:B, A at most B. Raises InputError where it is none."""
    try:
        low, high = (kind(part) for part in text.split(":"))
    except ValueError:
        raise InputError(f"{option} {text}: is no range; write it like {example}") from None
    if not low <= high:
        raise InputError(f"{option} {text}: is no range, its first end is above its second; write it like {example}")
    return low, high


def channel(snr: str, option: str = "--snr") -> dict[str, Any]:
    """The channel that an SNR names: LO:HI, one value, both dB, or `link`. Raises InputError where it is none.

    option: what the user wrote it behind.
    """
    if snr == LINK:
        return {"kind": "link"}
    if ":" in snr:
        return {"kind": "uniform", "snr_range_db": number_range(snr, option, float, "0:10")}
    try:
        return {"kind": "fixed", "snr_db": float(snr)}
    except ValueError:
        raise InputError(f"{option} {snr}: is no range, value or link; write it like 0:10, 5 or link") from None


def box_of(text: str) -> tuple[float, float, float, float]:
    """West, south, east, north, degrees, from W,S,E,N. Raises InputError where it is no box."""
    try:
        west, south, east, north = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--box {text}: is no box; write west,south,east,north in degrees") from None
    if not (-180 <= west < east <= 180 and -90 <= south < north <= 90):
        raise InputError(f"--box {text}: is no box; write west,south,east,north in degrees, west and south first")
    return west, south, east, north


def dataset_study(scenarios: list[str], windows: int | None, seeds: str | None, snr: str | None) -> DatasetStudy:
    """The study that the arguments of `generate` describe."""
    content: dict[str, Any] = {"scenarios": scenarios, "selection": {"windows": windows}}
    if seeds is not None or windows is not None:
        first, last = number_range(seeds, "--seeds", int, "1:20") if seeds else SEEDS_WITH_WINDOWS
        content["seeds"] = {"first": first, "last": last}
    if snr is not None:
        content["sensing"] = {"channel": channel(snr)}
    return checked(DatasetStudy, content, WHERE)


def resense_settings(
    dataset: Dataset,
    sensor: str,
    snr: str | None = None,
    estimator: str | None = None,
    fusion: str | None = None,
    sites: int | None = None,
    rain_mm_per_h: float | None = None,
    blockage: bool = True,
    radar: str | None = None,
    pattern: str | None = None,
    records: int | None = None,
) -> ResenseSettings:
    """A dataset's own sensing settings, but for what the arguments of `sense` name.

    fusion: `information`, `eq5`, or `eq5-covariance`. radar, pattern: the radar's condition, and what `nlos` loses.
    """
    sensing = own_sensing(dataset).model_dump()
    if snr is not None:
        sensing["channel"] |= channel(snr)
    if not blockage:
        sensing["channel"]["blockage"] = False
    if estimator is not None:
        sensing["estimator"] = estimator
    if fusion is not None:
        method, _, weights = fusion.partition("-")
        sensing["fusion"] |= {"method": method, "eq5_weights": weights or "paper"}
    if sites is not None:
        sensing["view"]["sites"] = sites
    if sensor != "radar" and (radar is not None or pattern is not None):
        raise InputError(f"--{'radar' if radar is not None else 'pattern'} is of the radar: add --sensor radar")
    named = {"condition": radar, "pattern": pattern, "rain_mm_per_h": rain_mm_per_h}
    if rain_mm_per_h is not None:
        sensing["channel"]["rain_mm_per_h"] = rain_mm_per_h
    content = {
        "sensor": sensor,
        "sensing": sensing,
        "radar": {name: value for name, value in named.items() if value is not None},
        "records": records,
    }
    return checked(ResenseSettings, content, WHERE)
