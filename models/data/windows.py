"""From records to windows: where windows end, how both streams are cut, the frame of reference.

A window is the last `window_s` seconds of both streams before an instant, its end. Ends lie on the UV's sampling grid,
so that the last TV sample and the last UV sample of a window are simultaneous; no later sample reaches a predictor.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from isac_cosim.base.arrays import Array, BoolArray, Float32Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.seeding import stream
from isac_cosim.base.setting_fields import WindowEnds
from isac_cosim.base.settings import Settings
from isac_cosim.models.data.lane_map import LaneMap
from isac_cosim.models.data.states import COMPONENTS, States, StatesOnDisk, take, windows_of

if TYPE_CHECKING:
    import pandas as pd

    from isac_cosim.labeling.dataset.dataset import Dataset

LaneMaps = Callable[[str], LaneMap]
"""Returns the lanes of a scenario, given its name."""

COLUMNS = (
    "sample_id", "scenario", "seed", "label", "origin", "t_start", "t_onset", "t_commit", "snr_db", "n_sites",
    "x0", "y0", "tv_id", "tv_departed",
)  # fmt: skip
"""The scalar columns of a dataset that predictors and their evaluation read."""

IN_MEMORY_BYTES = 2 * 2**30
"""States of a dataset that take more than this stay on disk."""

START_SHARE = 0.05
"""Share of a window over which the TV's velocity at its start is averaged."""

MIN_TRAVEL_M = 0.5
"""A vehicle that moves less than this within a window has no heading, m."""


class WindowSettings(Settings):
    """What a predictor sees of a record."""

    window_s: float = Field(2.2, gt=0, le=1e3, description="length of a window, s")
    relative_to: Literal["onset", "commit"] = Field(
        "onset", description="instant relative to which window ends are given"
    )
    end_after_s: WindowEnds = Field(
        (0.5, 2.2), description="range of window ends after that instant, s; negative is before; equal: fixed"
    )
    frame: Literal["relative", "moving", "absolute"] = Field(
        "relative",
        description="relative: origin at the TV's first sample of the window, x along the UV's heading; absolute: the "
        "scenario's plane; moving, an extension: like relative, but moving on with the TV's velocity at that sample",
    )

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.end_after_s[0] > self.end_after_s[1]:
            raise ValueError(f"end_after_s {self.end_after_s} is not a range: give the earlier end first")
        return self


@dataclass(frozen=True)
class Records:
    """The records of a dataset.

    tv: (N, 6, S) and uv: (N, 6, C), states at their own rates, in memory or on disk, with positions relative to
    `points`. table: one row per record, with COLUMNS. lane_maps: the roads of their scenarios.
    """

    tv: States
    uv: States
    tv_rate_hz: float
    uv_rate_hz: float
    table: pd.DataFrame
    lane_maps: LaneMaps | None = None

    @classmethod
    def of(
        cls, dataset: Dataset, sensed: Literal["tv", "tv_truth"] = "tv", in_memory_bytes: int = IN_MEMORY_BYTES
    ) -> Self:
        """Open the records of a dataset.

        sensed: the column that gives the TV's states; other columns of states are not read. in_memory_bytes: states
        that take more are left on disk. Windows are the same, to the last bit, wherever the states are.
        """
        lengths = {sensed: dataset.meta.tv_length, "uv": dataset.meta.uv_length}
        arrays: Mapping[str, States]
        if 4 * COMPONENTS * sum(lengths.values()) * len(dataset) <= in_memory_bytes:
            arrays = dataset.arrays(*lengths)
        else:
            arrays = StatesOnDisk.copied(dataset.arrays_by_shard(*lengths), len(dataset), lengths)
        table = dataset.frame(COLUMNS)
        rates = dataset.meta

        @cache
        def lane_map(scenario: str) -> LaneMap:
            return LaneMap.of(dataset.roads(scenario))

        table = table.reset_index(drop=True)
        return cls(arrays[sensed], arrays["uv"], rates.tv_rate_hz, rates.uv_rate_hz, table, lane_map)

    def __len__(self) -> int:
        return len(self.table)

    def take(self, rows: npt.NDArray[np.bool_] | IntArray) -> Records:
        """Return the records of some rows, given as a mask (N,) or as positions."""
        table = self.table.iloc[np.flatnonzero(rows) if rows.dtype == bool else rows].reset_index(drop=True)
        return Records(
            take(self.tv, rows), take(self.uv, rows), self.tv_rate_hz, self.uv_rate_hz, table, self.lane_maps
        )

    @property
    def label(self) -> IntArray:
        """Intention numbers, (N,)."""
        return self.table["label"].to_numpy(dtype=np.int64)

    @property
    def points(self) -> Array:
        """The points of the scenario's plane to which the positions of the records are relative, m, (N, 2).

        The origin for tables that do not say.
        """
        return self.table.reindex(columns=["x0", "y0"], fill_value=0.0).to_numpy(dtype=np.float64)

    @property
    def keeps_left(self) -> BoolArray:
        """Whether traffic keeps left in the scenario of each record, (N,); False where its roads are not known."""
        scenarios = self.table["scenario"]
        if self.lane_maps is None:
            return np.zeros(len(self), dtype=bool)
        keeping_left = [name for name in scenarios.unique() if self.lane_maps(name).lefthand]
        return scenarios.isin(keeping_left).to_numpy(dtype=bool)

    @property
    def groups(self) -> npt.NDArray[np.object_]:
        """`<scenario>-<seed>` of each record, (N,): the units of splits and bootstraps."""
        return (self.table["scenario"].astype(str) + "-" + self.table["seed"].astype(str)).to_numpy(dtype=object)


