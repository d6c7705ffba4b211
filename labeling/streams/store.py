"""Streams on disk: each watched stretch once, with the UVs' reports and the events of its episode.

    STREAMS/streams.json                      the study, what is in the folder, digests
    STREAMS/stretches/<scenario>-<seed>.parquet   one row a stretch; its metadata holds the facts of the episode
    STREAMS/events/<scenario>-<seed>.parquet      one row an event, near misses and neutral events included
    STREAMS/roads/<scenario>.parquet          the lanes

Positions are relative to a point near the beginning of the stretch, `x0` and `y0`, and all states are float32, as in a
dataset of records.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import Field

from isac_cosim.base.arrays import Array, Float32Array, IntArray
from isac_cosim.base.files import replace_file
from isac_cosim.base.settings import WithOptionalParts
from isac_cosim.base.stored.episode_files import EpisodeFiles
from isac_cosim.base.stored.tables import check_types
from isac_cosim.isacsim.scene.scores import SceneScores
from isac_cosim.isacsim.sensing.passages import TrackUse
from isac_cosim.labeling.dataset.record_point import in_plane
from isac_cosim.labeling.dataset.shard import TRACK, schema
from isac_cosim.labeling.streams.events import LiveEvent

STRETCHES, EVENTS = "stretches", "events"
STATES = pa.list_(pa.list_(pa.float32()), 6)
"""x, y, vx, vy, ax, ay, each of the same length."""
COLUMNS = pa.schema(
    [
        ("tv_id", pa.string()),
        ("start_s", pa.float64()),
        ("x0", pa.float64()),
        ("y0", pa.float64()),
        ("n_sites", pa.int8()),
        ("tv", STATES),
        ("tv_truth", STATES),
        ("decision_s", pa.list_(pa.float64())),
        ("segment", pa.list_(pa.int32())),
        ("uv_id", pa.list_(pa.string())),
        ("uv_first", pa.list_(pa.int64())),
        ("uv", pa.list_(STATES)),
    ]
)
"""The columns of a file of stretches; docs/streams.md explains each."""
TRACK_COLUMNS = pa.schema([schema(1, 1).field(name) for name in TRACK])
"""The columns that streams of a scene have besides, those of its records."""
EVENT_COLUMNS = pa.schema(
    [
        *((name, pa.string()) for name in ("vehicle", "intention")),
        *((name, pa.float64()) for name in ("onset", "commit", "end")),
        *((name, pa.string()) for name in ("group", "left_out")),
    ]
)
"""The columns of a file of events, as in `LiveEvent`; `left_out` is empty for an event that counts."""


class StreamFacts(WithOptionalParts):
    """The facts of an episode.

    fingerprint: of the dataset. simulated_s: recorded time, s. instants: number of due decisions of all vehicles.
    decisions: number of those that windows can be cut for. uncovered: number of the others, by reason. scene: how well
    the network knew who was where; absent of sensors that know whom they watch.
    """

    optional_parts: ClassVar[frozenset[str]] = frozenset({"scene"})

    schema_version: Literal[1] = 1
    fingerprint: str
    scenario: str
    seed: int
    decision_s: float = Field(gt=0)
    simulated_s: float = Field(ge=0)
    instants: int = Field(ge=0)
    decisions: int = Field(ge=0)
    uncovered: dict[str, Annotated[int, Field(ge=0)]]
    scene: SceneScores | None = None
    events: tuple[LiveEvent, ...]


@dataclass(frozen=True)
class StoredStretch:
    """A stretch as it is stored.

    start_s: first instant, s of simulation time. point: to which positions are relative, m. tv, tv_truth: sensed and
    true states of the TV from `start_s` on, (6, S). decision_s: instants at which windows can end, (n,). segment:
    number of each decision's segment of reports, (n,). uv_id, uv_first, uv: of each segment the UV, the number of its
    first report in intervals since time 0, and its reports, (6, r). track: which of the network's tracks stands for the
    TV, in a scene; None where the sensor knows whom it watches.
    """

    tv_id: str
    start_s: float
    point: tuple[float, float]
    n_sites: int
    tv: Float32Array
    tv_truth: Float32Array
    decision_s: Array
    segment: IntArray
    uv_id: tuple[str, ...]
    uv_first: tuple[int, ...]
    uv: tuple[Float32Array, ...]
    track: TrackUse | None = None

    def window(
        self, k: int, lengths: tuple[int, int], rates_hz: tuple[float, float], delay_s: float, true: bool = False
    ) -> tuple[Array, Array]:
        """Return the window that ends at the k-th decision, TV (6, T) and UV (6, U), in the scenario's plane, float64.

        lengths, rates_hz: of the TV's and of the UV's part. delay_s: age of the newest report, s. true: the TV's true
        motion in place of the sensed one. Raises ValueError if the window is longer than what is stored.
        """
        time_s = float(self.decision_s[k])
        segment = int(self.segment[k])
        states = self.tv_truth if true else self.tv
        last = round((time_s - self.start_s) * rates_hz[0]), round((time_s - delay_s) * rates_hz[1])
        last = last[0], last[1] - self.uv_first[segment]
        if last[0] + 1 < lengths[0] or last[1] + 1 < lengths[1]:
            raise ValueError(f"the window that ends at {time_s:g} s begins before what is stored")
        parts = (states, self.uv[segment])
        tv, uv = (
            in_plane(part[:, at + 1 - length : at + 1], *self.point)
            for part, at, length in zip(parts, last, lengths, strict=True)
        )
        return tv, uv


def file_name(scenario: str, seed: int) -> str:
    """Return the name of an episode's files."""
    return f"{scenario}-{seed}.parquet"


