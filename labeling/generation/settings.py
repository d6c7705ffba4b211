"""The dataset section of a study: every setting between a scenario and its samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from functools import cache
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    create_model,
    model_serializer,
    model_validator,
)

from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import Section, Settings, merged
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.sensing.chain import SensingSettings
from isac_cosim.isacsim.sensing.reports import ReportSettings
from isac_cosim.isacsim.traffic.drivers.settings import LEFT_ALONE, NATURAL
from isac_cosim.isacsim.traffic.motion import MotionSettings
from isac_cosim.isacsim.traffic.sources import DEFAULT
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource
from isac_cosim.isacsim.traffic.sources.registry import MOTION_SOURCES, OWN, source_class
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.samples.candidates import RecordSettings
from isac_cosim.labeling.samples.uv_choice import PairSettings


class SeedRange(Settings):
    """A range of traffic seeds, both ends included."""

    first: int = Field(1, ge=0, le=2**31 - 1, description="first seed")
    last: int = Field(20, ge=0, le=2**31 - 1, description="last seed")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.last < self.first:
            raise ValueError(f"last ({self.last}) is below first ({self.first})")
        return self

    @property
    def numbers(self) -> range:
        """The seeds."""
        return range(self.first, self.last + 1)

    def __iter__(self) -> Iterator[int]:  # type: ignore[override]
        return iter(self.numbers)

    def __len__(self) -> int:
        return len(self.numbers)

    def among(self, source: MotionSource, scenario: Scenario) -> Sequence[int]:
        """Return those of which a source has recordings of a scenario. Raises InputError if there are none."""
        there = source.seeds(scenario)
        if there is None:
            return self.numbers
        if not (seeds := [seed for seed in there if seed in self.numbers]):
            listed = f"{there[0]} to {there[-1]}" if there else "none"
            raise InputError(f"{scenario.name}: has no seed of {self.first}:{self.last}; it has {listed}; name others")
        return seeds


class SelectionSettings(Settings):
    """Which candidates become samples, and how many samples are enough.

    Episodes are used in the order of their seeds. The dataset ends with the first episode that completes `windows`
    samples, `min_per_class` of each of the six known intentions among them, or with the last seed.
    """

    per_class: int = Field(16, ge=1, le=1_000_000, description="most samples of each known intention from one episode")
    following: int = Field(8, ge=0, le=1_000_000, description="most `following` samples from one episode")
    pull_outs: int = Field(
        16,
        ge=0,
        le=1_000_000,
        description="most dropped pull-outs from one episode: they are in no class, but show whether the TV passes the "
        "UV; 0 stores none",
    )
    windows: int | None = Field(
        None, ge=1, le=1_000_000_000, description="samples to generate; every seed is used when absent"
    )
    min_per_class: int = Field(
        0, ge=0, le=1_000_000_000, description="samples to generate of each known intention, if windows is given"
    )
    patience: int = Field(20, ge=1, le=2**31 - 1, description="stop after this many episodes in a row without a sample")


class DatasetStudy(Settings):
    """All settings of a dataset. Equal studies give equal samples.

    scenarios: bundled names, folders, SUMO configurations, or what else the source reads; those that the source has for
    itself if absent. source: name of the motion source. Its settings are further sections, which `source_settings`
    returns and `of` finds by their class; those of other sources are checked and left out. world: the named values that
    settings of the source have where they are not given; the source's first world if absent, None in studies that were
    stored before there were names. All values are stored.
    """

    model_config = ConfigDict(extra="allow")

    scenarios: tuple[Annotated[str, Field(min_length=1)], ...] = Field(("motorway",), min_length=1)
    seeds: SeedRange = SeedRange()
    source: Annotated[str, AfterValidator(MOTION_SOURCES.check)] = DEFAULT
    world: str | None = None
    motion: MotionSettings = MotionSettings()
    labels: LabelSettings = LabelSettings()
    pairs: PairSettings = PairSettings()
    record: RecordSettings = RecordSettings()
    sensing: SensingSettings = SensingSettings()
    report: ReportSettings = ReportSettings()
    selection: SelectionSettings = SelectionSettings()

    @model_validator(mode="before")
    @classmethod
    def _complete_source(cls, content: Any) -> Any:
        """Check the sections of the source, and fill in what is absent."""
        if not isinstance(content, Mapping):
            return content
        fields = {key: value for key, value in content.items() if key in cls.model_fields}
        name = content.get("source", DEFAULT)
        if not isinstance(name, str) or name not in MOTION_SOURCES:
            return fields  # the check of `source` reports it
        kind = source_class(name)
        world = content.get("world", next(iter(kind.worlds), None))
        if not isinstance(world, str | None):
            return fields  # the check of `world` reports it
        if world is not None and world not in kind.worlds:
            raise ValueError(f"world: source {name} has no world {world!r}; choose one of {', '.join(kind.worlds)}")
        given = {key: value for key, value in content.items() if key not in fields}
        for section, values in kind.worlds[world].items() if world is not None else ():
            changes = given.get(section, {})
            given[section] = merged(values, changes) if isinstance(changes, Mapping) else changes
        sections = checked_sections(given, kind)
        if kind.own_scenarios:
            fields.setdefault("scenarios", kind.own_scenarios)
        fields.setdefault("seeds", dict(zip(("first", "last"), kind.default_seeds, strict=True)))
        return {**fields, "world": world, **sections}

    @model_serializer(mode="wrap")
    def _in_order(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Write the sections of the source behind its name."""
        content: dict[str, Any] = serialize(self)
        fields = list(type(self).model_fields)
        at = fields.index("world") + 1
        order = [*fields[:at], *self.source_settings(), *fields[at:]]
        return {key: content[key] for key in order if key in content}

    @classmethod
    def known_sections(cls) -> Mapping[str, type[Settings]]:
        """Return the sections besides the fields: those of this project's motion sources."""
        return {section: kind for source in OWN.values() for section, kind in source.sections.items()}

    def source_settings(self) -> dict[str, Settings]:
        """Return the settings of the motion source by section."""
        return dict(self.model_extra or {})

    def of(self, kind: type[Section]) -> Section:
        """Return the section of the source that has a settings class. Raises InputError if the source has none."""
        for settings in self.source_settings().values():
            if isinstance(settings, kind):
                return settings
        raise InputError(f"source {self.source}: has no settings of the kind {kind.__name__}")

    @property
    def unit(self) -> str:
        """What the progress bar of its generation counts."""
        return "samples" if self.selection.windows else "episodes"