@dataclass(frozen=True)
class Ends:
    """Ends of n windows: row of the record, and number of the UV sample at which the window ends, each (n,)."""

    row: IntArray
    step: IntArray

    def __len__(self) -> int:
        return len(self.row)

    def __getitem__(self, part: slice | IntArray) -> Ends:
        return Ends(self.row[part], self.step[part])

    def times(self, records: Records) -> Array:
        """Return the simulation time of each end, s, (n,)."""
        start = records.table["t_start"].to_numpy(dtype=np.float64)[self.row]
        return np.asarray(start + self.step / records.uv_rate_hz)


@dataclass(frozen=True, eq=False)
class OnMap:
    """Windows in the scenario's plane: tv (n, 6, T) and uv (n, 6, U), the scenario of each, (n,), and its lanes."""

    tv: Array
    uv: Array
    tv_rate_hz: float
    scenario: npt.NDArray[np.object_]
    lane_maps: LaneMaps

    @classmethod
    def in_one(cls, tv: Array, uv: Array, tv_rate_hz: float, lanes: LaneMap) -> Self:
        """Return windows that are all in one scenario, which need not be named."""
        return cls(tv, uv, tv_rate_hz, np.full(len(tv), "", dtype=object), lambda _: lanes)


@dataclass(frozen=True)
class Windows:
    """A batch of windows: tv (n, 6, T) and uv (n, 6, U), in the frame of reference of the settings.

    on_map: the same windows on their roads, if these are known, for predictors that look at lanes.
    """

    tv: Float32Array
    uv: Float32Array
    on_map: OnMap | None = None

    def __len__(self) -> int:
        return len(self.tv)


def lengths(records: Records, settings: WindowSettings) -> tuple[int, int]:
    """Return the samples per window of the TV's and the UV's stream. Raises InputError if records are too short."""
    tv, uv = round(settings.window_s * records.tv_rate_hz), round(settings.window_s * records.uv_rate_hz)
    if tv > records.tv.shape[2] or uv > records.uv.shape[2]:
        length_s = records.uv.shape[2] / records.uv_rate_hz
        raise InputError(f"windows.window_s {settings.window_s} exceeds the records ({length_s:g} s): shorten it")
    return tv, uv


def fitting(records: Records, settings: WindowSettings) -> tuple[int, int]:
    """Return the first and last UV sample at which a window that lies wholly inside a record can end."""
    n_tv, n_uv = lengths(records, settings)
    ratio = records.tv_rate_hz / records.uv_rate_hz
    first = max(n_uv - 1, int(np.ceil((n_tv - 1) / ratio - 1e-9)))
    last = min(records.uv.shape[2] - 1, int(np.floor((records.tv.shape[2] - 1) / ratio + 1e-9)))
    return first, last


def end_bounds(records: Records, settings: WindowSettings) -> tuple[IntArray, IntArray]:
    """Return the first and last UV sample at which a window of each record can end, (N,); last < first if none can.

    This is the range of the settings, limited to ends for which the window lies wholly inside the record.
    """
    first_fit, last_fit = fitting(records, settings)
    anchor = records.table[f"t_{settings.relative_to}"].to_numpy(dtype=np.float64)
    since_start = anchor - records.table["t_start"].to_numpy(dtype=np.float64)
    since_start = np.where(np.isfinite(since_start), since_start, np.inf)
    early, late = settings.end_after_s
    low = np.ceil((since_start + early) * records.uv_rate_hz - 1e-6)
    high = np.floor((since_start + late) * records.uv_rate_hz + 1e-6)
    if early == late:
        low = high = np.round((since_start + early) * records.uv_rate_hz)
    first = np.clip(low, first_fit, last_fit + 1).astype(np.int64)
    last = np.clip(high, first_fit - 1, last_fit).astype(np.int64)
    return first, last


def draw_ends(records: Records, settings: WindowSettings, *keys: str | int, per_record: int = 1) -> Ends:
    """Draw window ends uniformly, `per_record` from each record that can hold such a window.

    keys: name the draw (such as purpose, seed, epoch); the ends of a record depend on them and on its sample_id alone.
    Raises InputError if no record can hold such a window.
    """
    first, last = end_bounds(records, settings)
    usable = np.flatnonzero(last >= first)
    if not len(usable):
        early, late = settings.end_after_s
        raise InputError(
            f"windows.end_after_s ({early}, {late}) after {settings.relative_to}: no record of the dataset holds "
            "such a window; move the range"
        )
    names = records.table["sample_id"].to_numpy()
    steps = [
        stream("window", *keys, str(names[k])).integers(first[k], last[k], per_record, endpoint=True) for k in usable
    ]
    return Ends(np.repeat(usable, per_record), np.concatenate(steps).astype(np.int64))


