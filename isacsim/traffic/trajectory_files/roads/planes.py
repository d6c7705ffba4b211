"""From the coordinates of a file to the plane of a road network: which of several shifts puts positions on it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray
from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.scenarios.xml_files import elements

BESIDE_M = 500.0
"""Vehicles may be so far outside the bounds of their network, m."""
SAMPLED = 10_000
"""So many positions show which shift is right."""
PROJECTIONS = ("aea", "cass", "laea", "lcc", "merc", "omerc", "poly", "somerc", "stere", "sterea", "tmerc", "utm")
PARAMETERS = re.compile(
    r"\+(proj=[a-z]+|(zone|lat_0|lat_1|lat_2|lat_ts|lon_0|lonc|alpha|gamma|k|k_0|x_0|y_0|a|b|rf)=[-+.\deE]+"
    r"|(ellps|datum|units|type)=[A-Za-z0-9]+|towgs84=[-+.,\deE]+|south|no_defs|wktext)"
)
"""What a network may say of its projection; PROJ reads files by other parameters."""


def on_network(
    x: Array, y: Array, road: Scenario, shifts: Sequence[tuple[float, float]]
) -> tuple[Array, Array] | None:  # fmt: skip
    """Return positions in the scenario's plane, m: with the first shift that puts most of them on its network, if any.

    shifts: from the coordinates of the file to SUMO's, m.
    """
    points = np.concatenate([lane.shape for lane in road.lanes])
    low, high = points.min(axis=0) - BESIDE_M, points.max(axis=0) + BESIDE_M

    def inside(east: Array, north: Array) -> BoolArray:
        return np.asarray((east >= low[0]) & (east <= high[0]) & (north >= low[1]) & (north <= high[1]))

    sampled = slice(None, None, max(1, len(x) // SAMPLED))
    for shift in shifts:
        east, north = shift[0] - road.origin[0], shift[1] - road.origin[1]
        if inside(x[sampled] + east, y[sampled] + north).mean() >= 0.5:
            return x + east, y + north
    return None


def net_offset(network: Path) -> tuple[float, float]:
    """Return what netconvert added to the projected coordinates of a network, m."""
    try:
        east, north = (float(part) for part in _location(network)["netOffset"].split(","))
    except (KeyError, ValueError):
        return 0.0, 0.0
    return east, north


def projected(longitude: Array, latitude: Array, network: Path) -> tuple[Array, Array]:
    """Return SUMO's coordinates of longitudes and latitudes, degrees, by the projection that a network names, m.

    Raises InputError where it names none, or one that PROJ would read from a file, and without pyproj.
    """
    parameters = _location(network).get("projParameter", "!").strip()
    if parameters in ("", "!"):
        raise InputError(f"{network}: names no projection, so longitudes and latitudes have no place in it")
    words = parameters.split()
    named = [word.removeprefix("+proj=") for word in words if word.startswith("+proj=")]
    if len(named) != 1 or named[0] not in PROJECTIONS or not all(map(PARAMETERS.fullmatch, words)):
        raise InputError(f"{network}: location: projParameter: {parameters:.60}: is no projection that is read here")
    east, north = _by_proj(parameters, longitude, latitude, f"{network}: location: projParameter")
    shift = net_offset(network)
    return east + shift[0], north + shift[1]


def in_utm(longitude: Array, latitude: Array) -> tuple[Array, Array]:
    """Return coordinates in UTM of longitudes and latitudes, degrees, in the zone that most of them lie in, m.

    Raises InputError without pyproj.
    """
    zone = min(int((float(np.median(longitude)) + 180.0) // 6.0) + 1, 60)
    south = " +south" if float(np.median(latitude)) < 0.0 else ""
    return _by_proj(f"+proj=utm +zone={zone}{south} +ellps=WGS84", longitude, latitude, "UTM")


def _by_proj(parameters: str, longitude: Array, latitude: Array, where: str) -> tuple[Array, Array]:
    try:
        from pyproj import Proj
        from pyproj.exceptions import ProjError
    except ImportError:
        raise InputError("longitudes and latitudes need pyproj: run pip install '.[geo]' in a checkout") from None
    try:
        east, north = Proj(parameters)(longitude, latitude)
    except ProjError as error:
        raise InputError(f"{where}: {error}") from None
    return np.asarray(east), np.asarray(north)


def _location(network: Path) -> dict[str, str]:
    """Return what a network says of where it lies."""
    return next((dict(element.attributes) for element in elements(network) if element.name == "location"), {})
