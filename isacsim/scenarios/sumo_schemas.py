"""What SUMO says of its own input: the elements and attributes of its schemas, and the types of its options.

Both are read once a process from the XML schemas that the installed eclipse-sumo package holds.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from isac_cosim.base.errors import RunError

SCHEMAS = ("net_file.xsd", "routes_file.xsd", "additional_file.xsd")
"""SUMO reads the elements of all three in each of its input files."""
OPTIONS = "types/sumoConfigurationType.xsd"
NOT_READ = "metadata.xsd"
"""Describes what a file's maker notes in it. SUMO reads nothing of that."""
OPTION_TYPE = "OptionType"
XSD = "{http://www.w3.org/2001/XMLSchema}"
TRUE, FALSE = ("1", "true", "yes", "on", "x", "t"), ("0", "false", "no", "off", "-", "f")
"""The words that SUMO takes for a BOOL, in any case."""
CLOCK = re.compile(r"-?(?:(?P<d>\d+):)?(?P<h>\d+):(?P<m>\d+):(?P<s>\d+(?:\.\d*)?)")
"""Times as a clock shows them: [days:]hours:minutes:seconds."""
NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")


@cache
def elements() -> Mapping[str, frozenset[str]]:
    """Return the names of the elements that SUMO reads, each with its attributes, wherever in a file it stands."""
    types: dict[str, ET.Element] = {}
    roots: list[ET.Element] = []
    for name in SCHEMAS:
        _collect(_folder() / name, types, roots, set())
    found: dict[str, set[str]] = defaultdict(set)
    done: set[tuple[str, str]] = set()

    def add(node: ET.Element, owner: str) -> None:
        """Add what a part of a schema says of the attributes of an element, and of the elements inside."""
        for part in node:
            if part.tag == f"{XSD}attribute":
                found[owner].add(part.attrib["name"])
            elif part.tag == f"{XSD}element":
                add_element(part)
            else:
                if part.tag == f"{XSD}extension":
                    add(types.get(part.attrib["base"], ET.Element("none")), owner)
                add(part, owner)

    def add_element(node: ET.Element) -> None:
        name, kind = node.attrib["name"], node.get("type", "")
        found[name].update()
        if kind in types and (name, kind) not in done:
            done.add((name, kind))
            add(types[kind], name)
        add(node, name)

    for root in roots:
        add_element(root)
    return {name: frozenset(attributes) for name, attributes in found.items()}


@cache
def root_names() -> frozenset[str]:
    """Return the names of root elements that only hold other elements."""
    roots: list[ET.Element] = []
    for name in SCHEMAS:
        _collect(_folder() / name, {}, roots, set())
    return frozenset(root.attrib["name"] for root in roots)


def _collect(schema: Path, types: dict[str, ET.Element], roots: list[ET.Element], done: set[Path]) -> None:
    """Collect the named types and the root elements of a schema and of those that it includes."""
    if schema in done or schema.name == NOT_READ:
        return
    done.add(schema)
    for node in _root(schema):
        if node.tag == f"{XSD}include":
            _collect((schema.parent / node.attrib["schemaLocation"]).resolve(), types, roots, done)
        elif node.tag == f"{XSD}complexType":
            types[node.attrib["name"]] = node
        elif node.tag == f"{XSD}element":
            roots.append(node)


@cache
def option_types() -> Mapping[str, str]:
    """Return the types of SUMO's options by name: bool, float, int, time, str, strArray or file."""
    return {
        node.attrib["name"]: node.attrib["type"].removesuffix(OPTION_TYPE)
        for node in _root(_folder() / OPTIONS).iter(f"{XSD}element")
        if node.attrib["type"].endswith(OPTION_TYPE)
    }


def fits(value: str, kind: str) -> bool:
    """Return whether SUMO takes a value for an option of a type."""
    match kind:
        case "bool":
            return value.lower() in (*TRUE, *FALSE)
        case "int":
            return re.fullmatch(r"[+-]?\d+", value) is not None
        case "float":
            return NUMBER.fullmatch(value) is not None
        case "time":
            return seconds(value) is not None
        case _:
            return True


def seconds(value: str) -> float | None:
    """Return a time as SUMO reads it, s: a number, or what a clock shows. None where it is neither."""
    if NUMBER.fullmatch(value):
        return float(value)
    if (clock := CLOCK.fullmatch(value)) is None:
        return None
    days, hours, minutes = (int(clock[part] or 0) for part in "dhm")
    return (-1.0 if value.startswith("-") else 1.0) * (86400 * days + 3600 * hours + 60 * minutes + float(clock["s"]))


def _folder() -> Path:
    import sumo  # of eclipse-sumo

    return (Path(sumo.SUMO_HOME) / "data" / "xsd").resolve()


def _root(schema: Path) -> ET.Element:
    """The root of one of SUMO's own schemas."""
    try:
        return ET.parse(schema).getroot()
    except (OSError, ET.ParseError) as error:
        raise RunError(f"SUMO's schema {schema} cannot be read ({error}): install eclipse-sumo again") from None
