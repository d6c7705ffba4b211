"""The vehicle types of a demand: what their limits do to labels, and our drivers in their place.

A type of SUMO's defaults is one driver many times over: every natural hard brake then peaks at its `decel`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import quoteattr

from isac_cosim.base.seeding import stream
from isac_cosim.isacsim.scenarios.demand import drivers
from isac_cosim.isacsim.scenarios.sumo_files import TYPES, content, with_includes
from isac_cosim.isacsim.scenarios.xml_files import Element, elements

CARS = frozenset({"passenger", "private", "taxi", "hov", "evehicle", "delivery", "ignoring"})
TRUCKS = frozenset({"truck", "trailer"})
"""Vehicle classes of cars and of trucks. What else drives keeps its drivers."""
DEFAULT_CLASS, DEFAULT_TYPE = "passenger", "DEFAULT_VEHTYPE"
"""What a type is of that names no class, and the type of a vehicle that names none."""
DEFAULT_LIMITS = {"cars": {"accel": 2.6, "decel": 4.5}, "trucks": {"accel": 1.3, "decel": 4.0}}
"""What SUMO takes for a type that does not say, m/s2."""
KEPT = frozenset({
    "id", "vClass", "length", "width", "height", "color", "guiShape", "imgFile", "osgFile", "emissionClass", "mass",
    "personCapacity", "containerCapacity", "boardingDuration", "loadingDuration", "probability", "parkingBadges",
    "scale", "insertionChecks", "departEdge",
})  # fmt: skip
"""Attributes of a type that say what vehicle it is. The others say how it is driven."""
OWN = frozenset({"id", "vClass", "length", "width", "probability"})
"""Attributes of our types that are not taken over."""
VARIANTS = 20
"""Drivers that a type becomes."""
NEAR = 0.15
"""A limit within this share of a threshold sits at it."""
MOST_SHARE = 2 / 3
"""A larger share of types at a threshold is reported. Our own drivers differ; up to half of them are near one."""
MOST_NAMED = 3


def kind_of(vehicle_class: str) -> str | None:
    """Return `cars` or `trucks`, None for other vehicles."""
    return "cars" if vehicle_class in CARS else "trucks" if vehicle_class in TRUCKS else None


def limits_at_thresholds(files: Iterable[Path], thresholds: Mapping[str, float]) -> list[str]:
    """Return what to say of a demand whose cars and trucks have a limit at a threshold of the labels, a line each.

    files: of the demand and additional ones, with those that they include. thresholds: m/s2, of `accel` and `decel`.
    Where no type is defined, SUMO's own default type is meant.
    """
    found: dict[str, dict[str, float]] = {}
    for file in (part for named in files for part in with_includes(named)):
        if not content(file).names & TYPES:
            continue
        for _, name, attributes in elements(file):
            kind = kind_of(attributes.get("vClass", DEFAULT_CLASS)) if name == "vType" else None
            if kind is not None:
                found[attributes.get("id", "")] = {
                    limit: _number(attributes.get(limit), default) for limit, default in DEFAULT_LIMITS[kind].items()
                }
    types = found or {DEFAULT_TYPE: DEFAULT_LIMITS["cars"]}
    lines = []
    for limit, threshold in thresholds.items():
        near = [name for name, limits in types.items() if abs(limits[limit] - threshold) <= NEAR * threshold]
        if len(near) <= MOST_SHARE * len(types):
            continue
        values = sorted({types[name][limit] for name in near})
        spread = f"{values[0]:g}" if len(values) == 1 else f"{values[0]:g} to {values[-1]:g}"
        named = ", ".join(near[:MOST_NAMED]) + (", ..." if len(near) > MOST_NAMED else "")
        lines.append(
            f"{len(near)} of {len(types)} types of cars and trucks ({named}) have {limit} = {spread} m/s2, "
            f"{len(values)} value{'s' if len(values) > 1 else ''}, at the label threshold of {threshold:g} m/s2: "
            f"natural events all peak there; --drivers ours (dataset.traffic.drivers) gives them drivers that differ"
        )
    return lines


def _number(text: str | None, default: float) -> float:
    try:
        return default if text is None else float(text)
    except ValueError:
        return default


@dataclass
class OurDrivers:
    """Replaces how the cars and trucks of a demand are driven by our own drivers, in what SUMO gets of its files.

    Each type becomes a distribution of VARIANTS types of the same id, which keep class, size and looks. Within a
    distribution, it becomes as many types there, the first of which keeps the id. Vehicles without a type get our cars.
    keys: name the draw; equal keys give equal drivers.
    """

    keys: tuple[str | int, ...]
    _made: dict[str, list[str]] = field(default_factory=dict)
    _defined: set[str] = field(default_factory=set)

    def replaced(self, begun: Iterable[Element]) -> Iterator[Element]:
        """Yield the elements of a file with our drivers in place of its own; files in the order in which SUMO reads."""
        pending: list[Element] = []  # a type that is replaced, and what is in it
        inside: int | None = None  # the depth of the distribution that is being read
        for element in begun:
            depth, name, attributes = element
            if pending and depth > pending[0].depth:
                pending.append(element)
                continue
            yield from self._variants(pending, inside is not None)
            pending = []
            if inside is not None and depth <= inside:
                inside = None
            if name in TYPES:
                self._defined.add(attributes.get("id", ""))
            if name == "vTypeDistribution":
                inside = depth
                yield Element(depth, name, self._with_made(attributes))
            elif name == "vType" and kind_of(attributes.get("vClass", DEFAULT_CLASS)):
                pending = [element]
            else:
                yield element
        yield from self._variants(pending, inside is not None)

    def default_type(self) -> str | None:
        """Return the content of an additional file that gives vehicles without a type our drivers.

        Call it once all files are replaced; it is None where they define that type themselves.
        """
        if DEFAULT_TYPE in self._defined:
            return None
        replaced = self.replaced([Element(0, "additional", {}), Element(1, "vType", {"id": DEFAULT_TYPE})])
        lines = [
            f"<{name}{''.join(f' {key}={quoteattr(text)}' for key, text in attributes.items())}{'/' * (depth == 2)}>"
            for depth, name, attributes in replaced
        ]
        return "\n".join([*lines, "</vTypeDistribution>", "</additional>", ""])

    def _variants(self, pending: list[Element], in_distribution: bool) -> Iterator[Element]:
        """Yield the types that replace one. pending: the type, and what is in it."""
        if not pending:
            return
        (depth, _, attributes), within = pending[0], pending[1:]
        kept = {name: text for name, text in attributes.items() if name in KEPT}
        name, kind = attributes.get("id", ""), kind_of(attributes.get("vClass", DEFAULT_CLASS))
        if not in_distribution:
            yield Element(depth, "vTypeDistribution", {"id": name})
            depth += 1
        share = _number(attributes.get("probability"), 1.0) / VARIANTS
        ids = [name if in_distribution and k == 0 else f"{name}-{k}" for k in range(VARIANTS)]
        self._made[name] = ids
        for variant, driven in zip(ids, self._drawn(name, kind == "trucks"), strict=True):
            yield Element(depth, "vType", {**kept, **driven, "id": variant, "probability": f"{share:.9f}"})
            # Sections of a car-following or lane-changing model describe how it was driven.
            nested = depth - pending[0].depth
            yield from (part._replace(depth=part.depth + nested) for part in within if part.name == "param")

    def _drawn(self, name: str, trucks: bool) -> list[dict[str, str]]:
        """Return the attributes of VARIANTS of our drivers, for the type of a name."""
        lines = drivers(stream("drivers", *self.keys, name), cars=VARIANTS, trucks=VARIANTS)
        types = ElementTree.fromstring(f"<all>{''.join(lines)}</all>")[1 if trucks else 0]
        return [{key: text for key, text in one.attrib.items() if key not in OWN} for one in types]

    def _with_made(self, attributes: dict[str, str]) -> dict[str, str]:
        """Return the attributes of a distribution, with the types that others became in place of those it names."""
        named = attributes.get("vTypes", "").split()
        if not self._made.keys() & set(named):
            return attributes
        shares = [_number(text, 1.0) for text in attributes.get("probabilities", "").split()] or [1.0] * len(named)
        parts = [(self._made.get(name, [name]), share) for name, share in zip(named, shares, strict=False)]
        return {
            **attributes,
            "vTypes": " ".join(variant for variants, _ in parts for variant in variants),
            "probabilities": " ".join(f"{share / len(variants):.9f}" for variants, share in parts for _ in variants),
        }
