"""The definitions of a study: the settings of the built-in detectors, and the detectors that it selects besides."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

from pydantic import (
    Field,
    SerializeAsAny,
    SerializerFunctionWrapHandler,
    ValidationError,
    field_validator,
    model_serializer,
    model_validator,
)

from isac_cosim.base.settings import Settings
from isac_cosim.labeling.detectors.evasive_swerve import EvasiveSwerveSettings
from isac_cosim.labeling.detectors.following import FollowingSettings
from isac_cosim.labeling.detectors.hard_accel import HardAccelSettings
from isac_cosim.labeling.detectors.hard_brake import HardBrakeSettings
from isac_cosim.labeling.detectors.lane_change import LaneChangeSettings
from isac_cosim.labeling.detectors.overtake import OvertakeSettings
from isac_cosim.labeling.detectors.protocol import Detector
from isac_cosim.labeling.detectors.registry import DETECTORS
from isac_cosim.labeling.intentions import Intention
from isac_cosim.labeling.road.road_motion import WIDTH_S

PRESET = "isac-2"
"""Name and version of the default definitions. Other defaults need another name."""
FORMER: dict[str, dict[str, dict[str, float | None]]] = {
    "isac-1": {"following": {"before_s": 2.6, "after_s": 2.4, "lateral_mps": None, "acceleration_mps2": None}}
}
"""Earlier default definitions by name: for each section what differed from today's."""
VARIANTS: dict[str, dict[str, dict[str, Any]]] = {
    f"{PRESET}-as-seen": {"overtake": {"judged": "track"}},
    f"{PRESET}-one-change": {"overtake": {"judged": "never"}},
}
"""Definitions for tracks that are shorter than what a label needs, by name: what differs from today's."""
UNSTORED = {"isac-1": {"following": ("lateral_mps", "acceleration_mps2")}}
"""Settings that earlier definitions did not have: left out where those are stored, so that they read as ever."""

NAMED: dict[str, dict[str, dict[str, Any]]] = {**FORMER, **VARIANTS}
JUDGED = OvertakeSettings().judged