def in_frame(tv: Array, uv: Array, settings: WindowSettings, tv_rate_hz: float, uv_rate_hz: float) -> Windows:
    """Return windows in the frame of the settings, from streams (n, 6, T) and (n, 6, U) in the scenario's plane.

    Both streams end at the same instant.
    """
    if settings.frame != "absolute":
        tv, uv = to_relative(tv, uv)
    if settings.frame == "moving":
        duration = (tv.shape[2] - 1) / tv_rate_hz
        tv, uv = to_moving(tv, uv, duration, duration - (uv.shape[2] - 1) / uv_rate_hz)
    return Windows(tv.astype(np.float32), uv.astype(np.float32))


def cut(records: Records, ends: Ends, settings: WindowSettings) -> Windows:
    """Cut windows with these ends, in the frame of the settings. Raises ValueError if one is not inside its record."""
    n_tv, n_uv = lengths(records, settings)
    first, last = fitting(records, settings)
    if len(ends) and not (first <= ends.step.min() and ends.step.max() <= last):
        raise ValueError(f"windows end at UV samples {ends.step.min()} to {ends.step.max()}; {first} to {last} fit")
    tv_end = np.floor(ends.step * (records.tv_rate_hz / records.uv_rate_hz) + 1e-9).astype(np.int64)
    tv = windows_of(records.tv, ends.row, tv_end, n_tv)
    uv = windows_of(records.uv, ends.row, ends.step, n_uv)
    points = records.points[ends.row][:, :, None]
    tv[:, :2] += points
    uv[:, :2] += points
    windows = in_frame(tv, uv, settings, records.tv_rate_hz, records.uv_rate_hz)
    if records.lane_maps is None:
        return windows
    scenario = records.table["scenario"].to_numpy(dtype=object)[ends.row]
    return replace(windows, on_map=OnMap(tv, uv, records.tv_rate_hz, scenario, records.lane_maps))


def batches(records: Records, ends: Ends, settings: WindowSettings, size: int) -> Iterator[Windows]:
    """Cut windows with these ends, in order, `size` at a time."""
    for k in range(0, len(ends), size):
        yield cut(records, ends[k : k + size], settings)


def to_relative(tv: Array, uv: Array) -> tuple[Array, Array]:
    """Return both streams with the origin at the TV's first sample and x along the UV's heading; shapes are kept.

    The heading is the direction of the UV's displacement over the window, or of the TV's if the UV stands still; if
    both stand still, the axes stay. Positions are shifted and rotated, velocities and accelerations only rotated.
    """
    travel = _travel(uv)
    standing = np.hypot(travel[:, 0], travel[:, 1]) < MIN_TRAVEL_M
    travel = np.where(standing[:, None], _travel(tv), travel)
    norm = np.hypot(travel[:, 0], travel[:, 1])
    still = norm < MIN_TRAVEL_M
    cos = np.where(still, 1.0, travel[:, 0] / np.where(still, 1.0, norm))
    sin = np.where(still, 0.0, travel[:, 1] / np.where(still, 1.0, norm))
    origin = tv[:, :2, 0]
    return _turned(tv, origin, cos, sin), _turned(uv, origin, cos, sin)


def to_moving(tv: Array, uv: Array, end_s: float, uv_start_s: float) -> tuple[Array, Array]:
    """Return both streams in a frame that moves with the TV's velocity at the start of the window; shapes are kept.

    end_s: time of the last sample of both streams, s after the TV's first one. uv_start_s: the same of the UV's first
    sample. The velocity is the mean over the first START_SHARE of the window, because a single sample is noisy.
    """
    early = max(1, round(START_SHARE * tv.shape[2]))
    velocity = tv[:, 2:4, :early].mean(axis=2)[:, :, None]
    moved = []
    for states, first in ((tv, 0.0), (uv, uv_start_s)):
        drift = velocity * np.linspace(first, end_s, states.shape[2])
        moved.append(np.concatenate([states[:, :2] - drift, states[:, 2:4] - velocity, states[:, 4:]], axis=1))
    return moved[0], moved[1]


def _travel(states: Array) -> Array:
    """Return the displacement over the window, m, (n, 2)."""
    return states[:, :2, -1] - states[:, :2, 0]


def _turned(states: Array, origin: Array, cos: Array, sin: Array) -> Array:
    """Return states (n, 6, T) relative to an origin (n, 2), with x along (cos, sin), each (n,)."""
    pairs = states.reshape(len(states), 3, 2, -1)
    shift = np.zeros((len(states), 3, 2, 1))
    shift[:, 0, :, 0] = origin
    u, v = np.moveaxis(pairs - shift, 2, 0)
    c, s = cos[:, None, None], sin[:, None, None]
    return np.stack([c * u + s * v, c * v - s * u], axis=2).reshape(states.shape)
