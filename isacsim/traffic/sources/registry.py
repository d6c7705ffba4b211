"""Motion sources by name: those of this project, and those that installed packages offer. A study names one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

from isac_cosim.base.errors import InputError
from isac_cosim.base.registry import Registry
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.sources import DEFAULT
from isac_cosim.isacsim.traffic.sources.fcd import FcdSource
from isac_cosim.isacsim.traffic.sources.kinematic import KinematicSource
from isac_cosim.isacsim.traffic.sources.levelx import LevelxSource
from isac_cosim.isacsim.traffic.sources.ngsim import NgsimSource
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource, RunningSource
from isac_cosim.isacsim.traffic.sources.simulated import SumoSource

OWN: Mapping[str, type[MotionSource]] = {
    "sumo": SumoSource, "kinematic": KinematicSource, "fcd": FcdSource, "levelx": LevelxSource,
    "ngsim": NgsimSource,
}  # fmt: skip
"""The motion sources of this project."""
MOTION_SOURCES: Registry[type[MotionSource]] = Registry("motion source", OWN, group="isac_cosim.motion_sources")
"""Classes of motion sources, by the name that a study gives as `source`."""
SUMO_FILES = (".sumocfg", ".net.xml", ".net.xml.gz")


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
    if not (isinstance(kind, type) and MotionSource in kind.__mro__):
        raise InputError(f"motion source {name}: is no subclass of MotionSource; fix its package (docs/extending.md)")
    return kind


def natural_world(name: str, option: str = "--natural") -> str:
    """Return the world of a source in which drivers are left alone.

    Raises InputError where it has none. option: of the command line that asks for it.
    """
    world = source_class(name).natural
    if world is None:
        raise InputError(f"{option}: source {name} has no world in which drivers are left alone; leave it out")
    return world


def recognised(scenarios: Sequence[str]) -> str:
    """Return the name of the source that reads what the user named; `DEFAULT` where none knows it for its own.

    Raises InputError where some are files of one source, and some are not.
    """
    sources = {where: _recognised(Path(where)) for where in scenarios}
    if len({*sources.values()}) > 1:
        told = ", ".join(f"{where} ({source})" for where, source in sources.items())
        raise InputError(f"{told:.300}: are of different sources; make a dataset of each, or name one by --source")
    return next(iter(sources.values()), DEFAULT)


def _recognised(where: Path) -> str:
    if where.is_file() and not where.name.endswith(SUMO_FILES):
        for name in MOTION_SOURCES:
            with suppress(InputError):  # a file that cannot be read is known by none
                if source_class(name).recognises(where):
                    return name
    return DEFAULT


def motion_source(study: MotionStudy) -> MotionSource:
    """Return the motion source of a study. Raises InputError for an unknown name."""
    kind: Any = source_class(study.source)
    source: MotionSource = kind(**study.source_settings())
    return source


def running_source(study: MotionStudy) -> RunningSource:
    """Return the motion source of a study. Raises InputError where it only has recordings."""
    source = motion_source(study)
    if not isinstance(source, RunningSource):
        raise InputError(
            f"source {study.source}: has recordings only, and a closed loop needs a world that runs: leave out the "
            "advisories, or name another source"
        )
    return source