class LabelSettings(Settings):
    """What counts as each intention.

    preset: names this set of values; other values need another name. A name in `FORMER` stands for the values that it
    had, in datasets made with it as in new studies, and one in `VARIANTS` for its own. width_s: part of the
    definitions, because the thresholds apply to motion smoothed with this kernel. Sensed motion may be conditioned with
    another one (`isacsim.traffic.motion.MotionSettings`); the events stay the same.
    One section for each built-in detector, under its name. detectors: further detectors that the study selects, each
    with its settings; every one replaces the built-in definition of the intentions that it finds (see
    `labeling.detectors.protocol.Detector`). Stored only where it is not empty.
    """

    preset: str = Field(PRESET, min_length=1, description="name and version of these definitions")
    width_s: float = Field(WIDTH_S, gt=0.0, le=1.0, description="standard deviation of the conditioning kernel, s")
    lane_change: LaneChangeSettings = LaneChangeSettings()
    overtake: OvertakeSettings = OvertakeSettings()
    hard_brake: HardBrakeSettings = HardBrakeSettings()
    hard_accel: HardAccelSettings = HardAccelSettings()
    evasive_swerve: EvasiveSwerveSettings = EvasiveSwerveSettings()
    following: FollowingSettings = FollowingSettings()
    detectors: dict[str, SerializeAsAny[Settings]] = Field({}, description="detectors to use besides the built-in ones")

    @property
    def replaced(self) -> frozenset[Intention]:
        """The intentions whose built-in definition is replaced by a selected detector."""
        return frozenset(intention for name in self.detectors for intention in DETECTORS[name].finds)

    def active_detectors(self) -> dict[str, Detector]:
        """Return the detectors of this study by name, in the order in which they run.

        A built-in detector whose intentions are all replaced is absent. Those that find `following` come last.
        """
        sections = {name: getattr(self, name) for name in DETECTORS if name in type(self).model_fields}
        sections = {
            name: section for name, section in sections.items() if not self.replaced.issuperset(DETECTORS[name].finds)
        }
        sections |= {name: self.detectors[name] for name in DETECTORS if name in self.detectors}
        in_order = sorted(sections, key=lambda name: Intention.FOLLOWING in DETECTORS[name].finds)
        return {name: DETECTORS[name](sections[name]) for name in in_order}

    @property
    def limits_mps2(self) -> dict[str, float]:
        """Thresholds that a vehicle type's limits of the same name may sit at, m/s2."""
        return {"accel": self.hard_accel.threshold_mps2, "decel": self.hard_brake.threshold_mps2}

    @field_validator("detectors", mode="before")
    @classmethod
    def _read_selected(cls, value: object) -> object:
        if not isinstance(value, Mapping):
            return value
        return {name: _read_section(cls, name, section) for name, section in value.items()}

    @model_validator(mode="after")
    def _one_definition_each(self) -> Self:
        found_by: dict[Intention, str] = {}
        for name in self.detectors:
            for intention in DETECTORS[name].finds:
                if intention in found_by:
                    raise ValueError(
                        f"detectors {found_by[intention]} and {name} both find {intention.text}; select one of them"
                    )
                found_by[intention] = name
        return self

    @model_validator(mode="before")
    @classmethod
    def _read_former(cls, content: Any) -> Any:
        preset = content.get("preset") if isinstance(content, Mapping) else None
        if not isinstance(preset, str) or preset not in NAMED:
            return content
        former = dict(content)
        for name, values in NAMED[preset].items():
            section = content.get(name, {})
            if isinstance(section, Mapping):
                former[name] = {**values, **section}
        return former

    @model_validator(mode="after")
    def _named_apart(self) -> Self:
        if self.preset != PRESET and self.preset not in NAMED:
            return self
        for name, field in type(self).model_fields.items():
            values = NAMED.get(self.preset, {}).get(name)
            expected = field.default if values is None else field.default.model_copy(update=values)
            if name != "preset" and getattr(self, name) != expected:
                raise ValueError(
                    f"{name} differs from preset {self.preset}; give these definitions a preset name of their own"
                )
        return self

    @model_serializer(mode="wrap")
    def _without_empty_selection(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        content: dict[str, Any] = serialize(self)
        if not self.detectors:
            content.pop("detectors", None)
        if self.overtake.judged == JUDGED:
            content.get("overtake", {}).pop("judged", None)  # which earlier versions did not have
        for name, settings in UNSTORED.get(self.preset, {}).items():
            for setting in settings:
                content[name].pop(setting, None)
        return content


def _read_section(labels: type[LabelSettings], name: str, section: object) -> Settings:
    """Return the settings of a selected detector. Raises ValueError for an unsuitable detector or wrong settings."""
    DETECTORS.check(name)
    if name in labels.model_fields:
        raise ValueError(f"{name} is built in and always selected; its settings are in labels.{name}")
    detector = DETECTORS[name]
    if not _is_detector(detector):
        raise ValueError(f"{name} is not a detector class with settings_type, finds and detect; fix its package")
    try:
        return detector.settings_type.model_validate(section)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        raise ValueError(f"{'.'.join(map(str, (name, *fault['loc'])))}: {fault['msg']}") from None


def _is_detector(item: object) -> bool:
    """Return whether an entry point of another package offers what `Detector` asks for."""
    settings_type, finds = getattr(item, "settings_type", None), getattr(item, "finds", ())
    return (
        isinstance(item, type)
        and isinstance(settings_type, type)
        and issubclass(settings_type, Settings)
        and isinstance(finds, tuple)
        and len(finds) > 0
        and all(isinstance(intention, Intention) for intention in finds)
        and callable(getattr(item, "detect", None))
    )
