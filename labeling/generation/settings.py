"""The dataset part of a study: every setting between a scenario and its samples, and how study files are read."""

from __future__ import annotations

import reprlib
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

from pydantic import AfterValidator, Field, ValidationError, model_validator

from isacsim.errors import InputError
from isacsim.sensing import SensingSettings
from isacsim.settings import Settings
from isacsim.traffic.director import ManeuverSettings
from isacsim.traffic.motion import MotionSettings
from isacsim.traffic.motion_sources import MOTION_SOURCES
from isacsim.traffic.simulation import TrafficSettings
from labeling.detectors.settings import LabelSettings
from labeling.samples.candidates import RecordSettings
from labeling.samples.uv_choice import PairSettings

MOST_BYTES = 100_000
"""Of a study file."""
Section = TypeVar("Section", bound=Settings)


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
    """How well the UV knows its own state: white Gaussian noise on each axis of what it reports.

    The defaults are those of a UV with satellite positioning corrected in real time (RTK) and an inertial sensor:
    position and speed as data sheets of two-band RTK receivers such as u-blox' ZED-F9P give them (0.01 m and 1 ppm of
    the distance to the reference station; 0.05 m/s), acceleration as the step in which cooperative awareness messages
    report it (ETSI TS 102 894-2, 0.1 m/s2).
    """

    position_sd_m: float = Field(0.02, ge=0.0, le=100.0, description="standard deviation of x and of y")
    speed_sd_mps: float = Field(0.05, ge=0.0, le=100.0, description="standard deviation of vx and of vy")
    acceleration_sd_mps2: float = Field(0.1, ge=0.0, le=100.0, description="standard deviation of ax and of ay")


class DatasetStudy(Settings):
    """Everything that makes a dataset: equal studies give equal samples.

    scenarios: bundled names, folders, or SUMO configurations. source: name of the motion source.
    """

    scenarios: tuple[str, ...] = Field(("motorway",), min_length=1)
    seeds: SeedRange = SeedRange()
    source: Annotated[str, AfterValidator(MOTION_SOURCES.check)] = "sumo"
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


def read_toml(path: Path) -> dict[str, Any]:
    """A TOML file's content. Raises InputError where there is none or it cannot be read."""
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        if len(content) > MOST_BYTES:
            raise InputError(f"{path}: has more than {MOST_BYTES} bytes, which no study needs; give a study file")
        return tomllib.loads(content.decode())
    except FileNotFoundError:
        raise InputError(f"{path}: no such study file; give the path of a .toml file") from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"{path}: not a readable TOML file ({_one_line(error)})") from None


def checked(kind: type[Section], content: dict[str, Any], where: str | Path) -> Section:
    """Settings from plain values. Raises InputError naming the first wrong key by its path, and `where` it stands."""
    try:
        return kind.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{where}: {_first_fault(error)}") from None


def _first_fault(error: ValidationError) -> str:
    """The first fault of a validation, as one line: the key's path, what is wrong, and the value found."""
    fault = error.errors(include_url=False)[0]
    key = ".".join(map(str, fault["loc"])) or "study"
    if fault["type"] == "extra_forbidden":
        return f"{key}: unknown key; remove it or mend its spelling"
    message = fault["msg"].removeprefix("Value error, ")
    found = fault["input"]
    return f"{key}: {message}" if isinstance(found, dict) else f"{key}: {message}, not {reprlib.repr(found)}"


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
