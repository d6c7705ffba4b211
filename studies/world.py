"""The world of a figure: every setting and constant that its numbers rest on, by part.

A part holds the settings of a study, and the numbers that stand as constants in the packages of that part, such as the
headways of drawn drivers. Rules that are code and no number are not in it: a change of those raises a schema version or
the name of a preset, which is.
"""

from __future__ import annotations

import ast
import importlib
import pkgutil
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from enum import Enum
from functools import cache
from math import isfinite
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import numpy as np
from pydantic import BaseModel, JsonValue

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import content_digest, file_digest
from isac_cosim.evaluation.closed_loop.settings import ClosedLoopSettings
from isac_cosim.evaluation.in_traffic.settings import LiveSettings
from isac_cosim.isacsim.scenarios.scenario import bundled
from isac_cosim.labeling.streams.settings import StretchSettings
from isac_cosim.studies.study import Study

NAME: Final = "isac_cosim"
ROOMS: Mapping[str, tuple[str, ...]] = {
    "traffic": (
        "isacsim.scenarios.corners",
        "isacsim.scenarios.demand",
        "isacsim.scenarios.reference_line",
        "isacsim.scenarios.site_placement",
        "isacsim.traffic.motion",
        "isacsim.traffic.recordings",
        "isacsim.traffic.road_coordinates",
        "isacsim.traffic.sources",
    ),
    "recordings": ("isacsim.traffic.trajectory_files",),
    "maneuvers": ("isacsim.traffic.drivers",),
    "labels": ("labeling.dataset.shard", "labeling.detectors", "labeling.road", "labeling.samples", "labeling.streams"),
    "sensing": ("isacsim.radio", "isacsim.sensing", "isacsim.tracking"),
    "scene": ("isacsim.scene",),
    "predictors": ("models",),
    "evaluation": (
        "evaluation.closed_loop", "evaluation.in_traffic", "evaluation.on_windows", "evaluation.statistics",
    ),
}  # fmt: skip
"""The modules and packages whose constants belong to a part."""
PARTS = tuple(ROOMS)
WITHOUT_SCENES = tuple(part for part in PARTS if part != "scene")
"""What figures rest on where each vehicle is sensed by itself."""
MEASUREMENT: Final = "measurement"
SECTIONS = {
    "maneuvers": "maneuvers",
    "labels": "labels", "pairs": "labels", "record": "labels", "selection": "labels",
    "sensing": "sensing", "report": "sensing",
}  # fmt: skip
"""The part of each section of a dataset's study; the others are of the traffic."""
TECHNICAL = re.compile(r"_?(MOST_|BATCH|AT_ONCE|READABLE|FORMER|ROW)|.*(CPU_S|BYTES|_KEPT)$")
"""Constants that say how much is read or computed at once, or what earlier versions had: no figure rests on them."""
ESTIMATES = ".cost_estimate"
"""What the names of modules end in whose constants say what something costs."""
Settings = dict[str, JsonValue]
"""Settings by their dotted name."""
ABSENT: Final = "(absent)"


def world_of(study: Study, parts: Sequence[str] = PARTS, measurement: Sequence[str] = ()) -> dict[str, Settings]:
    """Return every setting and constant behind the figures of a study, by part and dotted name.

    measurement: the modules that measure, whose constants are a part of their own, `MEASUREMENT`.
    """
    by_part: dict[str, Settings] = {part: {} for part in PARTS}
    for section, content in study.dataset.model_dump(mode="json").items():
        by_part[SECTIONS.get(section, "traffic")].update(_flat(content, f"dataset.{section}"))
    for scenario in study.dataset.scenarios:
        by_part["traffic"].update(_files_of(scenario))
    by_part["labels"].update(_flat(StretchSettings().model_dump(mode="json"), "streams"))
    by_part["predictors"].update(_flat(study.training.model_dump(mode="json"), "training"))
    for name, settings in (
        ("evaluation", study.evaluation), ("live", LiveSettings()), ("closed_loop", ClosedLoopSettings()),
    ):  # fmt: skip
        by_part["evaluation"].update(_flat(settings.model_dump(mode="json"), name))
    of_parts = {part: by_part[part] | constants(ROOMS[part]) for part in parts}
    return {**of_parts, MEASUREMENT: constants(measurement)} if measurement else of_parts


