"""The axes of a sweep, and the cells between them.

A cell is one network, one way of sensing and one predictor, trained once with every training seed.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, ValidationError, model_validator

from command_line.arguments import channel
from isacsim.errors import InputError
from isacsim.radio.channel import ChannelSettings
from isacsim.scenarios.sumo_files import CONFIG_ENDINGS, NETWORK_ENDINGS
from isacsim.settings import Settings
from isacsim.validation import first_fault
from models.run import Model

Sensor = Literal["isac", "radar", "truth"]


def _channel_of(text: str) -> str:
    """Checks that an SNR is one; pydantic tells the ValueError with the key's path."""
    try:
        ChannelSettings.model_validate(channel(text, "snr"))
    except InputError as error:
        raise ValueError(str(error)) from None
    except ValidationError as error:
        raise ValueError(first_fault(error, ChannelSettings)) from None
    return text


class SweepAxes(Settings):
    """What a study varies. Where an axis is absent, the study's own value is taken."""

    scenarios: tuple[str, ...] = Field((), description="networks, each with a dataset of its own")
    snr: tuple[Annotated[str, AfterValidator(_channel_of)], ...] = Field(
        (), description="per-element SNR of the sites, dB: LO:HI, one value, or link, as `cosim sense --snr` takes it"
    )
    sensors: tuple[Sensor, ...] = Field(
        ("isac",), min_length=1, description="the sites, at every SNR; the UV's own radar; neither: the true state"
    )
    models: tuple[Model, ...] = Field((), description="predictors; trees are always among them, as the floor")
    training_seeds: tuple[int, ...] = Field((), description="seeds of training; the table has mean and spread of them")
    test_on: tuple[str, ...] = Field((), description="networks that predictors of the others are tested on as well")

    @model_validator(mode="after")
    def _sound(self) -> Self:
        for axis, values in (*_values(self), ("scenarios", [network_name(each) for each in self.scenarios])):
            if twice := [each for each, times in Counter(values).items() if times > 1]:
                raise ValueError(f"{axis} has {twice[0]} twice: take one out, or rename it")
        if self.snr and "isac" not in self.sensors:
            raise ValueError("snr is of the sites: add isac to sensors, or take snr out")
        if foreign := [each for each in self.test_on if each not in self.scenarios]:
            raise ValueError(f"test_on names {foreign[0]}, which is not among scenarios: add it there")
        return self


@dataclass(frozen=True)
class Sensing:
    """What senses, and for the sites the SNR, as `cosim sense --snr` takes it; None is the study's own channel."""

    sensor: Sensor
    snr: str | None = None

    @property
    def name(self) -> str:
        """As part of a file's name."""
        return self.sensor if self.snr is None else f"{self.sensor}_{self.snr.replace(':', 'to')}"

    def __str__(self) -> str:
        if self.snr is None:
            return self.sensor
        return f"{self.sensor} {self.snr}" + ("" if self.snr == "link" else " dB")


@dataclass(frozen=True)
class Cell:
    """One network, by its short name, one way of sensing, one predictor."""

    network: str
    sensing: Sensing
    model: Model

    @property
    def path(self) -> Path:
        """Of its folder, below that of all cells."""
        return Path(self.network, self.sensing.name, self.model)

    def __str__(self) -> str:
        return f"{self.network}, {self.sensing}, {self.model}"


def sensings(axes: SweepAxes) -> list[Sensing]:
    """The ways of sensing; the SNR is the sites', so radar and truth are one each."""
    return [
        Sensing(sensor, snr)
        for sensor in axes.sensors
        for snr in ((axes.snr or (None,)) if sensor == "isac" else (None,))
    ]


def network_name(where: str) -> str:
    """Short name of a scenario as a study names it, fit for a file: of its folder or file, without the ending."""
    path = Path(where)
    # What is no path at all (it has a null character) does not exist, and is told where it is read.
    name = (path.resolve() if path.exists() else path).name
    for ending in (*CONFIG_ENDINGS, *NETWORK_ENDINGS):
        name = name.removesuffix(ending)
    return re.sub(r"[^A-Za-z0-9_.-]", "-", name).lstrip(".-") or "network"


def _values(axes: SweepAxes) -> list[tuple[str, Sequence[Hashable]]]:
    content: dict[str, Any] = dict(axes)
    return [(name, value) for name, value in content.items() if name != "scenarios"]
