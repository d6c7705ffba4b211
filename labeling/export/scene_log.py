"""An episode, a stretch of one, or a record as an MCAP file, which Foxglove shows as a scene in motion.

Messages are JSON, in the form that Foxglove documents for the schemas named here (docs.foxglove.dev, message schemas):
`SceneUpdate` for what is drawn and `Log` for events. States, which Foxglove plots, have a schema of their own. Times
are those of the simulation, places those of the scenario's plane.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError, writing
from isac_cosim.base.files import json_text
from isac_cosim.isacsim.scenarios.scenario import Site
from isac_cosim.labeling.dataset.dataset import STATE, RoadLane, Sample
from isac_cosim.labeling.dataset.record_point import in_plane

if TYPE_CHECKING:
    from collections.abc import Generator

    from mcap.writer import Writer

MCAP_FILE = "scene.mcap"
FRAME = "plane"
HEIGHT_M = 1.5
"""Drawn height of vehicles, m."""
PATH_HZ = 25.0
"""Places of a drawn path a second."""
REACH_M = 300.0
"""Lanes are drawn as far as this from what moves, m."""
GREY, BLUE, ORANGE = (0.6, 0.6, 0.6, 0.8), (0.1, 0.45, 0.9, 1.0), (0.95, 0.55, 0.1, 1.0)
BLACK, GREEN, ROAD = (0.0, 0.0, 0.0, 0.6), (0.1, 0.6, 0.3, 1.0), (0.5, 0.5, 0.5, 0.35)
Color = tuple[float, float, float, float]
LINE_STRIP = 0
INFO = 2

_TIME = {"type": "object", "title": "time", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_MANY = {"type": "array", "items": {"type": "object"}}
SCENE, LOG, STATES = "foxglove.SceneUpdate", "foxglove.Log", "isac_cosim.State"
SCHEMAS: Mapping[str, Mapping[str, Any]] = {
    SCENE: {"deletions": _MANY, "entities": _MANY},
    LOG: {"timestamp": _TIME}
    | {name: {"type": "string"} for name in ("message", "name", "file")}
    | {name: {"type": "integer"} for name in ("level", "line")},
    STATES: {"timestamp": _TIME} | {name: {"type": "number"} for name in STATE},
}


@dataclass(frozen=True)
class Placed:
    """A vehicle at one instant. x, y: of its front bumper, m. heading: radians, counter-clockwise from x."""

    id: str
    x: float
    y: float
    heading: float
    length_m: float
    width_m: float


class SceneLog:
    """Writes one MCAP file. Everything is at an instant of simulation time, s, in any order."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas = {
            name: writer.register_schema(
                name, "jsonschema", json_text({"title": name, "type": "object", "properties": properties}).encode()
            )
            for name, properties in SCHEMAS.items()
        }
        self._channels: dict[str, int] = {}

    @classmethod
    @contextmanager
    def new(cls, path: Path) -> Generator[Self]:
        """A log that is written to a file while the block lasts.

        Raises InputError where the library for such files is not installed, OutputError where it cannot be written.
        """
        try:
            from mcap.writer import Writer
        except ImportError:
            raise InputError("--mcap needs the library mcap: pip install '.[mcap]' in a checkout") from None
        with writing(path), path.open("wb") as file:
            writer = Writer(file)
            writer.start(profile="", library="isac-cosim")
            yield cls(writer)
            writer.finish()  # type: ignore[no-untyped-call]

    def place(self, at_s: float, lanes: Iterable[RoadLane], sites: Iterable[Site]) -> None:
        """Draw the lanes and the sites; they stay."""
        drawn = [_line(lane.shape.T, lane.width_m, ROAD, -0.1) for lane in lanes]
        entities = [_entity(at_s, "roads", lines=drawn)]
        for site in sites:
            name, pole = f"site {site.id}", {"x": site.x, "y": site.y, "z": site.height_m}
            heading = np.radians(90.0 - site.azimuth_deg)
            tip = {"shaft_length": 12.0, "shaft_diameter": 1.0, "head_length": 4.0, "head_diameter": 2.5}
            arrow = {"pose": _pose(site.x, site.y, site.height_m, heading), **tip, "color": _color(GREEN)}
            mast = {
                "pose": _pose(site.x, site.y, site.height_m / 2, 0.0),
                "size": {"x": 0.5, "y": 0.5, "z": site.height_m},
                "color": _color(GREEN),
            }
            entities.append(_entity(at_s, name, arrows=[arrow], cubes=[mast], texts=[_text(site.id, pole, GREEN)]))
        self._write("/place", SCENE, at_s, {"deletions": [], "entities": entities})

    def vehicles(self, at_s: float, placed: Sequence[Placed], targets: set[str], own: set[str]) -> None:
        """Draw all vehicles there are at an instant, in place of those of the instant before.

        targets, own: ids of the vehicles that are TV or UV of a record then; they have other colours, and a name.
        """
        cubes, texts = [], []
        for vehicle in placed:
            role = "TV" if vehicle.id in targets else "UV" if vehicle.id in own else ""
            color = {"TV": BLUE, "UV": ORANGE}.get(role, GREY)
            back = vehicle.length_m / 2
            x, y = vehicle.x - back * np.cos(vehicle.heading), vehicle.y - back * np.sin(vehicle.heading)
            size = {"x": vehicle.length_m, "y": vehicle.width_m, "z": HEIGHT_M}
            cubes.append({"pose": _pose(x, y, HEIGHT_M / 2, vehicle.heading), "size": size, "color": _color(color)})
            if role:
                texts.append(_text(f"{role} {vehicle.id}", {"x": float(x), "y": float(y), "z": 3.0}, color))
        entity = _entity(at_s, "vehicles", cubes=cubes, texts=texts)
        self._write("/vehicles", SCENE, at_s, {"deletions": [], "entities": [entity]})

    def record(self, sample: Sample, rates_hz: tuple[float, float]) -> int:
        """Write a record: its paths, drawn whole for as long as it lasts, its states, and what its label says when.

        rates_hz: of the TV's and of the UV's states. Returns how many states were written.
        """
        sides = (
            ("tv_sensed", sample.tv, rates_hz[0], BLUE),
            ("tv_true", sample.tv_truth, rates_hz[0], BLACK),
            ("uv_reported", sample.uv, rates_hz[1], ORANGE),
        )
        count, name = 0, sample.sample_id
        for side, relative, rate_hz, color in sides:
            states = in_plane(relative, sample.x0, sample.y0)
            times = np.round(sample.t_start + np.arange(states.shape[1]) / rate_hz, 6).tolist()
            for at_s, values in zip(times, states.T.tolist(), strict=True):
                state = dict(zip(STATE, values, strict=True))
                self._write(f"/records/{name}/{side}", STATES, at_s, {"timestamp": _time(at_s), **state})
            count += len(times)
            every = max(1, round(rate_hz / PATH_HZ))
            path, span_s = states[:2, ::every], (times[-1] - times[0])
            entity = _entity(times[0], f"{name} {side}", span_s, lines=[_line(path, 0.25, color, 0.1)])
            self._write("/paths", SCENE, times[0], {"deletions": [], "entities": [entity]})
        what = sample.intention.text.replace("_", " ")
        moments = (
            ("record begins", sample.t_start), ("onset", sample.t_onset), ("commit", sample.t_commit),
            ("end", sample.t_end),
        )  # fmt: skip
        for moment, at_s in moments:
            message = f"{what} of TV {sample.tv_id}, UV {sample.uv_id} ({sample.origin}): {moment}"
            entry = {"timestamp": _time(at_s), "level": INFO, "message": message, "name": name, "file": "", "line": 0}
            self._write("/events", LOG, at_s, entry)
        return count

    def _write(self, topic: str, schema: str, at_s: float, content: Mapping[str, Any]) -> None:
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, "json", self._schemas[schema])
        instant = _nanoseconds(at_s)
        self._writer.add_message(self._channels[topic], instant, json_text(content).encode(), instant)


