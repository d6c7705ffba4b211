"""Classes and sizes of vehicles, from SUMO's route and type files."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios.sumo_files import with_includes
from isac_cosim.isacsim.scenarios.xml_files import elements

SIZES_M = {
    "passenger": (5.0, 1.8), "private": (5.0, 1.8), "taxi": (5.0, 1.8), "hov": (5.0, 1.8), "evehicle": (5.0, 1.8),
    "emergency": (6.5, 2.16), "delivery": (6.5, 2.16), "army": (5.0, 1.8), "authority": (5.0, 1.8), "vip": (5.0, 1.8),
    "truck": (7.1, 2.4), "trailer": (16.5, 2.55), "bus": (12.0, 2.5), "coach": (14.0, 2.6), "motorcycle": (2.2, 0.9),
    "moped": (2.1, 0.8), "bicycle": (1.6, 0.65), "scooter": (1.2, 0.5), "pedestrian": (0.215, 0.478),
}  # fmt: skip
"""Lengths and widths of vehicles whose type names none, m: the defaults of SUMO 1.28 by vehicle class."""
DEFAULT_KIND = "passenger"
LONGEST_M = 100.0


@dataclass(frozen=True)
class Size:
    """What a vehicle type says of its vehicles. kind: SUMO vehicle class. Lengths in m."""

    kind: str
    length_m: float
    width_m: float


DEFAULT = Size(DEFAULT_KIND, *SIZES_M[DEFAULT_KIND])
"""A vehicle of a type that is not known."""


def vehicle_types(files: Iterable[Path]) -> dict[str, Size]:
    """Return the vehicle types of route and additional files, with those that they include, by id.

    Raises InputError where a file cannot be read or a size is none.
    """
    types: dict[str, Size] = {}
    for file in (part for named in files for part in with_includes(named)):
        for _, name, attributes in elements(file):
            if name == "vType" and "id" in attributes:
                kind = attributes.get("vClass", DEFAULT_KIND)
                length, width = SIZES_M.get(kind, SIZES_M[DEFAULT_KIND])
                types[attributes["id"]] = Size(
                    kind,
                    _metres(attributes.get("length"), length, attributes["id"], file),
                    _metres(attributes.get("width"), width, attributes["id"], file),
                )
    return types


def _metres(text: str | None, default: float, name: str, file: Path) -> float:
    if text is None:
        return default
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value <= LONGEST_M:
        raise InputError(
            f"{file}: vehicle type {name} is {text} m long or wide; give more than 0 and at most {LONGEST_M:g} m"
        )
    return value


def size_of(types: dict[str, Size], name: str) -> Size | None:
    """Return the size of a vehicle's type; None where it is not known.

    A vehicle that was changed by itself has a type of its own, named like its former one with `@` and its id.
    """
    return types.get(name) or types.get(name.partition("@")[0])
