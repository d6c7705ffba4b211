"""The dataset section of a study: every setting between a scenario and its samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import deepcopy
from typing import Annotated, Any, Self

from pydantic import AfterValidator, Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.sensing.chain import SensingSettings
from isac_cosim.isacsim.sensing.reports import ReportSettings
from isac_cosim.isacsim.traffic.drivers.director import ManeuverSettings
from isac_cosim.isacsim.traffic.motion import MotionSettings
from isac_cosim.isacsim.traffic.sources.kinematic_settings import KinematicSettings
from isac_cosim.isacsim.traffic.sources.registry import MOTION_SOURCES
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.samples.candidates import RecordSettings
from isac_cosim.labeling.samples.uv_choice import PairSettings


class SeedRange(Settings):
    """A range of traffic seeds, both ends included."""

    first: int = Field(1, ge=0, le=2**31 - 1)
    last: int = Field(20, ge=0, le=2**31 - 1)

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.last < self.first:
            raise ValueError(f"last ({self.last}) is below first ({self.first})")
        return self

    def __iter__(self) -> Iterator[int]:  # type: ignore[override]
        return iter(range(self.first, self.last + 1))

    def __len__(self) -> int:
        return self.last - self.first + 1


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

    scenarios: bundled names, folders, or SUMO configurations. source: name of the motion source.
    kinematics: of the source `kinematic`; stored only for that source.
    """

    scenarios: tuple[str, ...] = Field(("motorway",), min_length=1)
    seeds: SeedRange = SeedRange()
    source: Annotated[str, AfterValidator(MOTION_SOURCES.check)] = "sumo"
    traffic: TrafficSettings = TrafficSettings()
    maneuvers: ManeuverSettings = ManeuverSettings()
    kinematics: KinematicSettings = KinematicSettings()
    motion: MotionSettings = MotionSettings()
    labels: LabelSettings = LabelSettings()
    pairs: PairSettings = PairSettings()
    record: RecordSettings = RecordSettings()
    sensing: SensingSettings = SensingSettings()
    report: ReportSettings = ReportSettings()
    selection: SelectionSettings = SelectionSettings()

    @model_serializer(mode="wrap")
    def _without_unused_source(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        content: dict[str, Any] = serialize(self)
        if self.source != "kinematic":
            content.pop("kinematics", None)
        return content

    @property
    def unit(self) -> str:
        """What the progress bar of its generation counts."""
        return "samples" if self.selection.windows else "episodes"


FORMER: dict[tuple[str, ...], Any] = {
    ("traffic", "speed_wander"): {"sd_share": (0.0, 0.0)},
    ("maneuvers", "hard_brake", "rise_s"): (0.0, 0.0),
    ("maneuvers", "lane_change", "clear_s"): 0.0,
}
"""Settings that earlier versions did not have, with the values that make traffic as it was then: drivers held their
desired speed, commanded brakes came at once, and lane changes were commanded wherever there was a lane."""


def as_stored(study: Mapping[str, Any]) -> dict[str, Any]:
    """Return the dataset section of a study that a file holds, with what an earlier version did not store.

    A study that is stored has all settings of its version; those that it lacks are in `FORMER`.
    """
    filled = deepcopy(dict(study))
    for (*path, name), value in FORMER.items():
        section: Any = filled
        for key in path:
            section = section.get(key) if isinstance(section, dict) else None
        if isinstance(section, dict):
            section.setdefault(name, value)
    return filled
