"""The tables of a recording in levelXdata's format, with their units and conventions as they are in the files.

A recording is three CSV files: `NN_tracks.csv` with a row for each vehicle and frame, `NN_tracksMeta.csv` with one for
each vehicle, `NN_recordingMeta.csv` with one in all. Formats: of highD (Krajewski et al., ITSC 2018; version 1.0), and
of inD, rounD, exiD and uniD (Bock et al., IV 2020; Moers et al., IV 2022), as levelxdata.com describes them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from isac_cosim.base.arrays import Array, BoolArray, Float32Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.traffic.trajectory_files.observed import FileVehicle, Int32Array
from isac_cosim.isacsim.traffic.trajectory_files.tables import Columns, batches, header_of
from isac_cosim.isacsim.traffic.trajectory_files.vehicle_types import LONGEST_M, SIZES_M

TRACKS, TRACKS_META, RECORDING_META = "_tracks.csv", "_tracksMeta.csv", "_recordingMeta.csv"
KINDS = {
    "car": "passenger", "van": "delivery", "truck": "truck", "truck_bus": "truck", "bus": "bus", "trailer": "trailer",
    "motorcycle": "motorcycle", "bicycle": "bicycle",
}  # fmt: skip
"""SUMO vehicle classes of the classes of road users."""
PERSONS = frozenset({"pedestrian", "animal"})
"""Road users that are no vehicles: they are left out."""
UNSIZED = frozenset({"motorcycle", "bicycle"})
"""Kinds whose sizes the files may give as 0."""
SPEEDS = ("xVelocity", "yVelocity")
FRAMES, LAST_FRAME = "numFrames", "finalFrame"
MOST = 1e7
"""Numbers beyond this are no coordinates in metres, and no frames."""
MOST_OTHER_M = 0.5
"""Sizes that differ by more are not those of one vehicle, m."""
RATES_HZ = (1.0, 1000.0)


@dataclass
class LevelxRows:
    """The states of a recording that belong to vehicles, shape (n,) each, in the order of the file.

    vehicle: number in `vehicles`. x, y: as in the file, m. length, width: of the box, m; None for the width of turned
    ones. angle: as in the file, degrees; None where boxes are axis-parallel. speed: magnitude of the file's velocity,
    m/s; None if it names none. number: the line of the file. direction: 1 or 2, as the file numbers directions, of each
    vehicle, shape (v,); None without any.
    """

    vehicles: list[FileVehicle]
    vehicle: Int32Array
    frame: IntArray
    x: Array
    y: Array
    length: Array
    width: Array | None
    angle: Array | None
    speed: Float32Array | None
    number: Int32Array
    direction: IntArray | None

    def leave_out(self, which: BoolArray) -> None:
        """Leave out some states, column by column: a long recording fills the memory once, not twice."""
        for column in fields(self):
            values = getattr(self, column.name)
            if isinstance(values, np.ndarray) and column.name != "direction":
                setattr(self, column.name, values[~which])


@dataclass(frozen=True)
class LevelxFiles:
    """The files of a recording."""

    tracks: Path
    tracks_meta: Path
    recording_meta: Path

    @property
    def has_corners(self) -> bool:
        """Whether positions are corners of axis-parallel boxes, as in highD, and not centres of turned ones."""
        return "xCenter" not in header_of(self.tracks)


def files_of(where: Path) -> LevelxFiles:
    """Return the files of the recording that the user named: its tracks, or a folder that holds it alone.

    Raises InputError where there are none or several, or one is missing.
    """
    if where.is_dir():
        found = sorted(where.glob(f"*{TRACKS}"))
        if len(found) != 1:
            fault = f"has {len(found)} recordings" if found else "has no recording"
            example = found[0] if found else where / f"01{TRACKS}"
            raise InputError(f"{where}: {fault}; name the tracks of each that you mean, such as {example}")
        where = found[0]
    if not where.name.endswith(TRACKS):
        raise InputError(f"{where}: is no recording of levelX; name its tracks, a file like 01{TRACKS}")
    stem = where.name[: -len(TRACKS)]
    beside = [where.with_name(f"{stem}{ending}") for ending in (TRACKS_META, RECORDING_META)]
    for file in beside:
        if not file.is_file():
            raise InputError(f"{file}: is missing, and {where.name} cannot be read without it; put it beside that file")
    return LevelxFiles(where, *beside)


def read_recording_meta(file: Path, columns: Mapping[str, pa.DataType]) -> tuple[dict[str, Any], float]:
    """Return values of a recording's meta file, None where it lacks a column, and the frame rate, Hz.

    Raises InputError where the file cannot be read, or names no rate.
    """
    read = list(batches(file, {**columns, "frameRate": pa.float64()}, ("frameRate",)))
    rows = [row for batch in read for row in batch.to_pylist()]
    if len(rows) != 1:
        raise InputError(f"{file}: has {len(rows)} rows and needs one, that of its recording; fetch it again")
    values = {name: rows[0].get(name) for name in columns}
    rate = rows[0]["frameRate"]
    low, high = RATES_HZ
    if rate is None or not low <= rate <= high:
        raise InputError(f"{file}: row 2: frameRate is {rate}; give frames per second, {low:g} to {high:g}")
    return values, float(rate)


def read_tracks(files: LevelxFiles) -> tuple[LevelxRows, list[str]]:
    """Return the states of the vehicles of a recording, and what is to be said of them, a line each.

    Raises InputError where a file cannot be read, lacks a column, or holds a value that cannot be.
    """
    corners = files.has_corners
    ids, vehicles, direction, said, remarks = _read_vehicles(files.tracks_meta, corners)
    identity, x, y, length = ("id", "x", "y", "width") if corners else ("trackId", "xCenter", "yCenter", "length")
    across = "height" if corners else "width"
    whole, needed = ("frame", identity), [x, y, length, across, *([] if corners else ["heading"])]
    columns = {
        **dict.fromkeys(whole, pa.int64()),
        **dict.fromkeys((*needed, *SPEEDS), pa.float64()),
    }
    read = Columns()
    line, latest, sizes = 2, np.full(len(vehicles), -np.inf), _Sizes(vehicles)
    for batch in batches(files.tracks, columns, (*whole, *needed)):
        values = {name: _numbers(batch, name, files.tracks, line) for name in (*whole, *needed)}
        at = _places(ids, len(vehicles), values.pop(identity).astype(np.int64), files, line)
        kept = np.flatnonzero(at >= 0)
        held: dict[str, np.ndarray[Any, Any]] = {"vehicle": at[kept], "number": (kept + line).astype(np.int32)}
        sizes.add(at[kept], values[length][kept], values[across][kept])
        if not corners:
            del values[across]
        held |= {name: column[kept] for name, column in values.items()}
        _check_order(held, latest, vehicles, files.tracks)
        held["frame"] = held["frame"].astype(np.int64)
        if set(SPEEDS) <= {*batch.schema.names}:
            velocity = (_numbers(batch, name, files.tracks, line, or_none=True)[kept] for name in SPEEDS)
            held["speed"] = np.hypot(*velocity).astype(np.float32)
        for name, column in held.items():
            read.add(name, column)
        line += len(batch)
    if line == 2:
        raise InputError(f"{files.tracks}: holds no state of a vehicle; fetch it again")
    sizes.check(files)
    remarks += _check_whole(sizes.rows, latest, said, vehicles, files)
    vehicle = read.take("vehicle")
    if not len(vehicle):
        raise InputError(f"{files.tracks}: holds persons only, and no vehicle; name another recording")
    width, angle, speed = (read.take(name) if name in read else None for name in ("height", "heading", "speed"))
    rows = LevelxRows(vehicle=vehicle, vehicles=vehicles, frame=read.take("frame"), x=read.take(x), y=read.take(y),
                      length=read.take(length), width=width, angle=angle, speed=speed, number=read.take("number"),
                      direction=direction)  # fmt: skip
    return rows, remarks


def _read_vehicles(
    file: Path, corners: bool
) -> tuple[IntArray, list[FileVehicle], IntArray | None, dict[str, Array], list[str]]:  # fmt: skip
    """Return the ids of the road users of a file; the vehicles among them, their directions, and what it says of their
    frames, by column, for those that it has; and remarks.

    The ids are those of the vehicles, in their order, and then those of persons.
    """
    identity, length, width = ("id", "width", "height") if corners else ("trackId", "length", "width")
    whole = (identity, "drivingDirection") if corners else (identity,)
    needed = (*whole, length, width, "class")
    columns = {**dict.fromkeys(whole, pa.int64()), length: pa.float64(), width: pa.float64()}
    counted = [name for name in (FRAMES, LAST_FRAME) if name in header_of(file)]
    columns |= dict.fromkeys(counted, pa.float64())
    values = _columns(file, columns, (*whole, length, width, *counted))
    classes = [named for batch in batches(file, {"class": pa.string()}, needed) for named in batch["class"].to_pylist()]
    ids = values[identity].astype(np.int64)
    if not len(ids):
        raise InputError(f"{file}: names no vehicle; fetch it again")
    _, first, counts = np.unique(ids, return_index=True, return_counts=True)
    if (counts > 1).any():
        raise InputError(f"{file}: vehicle {ids[first[counts > 1][0]]} has two rows; leave one of them out")
    vehicles, rows, persons, unknown = list[FileVehicle](), list[int](), list[int](), dict[str, None]()
    for row, named in enumerate(classes):
        kind = (named or "").strip().lower()
        if kind in PERSONS:
            persons.append(row)
            continue
        if kind not in KINDS:
            unknown[named or "(none)"] = None
        vehicles.append(_vehicle(int(ids[row]), KINDS.get(kind, "passenger"), float(values[length][row]),
                                 float(values[width][row]), f"{file}: row {row + 2}"))  # fmt: skip
        rows.append(row)
    direction = values["drivingDirection"].astype(np.int64)[rows] if corners else None
    if direction is not None and (wrong := np.flatnonzero((direction != 1) & (direction != 2))).size:
        raise InputError(
            f"{file}: row {rows[wrong[0]] + 2}: drivingDirection is {direction[wrong[0]]}; give 1 (leftward) or 2 "
            "(rightward)"
        )
    remarks = []
    if unknown:
        remarks.append(f"the classes {', '.join(list(unknown)[:3])} are not known: their vehicles are taken for cars")
    if persons:
        remarks.append(f"{len(persons)} persons are left out")
    said = {name: values[name][rows] for name in counted}
    return np.concatenate([ids[rows], ids[persons]]), vehicles, direction, said, remarks


def _vehicle(number: int, kind: str, length_m: float, width_m: float, where: str) -> FileVehicle:
    if kind in UNSIZED and not (length_m > 0.0 and width_m > 0.0):
        length_m, width_m = SIZES_M[kind]
    if not (0.0 < length_m <= LONGEST_M and 0.0 < width_m <= LONGEST_M):
        raise InputError(
            f"{where}: vehicle {number} is {length_m:g} m x {width_m:g} m; give more than 0 and at most {LONGEST_M:g} m"
        )
    return FileVehicle(str(number), kind, length_m, width_m)


def _places(ids: IntArray, vehicles: int, named: IntArray, files: LevelxFiles, line: int) -> Int32Array:
    """Return the number of each row's vehicle, -1 for persons. Raises InputError for one that is not in the meta file.

    ids: of so many vehicles and of persons, at least one in all. named: by the rows, of which the first is at a line.
    """
    order = np.argsort(ids, kind="stable")
    at = order[np.minimum(np.searchsorted(ids[order], named), len(ids) - 1)]
    if (lost := np.flatnonzero(ids[at] != named)).size:
        raise InputError(
            f"{files.tracks}: row {lost[0] + line}: vehicle {named[lost[0]]} is not in {files.tracks_meta.name}; fetch "
            "both files again"
        )
    return np.where(at < vehicles, at, -1).astype(np.int32)


class _Sizes:
    """How often the tracks say of a vehicle that it is as large as the meta file says, and how often not."""

    def __init__(self, vehicles: Sequence[FileVehicle]) -> None:
        self.vehicles = vehicles
        self.named = np.array([(vehicle.length_m, vehicle.width_m) for vehicle in vehicles]).reshape(-1, 2)
        self.named[[vehicle.kind in UNSIZED for vehicle in vehicles]] = np.nan
        self.rows, self.others = (np.zeros(len(vehicles), np.int64) for _ in range(2))
        self.other = np.zeros((len(vehicles), 2))

    def add(self, vehicle: Int32Array, length: Array, width: Array) -> None:
        """Count some rows."""
        said = np.column_stack([length, width])
        other = (np.abs(said - self.named[vehicle]) > MOST_OTHER_M).any(axis=1)
        self.rows += np.bincount(vehicle, minlength=len(self.rows))
        self.others += np.bincount(vehicle[other], minlength=len(self.rows))
        self.other[vehicle[other]] = said[other]

    def check(self, files: LevelxFiles) -> None:
        """Raise InputError where most rows of a vehicle have another size."""
        if (wrong := np.flatnonzero(2 * self.others > self.rows)).size:
            vehicle, said = self.vehicles[wrong[0]], self.other[wrong[0]]
            raise InputError(
                f"{files.tracks_meta}: vehicle {vehicle.id} is {vehicle.length_m:g} m x {vehicle.width_m:g} m, and "
                f"{said[0]:g} m x {said[1]:g} m in {files.tracks.name}; fetch both files again"
            )


def _check_whole(
    rows: IntArray, latest: Array, said: Mapping[str, Array], vehicles: Sequence[FileVehicle], files: LevelxFiles
) -> list[str]:
    """Return what is to be said where states are missing in between, a line if any.

    rows, latest: number of states and last frame of each vehicle, shape (v,). said: what the meta file says of these.
    Raises InputError where the last states of a vehicle are missing, or all, as where a file ends early.
    """
    if (cut := (rows == 0) | (latest < said.get(LAST_FRAME, -np.inf))).any():
        one = int(np.argmax(cut))
        seen = f"ends at frame {latest[one]:.0f}" if rows[one] else "has no state"
        raise InputError(
            f"{files.tracks}: vehicle {vehicles[one].id} {seen}, and {int(cut.sum())} of {len(rows)} vehicles end "
            f"earlier than {files.tracks_meta.name} says: it is cut off, or another recording; fetch both again"
        )
    if not (missing := rows < said.get(FRAMES, 1.0)).any():
        return []
    return [
        f"{int(missing.sum())} of {len(rows)} vehicles, such as {vehicles[int(np.argmax(missing))].id}, have fewer "
        f"states than {files.tracks_meta.name} says"
    ]


def _check_order(
    held: Mapping[str, np.ndarray[Any, Any]], latest: Array, vehicles: Sequence[FileVehicle], where: Path
) -> None:  # fmt: skip
    """Raise InputError where the frames of a vehicle run backwards.

    held: some rows. latest: the last frame of each vehicle before them, shape (v,), which becomes that of these rows.
    """
    by_vehicle = np.argsort(held["vehicle"], kind="stable")
    frame, vehicle = held["frame"][by_vehicle], held["vehicle"][by_vehicle]
    before = np.append(-np.inf, frame[:-1])
    first = np.append(True, vehicle[1:] != vehicle[:-1])[: len(frame)]
    before = np.where(first, latest[vehicle], before[: len(frame)])
    if (back := frame < before).any():
        at = int(np.argmax(back))
        raise InputError(
            f"{where}: row {held['number'][by_vehicle[at]]}: time runs backwards, from frame {before[at]:.0f} to "
            f"{frame[at]:.0f} of vehicle {vehicles[vehicle[at]].id}; sort the states by frame"
        )
    latest[vehicle] = frame  # of several frames of a vehicle, the last one is kept


def _columns(file: Path, columns: Mapping[str, pa.DataType], needed: Sequence[str]) -> dict[str, Array]:
    """Return columns of numbers that a file must have. Raises InputError where a value cannot be right."""
    parts: dict[str, list[Array]] = {name: [np.empty(0)] for name in needed}
    line = 2
    for batch in batches(file, columns, needed):
        for name in needed:
            parts[name].append(_numbers(batch, name, file, line))
        line += len(batch)
    return {name: np.concatenate(held) for name, held in parts.items()}


def _numbers(batch: pa.RecordBatch, name: str, file: Path, line: int, or_none: bool = False) -> Array:
    """Return a column of numbers. line: of the first row. or_none: whether a value may be missing, which gives NaN.

    Raises InputError where a value is missing, or cannot be a coordinate or the number of a frame.
    """
    values = np.array(batch[name].to_numpy(zero_copy_only=False), float)
    wrong = ~(np.abs(values) < MOST)
    if or_none:
        wrong &= ~np.isnan(values)
    if wrong.any():
        row = int(np.argmax(wrong))
        found = "missing" if np.isnan(values[row]) else f"{values[row]:g}"
        raise InputError(f"{file}: row {row + line}: {name} is {found}; fix it")
    return values
