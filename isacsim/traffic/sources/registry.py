"""Motion sources by name: those of this project, and those that installed packages offer. A study names one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from isac_cosim.base.errors import InputError
from isac_cosim.base.registry import Registry
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.sources.kinematic import KinematicSource
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource
from isac_cosim.isacsim.traffic.sources.simulated import SumoSource

OWN: Mapping[str, type[MotionSource]] = {"sumo": SumoSource, "kinematic": KinematicSource}
"""The motion sources of this project."""
MOTION_SOURCES: Registry[type[MotionSource]] = Registry("motion source", OWN, group="isac_cosim.motion_sources")
"""Classes of motion sources, by the name that a study gives as `source`."""


class MotionStudy(Protocol):
    """The parts of a study that its motion source is made from. source: its name."""

    @property
    def source(self) -> str: ...

    def source_settings(self) -> Mapping[str, Settings]:
        """Return the settings of the source by section."""
        ...


def source_class(name: str) -> type[MotionSource]:
    """Return the class of a source. Raises InputError for an unknown name, or one that is no motion source."""
    kind: Any = MOTION_SOURCES[name]
    parts = (getattr(kind, part, None) for part in ("load", "inputs", "record", "seeds", "expected_cpu_s"))
    if not isinstance(kind, type) or not all(map(callable, parts)) or not isinstance(kind.sections, Mapping):
        raise InputError(f"motion source {name}: is no subclass of MotionSource; fix its package (docs/extending.md)")
    return kind


def motion_source(study: MotionStudy) -> MotionSource:
    """Return the motion source of a study. Raises InputError for an unknown name."""
    kind: Any = source_class(study.source)
    source: MotionSource = kind(**study.source_settings())
    return source
