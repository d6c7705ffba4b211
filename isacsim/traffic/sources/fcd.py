"""The motion source `fcd`: floating car data (FCD) that SUMO has written.

Format: SUMO's documentation, Simulation/Output/FCDOutput, version 1.28, as XML, CSV or Parquet, each gzipped or not.
Positions are those of the front bumper's centre. CSV has `;` between columns, and a row without a vehicle for a step
without vehicles. Values of XML and CSV are rounded to `--precision`, those of Parquet are not. Persons are left out.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np
import pyarrow as pa
from pydantic import Field

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError
from isac_cosim.base.stored.tables import open_parquet
from isac_cosim.isacsim.scenarios import scenario
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.scenarios.sumo_files import with_includes
from isac_cosim.isacsim.scenarios.xml_files import Element, elements
from isac_cosim.isacsim.traffic.sources.recorded_files import (
    FileSettings,
    FileSource,
    Opened,
    check_observed,
    scenario_name,
    sites_for,
)
from isac_cosim.isacsim.traffic.trajectory_files.checks import MOST_OFF_ROAD
from isac_cosim.isacsim.traffic.trajectory_files.conditioning import noise_of_rounding, rounding_of
from isac_cosim.isacsim.traffic.trajectory_files.lane_places import LanePlaces
from isac_cosim.isacsim.traffic.trajectory_files.observed import FileStates, FileVehicle, Int32Array, Rows, observed
from isac_cosim.isacsim.traffic.trajectory_files.roads.planes import net_offset, on_network, projected
from isac_cosim.isacsim.traffic.trajectory_files.tables import (
    PARQUET,
    Codes,
    Columns,
    batches,
    content_head,
    header_of,
    is_gzipped,
    reading,
)
from isac_cosim.isacsim.traffic.trajectory_files.vehicle_types import DEFAULT, size_of, vehicle_types

KINDS = (".fcd.xml", ".fcd.csv", ".fcd.parquet", ".xml", ".csv", ".parquet")
ENDINGS = tuple(f"{kind}{zipped}" for zipped in (".gz", "") for kind in KINDS)
"""What the names of files end in; the longer endings first."""
COLUMNS = {
    "timestep_time": pa.float64(),
    "vehicle_id": pa.string(),
    "vehicle_x": pa.float64(),
    "vehicle_y": pa.float64(),
    "vehicle_lane": pa.string(),
    "vehicle_type": pa.string(),
    "vehicle_speed": pa.float64(),
}
NEEDED = ("timestep_time", "vehicle_id", "vehicle_x", "vehicle_y", "vehicle_lane")
SECONDS = 1e9
"""Times, coordinates and speeds beyond this, s, m or m/s, are none."""


class FcdSettings(FileSettings):
    """Where the road and the vehicle types of FCD are."""

    network: str | None = Field(
        None, min_length=1, description="the scenario or network that was driven on; a study and --network name it"
    )
    types: tuple[str, ...] = Field(
        (), description="route or additional files with the vehicle types; by default, those of the scenario"
    )


@dataclass
class FcdColumns:
    """The states of a file as they are read, with the numbers of its vehicles, lanes and types."""

    vehicles: Codes
    lanes: Codes
    types: Codes
    vehicle: Int32Array
    lane: Int32Array
    kind: Int32Array
    number: Int32Array
    time: Array
    x: Array
    y: Array
    speed: Array


@dataclass(frozen=True)
class FcdSource(FileSource):
    """Traffic that SUMO has simulated elsewhere, as it wrote it."""

    fcd: FcdSettings
    sections: ClassVar = {"fcd": FcdSettings}

    @classmethod
    def recognises(cls, where: Path) -> bool:
        begin = content_head(where)
        if begin.startswith(PARQUET):
            if is_gzipped(where):
                return where.name.endswith(".fcd.parquet.gz")
            with reading(where), open_parquet(where) as table:
                return {*NEEDED} <= {*table.schema_arrow.names}
        return b"<fcd-export" in begin if _is_xml(where) else {*NEEDED} <= {*header_of(where, ";")}

    def open(self, where: Path) -> Opened:
        if where.is_dir():
            raise InputError(f"{where}: is a folder; give the file that SUMO wrote with --fcd-output")
        if self.fcd.network is None:
            raise InputError(f"{where}: FCD does not say where lanes are; name the network by --network SCENARIO")
        road = scenario.load_without_sites(self.fcd.network)
        type_files = [Path(name) for name in self.fcd.types] or [*road.demand, *road.additional]
        states, unknown, noise_m = _states(where, road, type_files)
        if self.fcd.noise_m is not None:
            noise_m = self.fcd.noise_m
        remarks = check_observed(self.fcd, states, LanePlaces(road.lanes), where)
        if unknown:
            remarks.append(
                f"no file names the types {', '.join(unknown[:3])}{', ...' if len(unknown) > 3 else ''}: their "
                f"vehicles are taken for cars of {DEFAULT.length_m:g} m x {DEFAULT.width_m:g} m; "
                "[dataset.fcd] types names files with types"
            )
        sites = sites_for(self.fcd, road.sites, road.lanes, states, road.origin, road.lefthand)
        place = Scenario(
            scenario_name(where, ENDINGS), road.network, (where,), (), road.origin, road.lanes, sites,
            lefthand=road.lefthand, elevation=road.elevation,
        )  # fmt: skip
        files = (where, road.network, *(part for named in type_files for part in with_includes(named)))
        if self.fcd.sites is not None:
            files = (*files, Path(self.fcd.sites))
        elif road.sites:
            files = (*files, *road.additional)
        return Opened(place, states, tuple(dict.fromkeys(files)), noise_m, tuple(remarks))


def _states(where: Path, road: Scenario, type_files: list[Path]) -> tuple[FileStates, list[str], float]:
    """Return the states of a file, the types that no file names, and the noise of its rounding, m.

    What is done with is given up at once: the columns of a long file fill most of the memory.
    """
    read = _xml(where) if _is_xml(where) else _table(where)
    rounded = rounding_of(read.x, read.y)
    read.x, read.y, unit_m = _in_plane(read, road, where)
    vehicles, unknown = _vehicles(read, type_files)
    lane = _lane_numbers(read, road, where)
    speed = None if np.isnan(read.speed).any() else read.speed.astype(np.float32)
    tick = np.rint(read.time * 1e3).astype(np.int64)
    rows = Rows(read.vehicle, tick, read.x, read.y, lane, speed, read.number)
    del read, lane, speed, tick
    _check_order(rows, where)
    return observed(rows, vehicles, where), unknown, noise_of_rounding(unit_m * rounded)


def _is_xml(where: Path) -> bool:
    return content_head(where, 64).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<")


def _xml(where: Path) -> FcdColumns:
    """Read FCD as XML. Raises InputError where it cannot be read."""
    vehicles, lanes, types = Codes(), Codes(), Codes()
    numbers = {name: array("i") for name in ("vehicle", "lane", "kind", "number")}
    values = {name: array("d") for name in ("time", "x", "y", "speed")}
    time, count, root = float("nan"), 0, None
    for element in elements(where):
        if root is None:
            root = element.name
        if element.name == "timestep":
            time = _number(element, "time", where, count)
        elif element.name == "vehicle":
            count += 1
            attributes = element.attributes
            if "id" not in attributes:
                raise InputError(f"{where}: state {count} has no vehicle id; write FCD with --fcd-output")
            if "lane" not in attributes:
                raise InputError(f"{where}: state {count} has no lane; write FCD with x, y and lane")
            numbers["vehicle"].append(vehicles.number(attributes["id"]))
            numbers["lane"].append(lanes.number(attributes["lane"]))
            numbers["kind"].append(types.number(attributes.get("type", "")))
            numbers["number"].append(count)
            values["time"].append(time)
            values["x"].append(_number(element, "x", where, count))
            values["y"].append(_number(element, "y", where, count))
            values["speed"].append(_number(element, "speed", where, count) if "speed" in attributes else float("nan"))
    if root != "fcd-export":
        raise InputError(
            f"{where}: is no FCD: its first element is {root}, not fcd-export; give what --fcd-output wrote"
        )
    integers = {name: np.frombuffer(held, np.int32) for name, held in numbers.items()}
    floats = {name: np.frombuffer(held, float) for name, held in values.items()}
    return _checked(_columns(vehicles, lanes, types, integers, floats), where)


def _number(element: Element, name: str, where: Path, count: int) -> float:
    try:
        return float(element.attributes[name])
    except (KeyError, ValueError):
        raise InputError(
            f"{where}: state {count}: {name} is no number ({element.attributes.get(name, 'it is missing'):.40}); fix it"
        ) from None


def _columns(
    vehicles: Codes, lanes: Codes, types: Codes, integers: dict[str, Int32Array], floats: dict[str, Array]
) -> FcdColumns:
    whose, lane, kind, number = (integers[name] for name in ("vehicle", "lane", "kind", "number"))
    time, x, y, speed = (floats[name] for name in ("time", "x", "y", "speed"))
    return FcdColumns(vehicles, lanes, types, whose, lane, kind, number, time, x, y, speed)


VALUES = {"time": "timestep_time", "x": "vehicle_x", "y": "vehicle_y", "speed": "vehicle_speed"}


def _table(where: Path) -> FcdColumns:
    """Read FCD as CSV or Parquet. Raises InputError where it cannot be read."""
    vehicles, lanes, types = Codes(), Codes(), Codes()
    read = Columns()
    # Lines of a CSV file are counted with its header, the rows of a Parquet file from 1.
    before = 1 if content_head(where, 4).startswith(PARQUET) else 2
    for batch in batches(where, COLUMNS, NEEDED, ";"):
        kept = _rows_with_vehicle(batch)
        rows = batch.filter(kept)
        read.add("number", (np.flatnonzero(np.asarray(kept)) + before).astype(np.int32))
        before += len(batch)
        read.add("vehicle", vehicles.of(rows["vehicle_id"]))
        read.add("lane", lanes.of(rows["vehicle_lane"]))
        has_type = "vehicle_type" in rows.schema.names
        read.add("kind", types.of(rows["vehicle_type"]) if has_type else np.full(len(rows), -1, np.int32))
        for name, column in VALUES.items():
            has = column in rows.schema.names
            read.add(name, np.asarray(rows[column], float) if has else np.full(len(rows), np.nan))
    integers = {name: read.take(name, np.int32) for name in ("vehicle", "lane", "kind", "number")}
    floats = {name: read.take(name) for name in VALUES}
    return _checked(_columns(vehicles, lanes, types, integers, floats), where)


def _rows_with_vehicle(batch: pa.RecordBatch) -> pa.Array:
    """Return which rows have a vehicle: others stand for steps without vehicles, or for persons."""
    names = batch["vehicle_id"]
    return pa.compute.and_(names.is_valid(), pa.compute.not_equal(names.fill_null(""), ""))


def _checked(read: FcdColumns, where: Path) -> FcdColumns:
    """Return what was read. Raises InputError where it holds no vehicle, or a value that is none."""
    if not len(read.time):
        raise InputError(f"{where}: holds no vehicle; give the file that SUMO wrote with --fcd-output")
    for name, values in (("time", read.time), ("x", read.x), ("y", read.y), ("speed", read.speed)):
        wrong = ~((values < SECONDS) & (values > -SECONDS))
        if name == "speed":  # which may be missing
            wrong &= ~np.isnan(values)
        if wrong.any():
            row = int(np.argmax(wrong))
            raise InputError(f"{where}: row {read.number[row]}: {name} is {values[row]:g}; fix it")
    if (fractions := np.flatnonzero(np.abs(read.time * 1e3 - np.rint(read.time * 1e3)) > 1e-3)).size:
        raise InputError(
            f"{where}: row {read.number[fractions[0]]}: the time {read.time[fractions[0]]!r} s is no whole number of "
            "milliseconds, as SUMO's are; fix it"
        )
    return read


def _check_order(rows: Rows, where: Path) -> None:
    """Raise InputError where time runs backwards."""
    if (back := np.flatnonzero(np.diff(rows.tick) < 0)).size:
        at = int(back[0]) + 1
        raise InputError(
            f"{where}: row {rows.number[at]}: time runs backwards, from {rows.time_s(at - 1):g} to "
            f"{rows.time_s(at):g} s; sort the states by time"
        )


def _lane_numbers(read: FcdColumns, road: Scenario, where: Path) -> Int32Array:
    """Return the number of each state's lane, -1 where it is on none.

    Raises InputError for a lane of another network, and where too many states are on none.
    """
    known = {lane.id: k for k, lane in enumerate(road.lanes)}
    names = read.lanes.names
    of_name = np.array([known.get(name, -2 if name else -1) for name in names] + [-1], np.int32)
    lane = of_name[read.lane]
    if (lost := np.flatnonzero(lane == -2)).size:
        name = names[int(read.lane[lost[0]])]
        raise InputError(
            f"{where}: row {read.number[lost[0]]}: lane {name} is not in {road.network}; name the network that was "
            "driven on"
        )
    if (share := float((lane < 0).mean())) > MOST_OFF_ROAD:
        raise InputError(
            f"{where}: {share:.0%} of its states name no lane, such as row {read.number[int(np.argmax(lane < 0))]}; "
            "write FCD with x, y and lane"
        )
    return lane


def _vehicles(read: FcdColumns, files: list[Path]) -> tuple[list[FileVehicle], list[str]]:
    """Return the vehicles, by number, and the types that no file names."""
    sizes = vehicle_types(files)
    _, first = np.unique(read.vehicle, return_index=True)
    names, unknown, vehicles = (*read.types.names, ""), dict[str, None](), []
    for vehicle, row in zip(read.vehicles.names, first.tolist(), strict=False):
        kind = names[int(read.kind[row])]
        size = size_of(sizes, kind)
        if size is None:
            unknown[kind or "(none)"] = None
        size = size or DEFAULT
        vehicles.append(FileVehicle(vehicle, size.kind, size.length_m, size.width_m))
    return vehicles, list(unknown)


LONGEST_DEG, WIDEST_DEG = 180.0, 90.0


def _in_plane(read: FcdColumns, road: Scenario, where: Path) -> tuple[Array, Array, float]:
    """Return positions in the scenario's plane, m, and how long one of the file's units is at most, m.

    SUMO's own coordinates, unshifted ones (`--fcd-output.utm`), and longitudes and latitudes (`--fcd-output.geo`) are
    told apart by the bounds of the network: only XML names the option. Raises InputError for positions elsewhere, and
    for longitudes and latitudes on a network without a projection, or beyond their bounds.
    """
    plane, x, y = partial(on_network, road=road), read.x, read.y
    beyond = (np.abs(x) > LONGEST_DEG) | (np.abs(y) > WIDEST_DEG)
    degrees = bool(beyond.mean() < MOST_OFF_ROAD)
    # Degrees come first: as metres, they may lie on a network that has its corner at 0, 0.
    try:
        placed = plane(*projected(x, y, road.network), shifts=[(0.0, 0.0)]) if degrees else None
    except InputError:
        if plane(x, y, shifts=[(0.0, 0.0)]) is None:
            raise
        placed = None
    if placed is not None:
        if beyond.any():
            row = int(np.argmax(beyond))
            raise InputError(
                f"{where}: row {read.number[row]}: {x[row]:g}, {y[row]:g} is no longitude and latitude, and the other "
                "positions are; fix it"
            )
        return *placed, float(np.radians(1.0) * 6_371_000.0)  # of the Earth's radius
    placed = plane(x, y, shifts=[(0.0, 0.0), net_offset(road.network)])
    if placed is not None:
        return *placed, 1.0
    raise InputError(
        f"{where}: most of its positions, such as {x[0]:g}, {y[0]:g}, are outside {road.network}; name the network "
        "that was driven on"
    )
