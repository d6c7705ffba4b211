"""What is wrong with a file of trajectories although every number in it can be read: units, places, lengths of time."""

from __future__ import annotations

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.traffic.trajectory_files.observed import FileStates

CAR_LENGTHS_M = (3.0, 8.0)
"""The median car of a file is as long as this, m, or its lengths have another unit."""
CAR_KINDS = frozenset({"passenger", "private", "taxi"})
SPEED_FACTOR = 2.0
"""Speeds that differ from those of the positions by this factor have another unit."""
MOST_UNLIKE = 1.1
"""Speeds that differ by more than this factor are worth a word: a recording at 30 Hz that says 25 Hz, for example."""
MOST_SHOWING = 2_000_000
"""At most so many states show the unit of speeds."""
MOVING_MPS = 1.0
"""Slower vehicles do not show the unit of speeds, m/s."""
MOST_OFF_ROAD = 0.1
"""A larger share of positions off their lanes shows that the road is another one."""
OFF_ROAD_M = 1.0
"""A position this far beyond the edge of its lane is off it, m."""


def check_lengths(observed: FileStates, where: object) -> None:
    """Raise InputError where the median car is longer or shorter than cars are."""
    lengths = [vehicle.length_m for vehicle in observed.vehicles if vehicle.kind in CAR_KINDS]
    if not lengths:
        return
    median = float(np.median(lengths))
    low, high = CAR_LENGTHS_M
    if not low <= median <= high:
        raise InputError(
            f"{where}: its median car is {median:.2f} m long, and cars are {low:g} to {high:g} m long; give "
            "lengths in the unit of the format"
        )


def speeds_of_positions(observed: FileStates) -> Array:
    """Return the speed between a state and the next one, m/s, of the first `MOST_SHOWING` states, (n,).

    NaN after a vehicle's last state.
    """
    step, x, y = (column[:MOST_SHOWING] for column in (observed.step, observed.x, observed.y))
    speed = np.full(len(step), np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        speed[:-1] = np.hypot(np.diff(x), np.diff(y)) / (np.diff(step) * observed.period_s)
    last = observed.starts[1:] - 1
    speed[last[last < len(speed)]] = np.nan
    return speed


def check_speeds(observed: FileStates, where: object) -> list[str]:
    """Return how far the file's speeds are from those of its positions, a line if it has any.

    Raises InputError where they differ by a factor.
    """
    if observed.speed is None:
        return []
    between = speeds_of_positions(observed)
    stated = observed.speed[:MOST_SHOWING].astype(float)
    moving = (between > MOVING_MPS) & np.isfinite(stated)
    if not moving.any():
        return []
    factor = float(np.median(stated[moving] / between[moving]))
    if not 1.0 / SPEED_FACTOR <= factor <= SPEED_FACTOR:
        raise InputError(
            f"{where}: its speeds are {factor:.2f} times those of its positions; give both in the units of the format"
        )
    difference = float(np.median(np.abs(stated[moving] - between[moving])))
    told = f"its speeds differ from those of its positions, which are used, by {difference:.2g} m/s in the median"
    if max(factor, 1.0 / factor) > MOST_UNLIKE:
        told += f", and are {factor:.2f} times these: see whether rate and units are right"
    return [told]


def check_durations(observed: FileStates, least_s: float, where: object) -> None:
    """Raise InputError where no vehicle is on the road long enough."""
    lasts = (observed.step[observed.starts[1:] - 1] - observed.step[observed.starts[:-1]]) * observed.period_s
    longest = int(lasts.argmax())
    if lasts[longest] < least_s:
        raise InputError(
            f"{where}: no vehicle is seen for {least_s:g} s; {observed.vehicles[longest].id} is seen longest, for "
            f"{lasts[longest]:g} s: give longer tracks, or ask for shorter records"
        )
