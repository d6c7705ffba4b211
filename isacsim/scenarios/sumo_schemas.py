"""What SUMO says of its own input: the elements and attributes of its schemas, and the types of its options.

Both are read once a process from the XML schemas that the installed eclipse-sumo package holds.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Mapping
from decimal import Decimal
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
CLOCK_S = {3: (3600.0, 60.0, 1.0), 4: (86_400.0, 3600.0, 60.0, 1.0)}
"""Seconds of each part of a time as a clock shows it: [days:]hours:minutes:seconds, by the number of parts."""
NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")


@cache
def known_elements() -> Mapping[str, frozenset[str]]:
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
    """Return a time as SUMO reads it, s: a number, or what a clock shows. None where it is neither.

    Every part of a clock's time is a number for SUMO, and may have decimals.

    >>> seconds("90.5"), seconds("01:00:00"), seconds("1:2:3:4.5"), seconds("1.5:0:0"), seconds("1:00")
    (90.5, 3600.0, 93784.5, 5400.0, None)
    """
    if NUMBER.fullmatch(value):
        return float(value)
    sign, shown = (-1.0, value[1:]) if value.startswith("-") else (1.0, value)
    parts = shown.split(":")
    if len(parts) not in CLOCK_S or not all(map(NUMBER.fullmatch, parts)):
        return None
    return sign * sum(unit * float(part) for unit, part in zip(CLOCK_S[len(parts)], parts, strict=True))


def in_full(number: float) -> str:
    """Return a number with all its digits and without an exponent, so that reading it gives the same number.

    >>> in_full(1000003.0), in_full(123456.75), in_full(1e-7), in_full(0.1)
    ('1000003', '123456.75', '0.0000001', '0.1')
    """
    return format(Decimal(repr(float(number))), "f").removesuffix(".0")


def _folder() -> Path:
    import sumo  # of eclipse-sumo

    return (Path(sumo.SUMO_HOME) / "data" / "xsd").resolve()


def _root(schema: Path) -> ET.Element:
    """The root of one of SUMO's own schemas."""
    try:
        return ET.parse(schema).getroot()
    except (OSError, ET.ParseError) as error:
        raise RunError(f"SUMO's schema {schema} cannot be read ({error}): install eclipse-sumo again") from None
