"""The axes of a sweep, and the cells between them.

A cell is one network, one way of sensing and one predictor, trained once with every training seed.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import AfterValidator, Field, ValidationError, model_validator

from isac_cosim.base.errors import InputError
from isac_cosim.base.parsing import channel
from isac_cosim.base.setting_fields import Seed
from isac_cosim.base.settings import Settings
from isac_cosim.base.validation import first_fault
from isac_cosim.isacsim.radio.channel import ChannelSettings
from isac_cosim.isacsim.scenarios.sumo_files import CONFIG_ENDINGS, NETWORK_ENDINGS
from isac_cosim.isacsim.sensing.sensors import DEFAULT, SCENE, SENSORS
from isac_cosim.models.predictors.registry import PREDICTORS


def _channel_of(text: str) -> str:
    """Check that a text is an SNR; pydantic reports the ValueError with the path of the key."""
    try:
        ChannelSettings.model_validate(channel(text, "snr"))
    except InputError as error:
        raise ValueError(str(error)) from None
    except ValidationError as error:
        raise ValueError(first_fault(error, ChannelSettings)) from None
    return text


class SweepAxes(Settings):
    """What a study varies. An axis that is absent has the study's own value."""

    scenarios: tuple[Annotated[str, Field(min_length=1)], ...] = Field(
        (), description="networks, each with its own dataset"
    )
    snr: tuple[Annotated[str, AfterValidator(_channel_of)], ...] = Field(
        (), description="per-element SNR of the sites, dB: LO:HI, one value, or link, as `cosim sense --snr` takes it"
    )
    sensors: tuple[Annotated[str, AfterValidator(SENSORS.check)], ...] = Field(
        (DEFAULT,), min_length=1, description="; ".join(f"{name}: {sensor.label}" for name, sensor in SENSORS.items())
    )
    models: tuple[Annotated[str, AfterValidator(PREDICTORS.check)], ...] = Field(
        (), description="predictors; trees are always added, as the floor"
    )
    training_seeds: tuple[Seed, ...] = Field(
        (), description="training seeds; the table has mean and standard deviation over them"
    )
    datasets: dict[str, dict[str, Any]] = Field(
        {},
        description="settings of `dataset` that a network has otherwise, by its name: another source, say",
    )
    test_on: tuple[str, ...] = Field((), description="networks on which the predictors of the others are tested, too")

    @model_validator(mode="after")
    def _sound(self) -> Self:
        for axis, values in (*_values(self), ("scenarios", [network_name(scenario) for scenario in self.scenarios])):
            if repeated := [value for value, times in Counter(values).items() if times > 1]:
                raise ValueError(f"{axis} has {repeated[0]} twice: remove one, or rename it")
        if self.snr and not any(SENSORS[name].by_sites and name != SCENE for name in self.sensors):
            raise ValueError("snr applies to the sites only: add isac to sensors, or remove snr")
        if unlisted := [network for network in self.test_on if network not in self.scenarios]:
            raise ValueError(f"test_on names {unlisted[0]}, which is not among scenarios: add it there")
        if unlisted := [network for network in self.datasets if network not in self.scenarios]:
            raise ValueError(f"datasets names {unlisted[0]}, which is not among scenarios: add it there")
        return self


@dataclass(frozen=True)
class WayOfSensing:
    """A way of sensing: the sensor, and for the sites the SNR.

    snr: as `cosim sense --snr` takes it; None for the study's own channel, and for other sensors.
    """

    sensor: str
    snr: str | None = None

    @property
    def name(self) -> str:
        """The name as part of a path."""
        return self.sensor if self.snr is None else f"{self.sensor}_{self.snr.replace(':', 'to')}"

    def __str__(self) -> str:
        if self.snr is None:
            return self.sensor
        return f"{self.sensor} {self.snr}" + ("" if self.snr == "link" else " dB")


@dataclass(frozen=True)
class Cell:
    """One network, by its short name, one way of sensing and one predictor."""

    network: str
    sensing: WayOfSensing
    model: str

    @property
    def path(self) -> Path:
        """Path of the cell's folder, below that of all cells."""
        return Path(self.network, self.sensing.name, self.model)

    def __str__(self) -> str:
        return f"{self.network}, {self.sensing}, {self.model}"


def sensings(axes: SweepAxes) -> list[WayOfSensing]:
    """Return the ways of sensing. The SNR applies to sites that sense vehicles one by one; others are one way each."""
    return [
        WayOfSensing(sensor, snr)
        for sensor in axes.sensors
        for snr in ((axes.snr or (None,)) if SENSORS[sensor].by_sites and sensor != SCENE else (None,))
    ]


def network_name(scenario: str) -> str:
    """Return the short name of a scenario, usable in a path: of its folder or file, without the ending."""
    path = Path(scenario)
    # A text that is not a path (it has a null character) does not exist; reading it later reports that.
    name = (path.resolve() if path.exists() else path).name
    for ending in (*CONFIG_ENDINGS, *NETWORK_ENDINGS):
        name = name.removesuffix(ending)
    return re.sub(r"[^A-Za-z0-9_.-]", "-", name).lstrip(".-") or "network"


def _values(axes: SweepAxes) -> list[tuple[str, Sequence[Hashable]]]:
    """Return the values on each axis but `scenarios`, by its name."""
    return [(name, values) for name, values in axes if name not in ("scenarios", "datasets")]
