"""The dataset part of a study: every setting between a scenario and its samples, and how study files are read."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, Self

from pydantic import Field, model_validator

from isacsim.sensing import SensingSettings
from isacsim.settings import Settings
from isacsim.traffic.director import ManeuverSettings
from isacsim.traffic.motion import MotionSettings
from isacsim.traffic.simulation import TrafficSettings
from labeling.events import LabelSettings
from labeling.samples.candidates import RecordSettings
from labeling.samples.uv_choice import PairSettings


class SeedRange(Settings):
    """Traffic seeds, both ends included."""

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
    """Which candidates become samples, and when there are enough of them.

    Episodes are taken in the order of their seeds. The dataset is the shortest run of them that holds `windows` samples
    and `min_per_class` of each of the six known intentions, or all of them.
    """

    per_class: int = Field(16, ge=1, description="most samples of one known intention from one episode")
    following: int = Field(8, ge=0, description="most `following` samples from one episode")
    windows: int | None = Field(None, ge=1, description="samples to reach; absent: every seed of the range is used")
    min_per_class: int = Field(0, ge=0, description="samples of each known intention to reach, when windows is given")
    patience: int = Field(20, ge=1, description="give up after this many episodes in a row without a sample")


class ReportSettings(Settings):
    """How well the UV knows its own state: standard deviations of white Gaussian noise on what it reports."""

    position_sd_m: float = Field(0.0, ge=0.0, le=100.0)
    speed_sd_mps: float = Field(0.0, ge=0.0, le=100.0)
    acceleration_sd_mps2: float = Field(0.0, ge=0.0, le=100.0)


class DatasetStudy(Settings):
    """Everything that makes a dataset: equal studies give equal samples.

    scenarios: bundled names, folders, or SUMO configurations. source: where motion comes from.
    """

    scenarios: tuple[str, ...] = Field(("motorway",), min_length=1)
    seeds: SeedRange = SeedRange()
    source: Literal["sumo"] = "sumo"
    traffic: TrafficSettings = TrafficSettings()
    maneuvers: ManeuverSettings = ManeuverSettings()
    motion: MotionSettings = MotionSettings()
    labels: LabelSettings = LabelSettings()
    pairs: PairSettings = PairSettings()
    record: RecordSettings = RecordSettings()
    sensing: SensingSettings = SensingSettings()
    report: ReportSettings = ReportSettings()
    selection: SelectionSettings = SelectionSettings()

    @property
    def unit(self) -> str:
        """What the progress of its generation counts."""
        return "samples" if self.selection.windows else "episodes"