def lanes_near(lanes: Iterable[RoadLane], places: Array) -> list[RoadLane]:
    """Return the lanes that come within REACH_M of the box around some places, (2, n), m."""
    low, high = places.min(axis=1) - REACH_M, places.max(axis=1) + REACH_M
    return [lane for lane in lanes if (lane.shape.max(axis=0) >= low).all() and (lane.shape.min(axis=0) <= high).all()]


def _nanoseconds(at_s: float) -> int:
    return max(0, round(at_s * 1e9))


def _time(at_s: float) -> dict[str, int]:
    sec, nsec = divmod(_nanoseconds(at_s), 1_000_000_000)
    return {"sec": sec, "nsec": nsec}


def _color(color: Color) -> dict[str, float]:
    return dict(zip("rgba", color, strict=True))


def _pose(x: float, y: float, z: float, heading: float) -> dict[str, dict[str, float]]:
    turn = {"x": 0.0, "y": 0.0, "z": float(np.sin(heading / 2)), "w": float(np.cos(heading / 2))}
    return {"position": {"x": float(x), "y": float(y), "z": float(z)}, "orientation": turn}


def _line(path: Array, width_m: float, color: Color, z: float) -> dict[str, Any]:
    """Return a line through places, (2, n), m, so wide in the scene, m."""
    return {
        "type": LINE_STRIP,
        "pose": _pose(0.0, 0.0, z, 0.0),
        "thickness": width_m,
        "scale_invariant": False,
        "points": [{"x": x, "y": y, "z": 0.0} for x, y in path.T.tolist()],
        "color": _color(color),
        "colors": [],
        "indices": [],
    }


def _text(text: str, position: Mapping[str, float], color: Color) -> dict[str, Any]:
    pose = _pose(position["x"], position["y"], position["z"], 0.0)
    return {
        "pose": pose, "billboard": True, "font_size": 12.0, "scale_invariant": True, "color": _color(color),
        "text": text,
    }  # fmt: skip


def _entity(at_s: float, name: str, lifetime_s: float = 0.0, **primitives: Sequence[Any]) -> dict[str, Any]:
    """Return what is drawn under a name, in place of what was. lifetime_s: 0 for ever, s."""
    kinds = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    return {
        "timestamp": _time(at_s),
        "frame_id": FRAME,
        "id": name,
        "lifetime": _time(lifetime_s),
        "frame_locked": False,
        "metadata": [],
        **{kind: primitives.get(kind, []) for kind in kinds},
    }