def _check(table: pa.Table) -> None:
    """Raise ValueError, which names the column, unless a table holds what `write_stretches` writes."""
    check_types(table, COLUMNS)
    _check_tracks(table)
    for row in range(len(table)):
        stretch = _stretch(table, row)
        if stretch.tv.shape != stretch.tv_truth.shape or not stretch.tv.shape[1]:
            raise ValueError("tv, tv_truth: are of different lengths, or empty")
        if not len(stretch.uv_id) == len(stretch.uv_first) == len(stretch.uv):
            raise ValueError("uv_id, uv_first, uv: are of different numbers of segments")
        numbers, times = stretch.segment, stretch.decision_s
        if len(numbers) != len(times) or not len(times) or not 0 <= numbers.min() <= numbers.max() < len(stretch.uv):
            raise ValueError("segment: is not a segment for every decision")
        if not (np.diff(times) > 0).all() or times[0] < stretch.start_s:
            raise ValueError("decision_s: is not in order, or before the stretch begins")
        for name in ("start_s", "point", "tv", "tv_truth", "decision_s"):
            if not np.isfinite(getattr(stretch, name)).all():
                raise ValueError(f"{name}: is not finite")
        if not all(np.isfinite(part).all() for part in stretch.uv):
            raise ValueError("uv: is not finite")


def _check_tracks(table: pa.Table) -> None:
    """Raise ValueError, which names the column, unless a table says nothing of tracks, or what can be true."""
    if not any(name in table.column_names for name in TRACK):
        return
    check_types(table, TRACK_COLUMNS)
    for name, most in (("right_share", 1.0), ("breaks", np.inf), ("position_sd_m", np.inf)):
        values = table[name].to_numpy()
        if not (np.isfinite(values) & (values >= 0) & (values <= most)).all():
            raise ValueError(f"{name}: is not finite, or out of bounds")


FILES = EpisodeFiles(StreamFacts, b"isac_cosim.streams", lambda facts: [file_name(facts.scenario, facts.seed)], _check)


def write_stretches(folder: Path, facts: StreamFacts, stretches: Sequence[StoredStretch]) -> None:
    """Write an episode's events, then its stretches, so that an episode with stretches is complete."""
    name = file_name(facts.scenario, facts.seed)
    rows = [{**event.model_dump(), "left_out": event.left_out or ""} for event in facts.events]
    events = pa.Table.from_pylist(rows, schema=EVENT_COLUMNS)
    replace_file(folder / EVENTS / name, lambda partial: pq.write_table(events, partial, compression="zstd"))
    values: dict[str, list[Any]] = {
        "tv_id": [s.tv_id for s in stretches],
        "start_s": [s.start_s for s in stretches],
        "x0": [s.point[0] for s in stretches],
        "y0": [s.point[1] for s in stretches],
        "n_sites": [s.n_sites for s in stretches],
        "tv": [list(s.tv) for s in stretches],
        "tv_truth": [list(s.tv_truth) for s in stretches],
        "decision_s": [s.decision_s for s in stretches],
        "segment": [s.segment for s in stretches],
        "uv_id": [s.uv_id for s in stretches],
        "uv_first": [s.uv_first for s in stretches],
        "uv": [[list(part) for part in s.uv] for s in stretches],
    }
    columns = {field.name: pa.array(values[field.name], field.type) for field in COLUMNS}
    if facts.scene is not None:
        tracks = {field.name: [getattr(s.track, field.name) for s in stretches] for field in TRACK_COLUMNS}
        columns |= {field.name: pa.array(tracks[field.name], field.type) for field in TRACK_COLUMNS}
    floats = [f"{name}.list.element.list.element" for name in ("tv", "tv_truth")]
    options = {
        "row_group_size": 16,
        "use_dictionary": ["tv_id"],
        "use_byte_stream_split": [*floats, "uv.list.element.list.element.list.element"],
    }
    FILES.write(folder / STRETCHES / name, facts, columns, **options)


def read_stretches(path: Path) -> tuple[StreamFacts, list[StoredStretch]]:
    """Read an episode's stretches. Raises InputError if the file is damaged, or that of another episode."""
    facts, table = FILES.read(path)
    return facts, [_stretch(table, row) for row in range(len(table))]


def _stretch(table: pa.Table, row: int) -> StoredStretch:
    def at(name: str) -> Any:
        return table[name][row]

    return StoredStretch(
        tv_id=at("tv_id").as_py(),
        start_s=at("start_s").as_py(),
        point=(at("x0").as_py(), at("y0").as_py()),
        n_sites=at("n_sites").as_py(),
        tv=_states(at("tv")),
        tv_truth=_states(at("tv_truth")),
        decision_s=at("decision_s").values.to_numpy(),
        segment=at("segment").values.to_numpy().astype(np.int64),
        uv_id=tuple(at("uv_id").as_py()),
        uv_first=tuple(at("uv_first").as_py()),
        uv=tuple(_states(part) for part in at("uv")),
        track=TrackUse(*(at(name).as_py() for name in TRACK)) if TRACK[0] in table.column_names else None,
    )


def _states(value: Any) -> Float32Array:
    """Return states (6, n). Raises ValueError if the six are of different lengths."""
    return np.stack([component.values.to_numpy() for component in value])