def checked_sections(content: Mapping[str, object], kind: type[MotionSource]) -> dict[str, Settings]:
    """Return the sections of a source, as plain values or settings given by name; what is absent has its defaults.

    Raises ValidationError where one is wrong or belongs to no source, located at the key.
    """
    others = DatasetStudy.known_sections()
    for name in MOTION_SOURCES.keys() & content.keys():
        others = {**others, **source_class(name).sections}
    known = {**{name: others[name] for name in others.keys() & content.keys()}, **kind.sections}
    checked = _model_of(tuple(known.items())).model_validate(dict(content))
    return {name: getattr(checked, name) for name in kind.sections}


@cache
def _model_of(fields: tuple[tuple[str, type[Settings]], ...]) -> type[BaseModel]:
    """Return a settings class with a field for each section; unknown sections are refused."""
    # The annotation of a created model is that of any model; its fields are not known statically.
    return create_model("Sections", __base__=Settings, **{name: (kind, kind()) for name, kind in fields})  # type: ignore[call-overload,no-any-return]


FORMER: dict[tuple[str, ...], Any] = {
    ("traffic", "sway"): {"sd_m": (0.0, 0.0)},
    ("traffic", "speed_wander"): {"sd_share": (0.0, 0.0)},
    ("maneuvers", "hard_brake", "rise_s"): (0.0, 0.0),
    ("maneuvers", "lane_change", "clear_s"): 0.0,
    ("record", "across_mps2"): None,
}
"""Settings that earlier versions did not have, with the values that make samples as they were then: drivers held their
desired speed and the middle of their lane, commanded brakes came at once, lane changes were commanded wherever there
was a lane, and no road was too sharp."""


FORMER_WORLDS = frozenset({"kinematic-1"})
"""Worlds of earlier versions, of which a bundled scenario had its sites elsewhere; stored studies hold their values."""


def as_stored(study: Mapping[str, Any]) -> dict[str, Any]:
    """Return the dataset section of a study that a file holds, with what an earlier version did not store.

    A study that is stored has all settings of its version; those that it lacks are in `FORMER`, and its values have no
    name if it has none for them, or that of a former world. Maneuvers of version 0.2.0 were driven by fixed profiles,
    which no longer exist: they are kept, for a message, unless there were none.
    """
    filled = deepcopy(dict(study))
    if isinstance(filled.get("maneuvers"), dict) and "world" not in filled:
        filled["world"] = None
        if driven_by_profiles(filled) and not any(filled["maneuvers"].get(rate) for rate in LEFT_ALONE):
            filled |= {"world": NATURAL, "maneuvers": {}}
    if filled.get("world") in FORMER_WORLDS:
        filled["world"] = None
    for (*path, name), value in FORMER.items():
        section: Any = filled
        for key in path:
            section = section.get(key) if isinstance(section, dict) else None
        if isinstance(section, dict):
            section.setdefault(name, value)
    return filled


def driven_by_profiles(study: Mapping[str, Any]) -> bool:
    """Return whether a stored study is one of version 0.2.0, whose maneuvers had no driver."""
    return bool(study.get("maneuvers")) and "driver" not in study["maneuvers"]
