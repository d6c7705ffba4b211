"""Reading SUMO's configurations: as SUMO reads them, file names and times included."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios import sumo_schemas
from isac_cosim.isacsim.scenarios.xml_files import XmlReader

SYNONYMS = {
    "net": "net-file", "n": "net-file", "routes": "route-files", "r": "route-files",
    "additional": "additional-files", "a": "additional-files", "b": "begin",
}  # fmt: skip
KEPT = (
    "scale",
    "ignore-route-errors",
    "no-internal-links",
    "ignore-junction-blocker",
    "max-depart-delay",
    "extrapolate-departpos",
    "pedestrian.model",
    "default.carfollowmodel",
    "default.departlane",
    "default.departspeed",
    "default.emergencydecel",
    "default.speeddev",
    "device.rerouting.probability",
    "device.rerouting.explicit",
    "device.rerouting.deterministic",
    "device.rerouting.period",
    "device.rerouting.pre-period",
    "device.rerouting.adaptation-interval",
    "device.rerouting.adaptation-steps",
    "device.rerouting.adaptation-weight",
    "lanechange.overtake-right",
    "max-num-vehicles",
    "routing-algorithm",
    "time-to-impatience",
    "tls.actuated.detector-length",
    "tls.actuated.jam-threshold",
    "tls.yellow.min-decel",
    "weights.minor-penalty",
    "weights.priority-factor",
    "weights.random-factor",
    "weights.tls-penalty",
    "eager-insert",
    "emergency-insert",
    "sloppy-insert",
    "random-depart-offset",
    "emergencydecel.warning-threshold",
    "collision.mingap-factor",
)
"""Options of a user's configuration that shape the traffic, and are passed to SUMO."""
MOST_BYTES = 16e6
"""Of a configuration."""
KINDS = {
    "bool": "true or false", "int": "a whole number", "float": "a number",
    "time": "a time from 0 on: give it in seconds, or as hours:minutes:seconds",
}  # fmt: skip


@dataclass(frozen=True)
class Inputs:
    """What is read from a configuration.

    begin_s: simulation time at which the scenario starts, s. kept: options that are passed to SUMO, by name.
    overridden: names of options that are set otherwise or left out.
    """

    network: Path
    demand: tuple[Path, ...]
    additional: tuple[Path, ...]
    begin_s: float
    kept: dict[str, str]
    overridden: tuple[str, ...]


def read_config(config: Path) -> Inputs:
    """Read a SUMO configuration.

    Raises InputError where it cannot be read, names no network or a file that does not exist, or gives an option that
    is passed to SUMO a value of another type.
    """
    options = _options(config)

    def files(option: str) -> tuple[Path, ...]:
        paths = tuple(config.parent / _decoded(name) for name in _names(options.pop(option, "")))
        for path in paths:
            if not path.is_file():
                raise InputError(f"{config} names {path.name}, which does not exist: add the file or remove its name")
        return paths

    networks, demand, additional = files("net-file"), files("route-files"), files("additional-files")
    if len(networks) != 1:
        raise InputError(f"{config} names {len(networks)} networks: give it exactly one <net-file value=…/>")
    begin = options.pop("begin", "0")
    begin_s = sumo_schemas.seconds(begin)
    if begin_s is None or begin_s < 0.0:
        raise InputError(f"{config}: begin = {begin!r} is not {KINDS['time']}")
    kept = {name: options.pop(name) for name in KEPT if name in options}
    for name, value in kept.items():
        kind = sumo_schemas.option_types().get(name, "str")
        if not sumo_schemas.fits(value, kind):
            raise InputError(f"{config}: {name} = {value[:60]!r} is not {KINDS[kind]}: fix or remove the option")
    return Inputs(networks[0], demand, additional, begin_s, kept, tuple(sorted(options)))


def _options(config: Path) -> dict[str, str]:
    """The options of a configuration: their values are in an attribute, or the text of their element."""
    texts: list[str] = []
    options: dict[str, str] = {}
    nodes = list(XmlReader(config, MOST_BYTES, texts).elements())
    for node, text in zip(nodes, texts, strict=True):
        name = SYNONYMS.get(node.name, node.name)
        value = node.attributes.get("value", "") or node.attributes.get("v", "") or text.strip()
        if not value:
            continue
        if name in options:
            raise InputError(f"{config} sets {name} twice, which SUMO refuses: remove one")
        options[name] = _substituted(value)
    return {name: value for name, value in options.items() if value}


def _substituted(value: str) -> str:
    """Return a value as SUMO reads it: `${NAME}` is the environment's variable of that name, or nothing."""
    return re.sub(r"\$\{(.+?)\}", lambda found: os.environ.get(found[1], ""), value)


def _names(value: str) -> list[str]:
    """The names of a list of files; there is no way to name one that holds a comma."""
    return [name for name in map(str.strip, value.split(",")) if name]


def _decoded(name: str) -> str:
    """Return a file's name as SUMO reads it, `%20` as a blank. Nothing is decoded where a `%` begins no such code."""
    if re.search(r"%(?![0-9A-Fa-f]{2})", name):
        return name
    return unquote(name, errors="surrogateescape")


def encoded(name: str) -> str:
    """Return a file's name as a configuration has to name it. Raises InputError where it cannot be named."""
    if "," in name:
        raise InputError(f"SUMO cannot name {name}, because of the comma: rename the folder or file")
    return re.sub(r"[%$]|^\s|\s$", lambda found: f"%{ord(found[0]):02X}", name)