def digests(world: Mapping[str, Settings]) -> dict[str, str]:
    """Return the SHA-256 digest of each part."""
    return {part: content_digest(settings) for part, settings in world.items()}


def differing(before: Mapping[str, Settings], now: Mapping[str, Settings]) -> dict[str, list[str]]:
    """Return the names of the settings that differ between two worlds, by part; parts that agree are left out.

    Parts that `now` does not rest on do not count, nor do constants that a record has in another part than they are in
    now.
    """
    names = {
        part: sorted(
            name
            for name in before.get(part, {}).keys() | settings.keys()
            if not _elsewhere(name, part)
            and _plain(before.get(part, {}).get(name, ABSENT)) != _plain(settings.get(name, ABSENT))
        )
        for part, settings in now.items()
    }
    return {part: changed for part, changed in names.items() if changed}


def _elsewhere(name: str, part: str) -> bool:
    """Return whether a constant belongs to another part."""
    return any(name.startswith(f"{room}.") for other, rooms in ROOMS.items() if other != part for room in rooms)


def constants(rooms: Sequence[str]) -> Settings:
    """Return the constants of modules and packages that hold a number, by `module.NAME`."""
    found: Settings = {}
    for room in rooms:
        for module in _modules(room):
            for name in _assigned(str(module.__file__)):
                value = _plain(getattr(module, name, None))
                if _has_number(value) and not TECHNICAL.match(name):
                    found[f"{module.__name__.removeprefix(f'{NAME}.')}.{name}"] = value
    return found


@cache
def _modules(room: str) -> tuple[ModuleType, ...]:
    """Return the modules of a room as this process found them first: it does not run what a checkout gets later."""
    module = importlib.import_module(f"{NAME}.{room}")
    names = [found.name for found in pkgutil.walk_packages(getattr(module, "__path__", ()), f"{module.__name__}.")]
    return module, *(importlib.import_module(name) for name in names if not name.endswith(ESTIMATES))


@cache
def _assigned(file: str) -> tuple[str, ...]:
    """Return the constants that a module assigns itself; those that it imports belong to another."""
    names = []
    for node in ast.parse(Path(file).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign | ast.AnnAssign):
            names += [
                one.id
                for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
                for one in (target.elts if isinstance(target, ast.Tuple) else [target])
                if isinstance(one, ast.Name) and one.id.isupper()
            ]
    return tuple(dict.fromkeys(names))


def _plain(value: Any) -> JsonValue:
    """Return a constant as plain values; None for what is neither number, text nor a collection of these."""
    if isinstance(value, BaseModel):
        value = value.model_dump(mode="json")
    elif is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    elif isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, float):
        # What numpy computes differs in its last digits between processors; no setting has as many.
        return float(f"{value:.12g}") if isfinite(value) else str(value)
    if isinstance(value, bool | int | str):
        return value
    if isinstance(value, Mapping):
        return {str(_plain(key)): _plain(one) for key, one in value.items()}
    if isinstance(value, frozenset | set):
        return sorted((_plain(one) for one in value), key=str)
    if isinstance(value, tuple | list | range):
        return [_plain(one) for one in value]
    return str(value) if isinstance(value, complex) else None


def _has_number(value: JsonValue) -> bool:
    if isinstance(value, dict | list):
        return any(map(_has_number, value.values() if isinstance(value, dict) else value))
    return isinstance(value, int | float)


def _flat(content: JsonValue, name: str) -> Settings:
    """Return the leaves of nested settings by their dotted name."""
    if not isinstance(content, dict) or not content:
        return {name: content}
    leaves: Settings = {}
    for key, value in content.items():
        leaves |= _flat(value, f"{name}.{key}")
    return leaves


def _files_of(scenario: str) -> Settings:
    """Return the digest of each file of a bundled scenario: its roads, demand and sites."""
    if scenario not in bundled():
        raise InputError(f"{scenario}: is not bundled; figures of the documents rest on bundled scenarios")
    folder = bundled()[scenario]
    return {
        f"scenario.{scenario}.{file.name}": file_digest(file)
        for file in sorted(folder.iterdir())
        if file.suffix in (".xml", ".sumocfg")
    }
