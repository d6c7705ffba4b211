"""The settings of an evaluation in running traffic."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    Field,
    JsonValue,
    SerializerFunctionWrapHandler,
    field_validator,
    model_serializer,
    model_validator,
)

from isac_cosim.base.arrays import Array
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.sensing.onboard_radar import RadarSettings
from isac_cosim.isacsim.sensing.sensors import DEFAULT, SENSORS
from isac_cosim.isacsim.sensing.sensors.protocol import SensorSettings
from isac_cosim.labeling.detectors.near_misses import NearMissSettings
from isac_cosim.labeling.generation.settings import DatasetStudy, SeedRange, as_stored
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.labeling.streams.settings import StretchSettings
from isac_cosim.models.trees.boosting import BoostingSettings

Method = Literal["reject", "background", "hazard"]
"""How a predictor's answers become alarms; see `AlarmSettings`."""
Sharing = Literal["shared", "separate"]
"""Whether all intentions share a threshold, or each has its own."""

SEEDS, DEVELOPMENT = (1001, 1004), (2001, 2100)
"""The default seeds to measure, and those on which alarms are chosen. Training uses lower ones."""
DEVELOPMENT_H = 30.0
"""Vehicle-hours on which alarms are chosen by default: as many of the default seeds are run."""

Confirmation = Annotated[int, Field(ge=1, le=10_000)]
"""Number of windows."""


class StreamSettings(StretchSettings):
    """How vehicles are watched, and by which sensor."""

    truth: bool = Field(
        False, description="whether the run is also measured on true motion, which shows what sensing costs"
    )
    sensor: Annotated[str, AfterValidator(SENSORS.check)] = Field(DEFAULT, description="what senses the TVs")
    radar: RadarSettings = Field(RadarSettings(), description="the UV's own radar, where that is the sensor")
    options: dict[str, JsonValue] = Field({}, description="settings of an installed sensor, which checks them itself")

    @model_serializer(mode="wrap")
    def _without_unused_sensors(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Settings of sensors are stored where they are not the default."""
        content: dict[str, Any] = serialize(self)
        for name in ("sensor", "radar", "options"):
            if getattr(self, name) == type(self).model_fields[name].default:
                content.pop(name, None)
        return content


class AlarmSettings(Settings):
    """When the answers to consecutive windows of a vehicle become an alarm for an intention.

    method: what is compared with the threshold. `reject`: the unknown score of the run, in windows whose likeliest
    intention it is, with a probability of at least `least_probability`. `background`: the log-odds of the intention,
    from trees that also know a seventh answer, "none" (`evaluation.in_traffic.alarms.background`). `hazard`: the
    log-odds of the intention, from a run that was trained on streams.
    threshold: a single one for all intentions, or one for each by its name. An intention without one never raises an
    alarm.
    k, n: an alarm is raised when k of the last n windows reach the threshold. refractory_s: the next alarm for the same
    vehicle and intention needs the level to fall below the threshold, and this time to pass, s. rise: a level that
    falls by as much as this and rises as much again raises an alarm, too, without ever falling below the threshold;
    None in results of earlier versions, and for levels without a scale.
    """

    method: Method
    threshold: float | dict[str, float]
    k: int = Field(1, ge=1)
    n: int = Field(1, ge=1)
    least_probability: float = Field(0.0, ge=0.0, le=1.0)
    refractory_s: float = Field(2.0, ge=0.0, le=1e5)
    rise: float | None = Field(None, gt=0.0, le=1e6)

    @field_validator("threshold")
    @classmethod
    def _known(cls, threshold: float | dict[str, float]) -> float | dict[str, float]:
        names = [known.text for known in KNOWN]
        wrong = [name for name in threshold if name not in names] if isinstance(threshold, dict) else []
        if wrong:
            raise ValueError(f"{wrong[0]}: no such intention; there are {', '.join(names)}")
        return threshold

    @property
    def thresholds(self) -> Array:
        """The threshold of each intention, infinite if it never raises an alarm, (6,)."""
        if not isinstance(self.threshold, Mapping):
            return np.full(len(KNOWN), self.threshold)
        return np.array([self.threshold.get(known.text, np.inf) for known in KNOWN])


def shown_threshold(thresholds: Array) -> float | dict[str, float]:
    """Return thresholds (6,) as `AlarmSettings` hold them: a single one if all are equal, otherwise one by intention.

    Infinite thresholds are left out.
    """
    finite = np.isfinite(thresholds)
    if finite.all() and (thresholds == thresholds[0]).all():
        return float(thresholds[0])
    return {KNOWN[k].text: float(thresholds[k]) for k in np.flatnonzero(finite).tolist()}


class ChoiceSettings(Settings):
    """The alarm settings among which the development seeds choose."""

    false_alarms_per_vehicle_hour: float = Field(
        1.0, gt=0.0, le=1e6, description="choose the highest recall at this many false alarms per vehicle-hour"
    )
    threshold: Sharing = Field("separate", description="whether all intentions share a threshold, or each has its own")
    least_events: int = Field(
        20,
        ge=1,
        le=1_000_000,
        description="fewest development events for a separate threshold; rarer intentions share one",
    )
    confirmations: tuple[tuple[Confirmation, Confirmation], ...] = Field(
        ((1, 1), (2, 3), (4, 5)), min_length=1, description="pairs (k, n): k of the last n windows reach the threshold"
    )
    least_probabilities: tuple[Annotated[float, Field(ge=0, le=1)], ...] = Field(
        (0.0, 0.5, 0.8), min_length=1, description="least probabilities of the likeliest intention, for `reject`"
    )
    refractory_s: float = Field(
        5.0,
        ge=0.0,
        le=1e5,
        description="time between two alarms of one intention and vehicle, s; 5 is the mean duration of a lane change, "
        "which should raise no second alarm",
    )
    rise: float | None = Field(
        2.0,
        gt=0.0,
        le=1e6,
        description="log-odds by which a level that stays above its threshold has to fall, and to rise again, to raise "
        "another alarm; for levels that are log-odds",
    )
    thresholds: int = Field(
        80, ge=2, le=100_000, description="thresholds tried for each combination of the other settings"
    )

    @model_validator(mode="after")
    def _confirmable(self) -> Self:
        for k, n in self.confirmations:
            if not 1 <= k <= n:
                raise ValueError(f"confirmations ({k}, {n}): give k of n windows with 1 <= k <= n")
        return self


class BackgroundSettings(BoostingSettings):
    """How the trees with the answer "none" are trained on the streams of the development seeds."""

    lanes: bool = Field(
        True,
        description="whether the trees also take what the window, the lanes and the UV say of the situation: distances "
        "to the markings, accelerations and lateral speeds one after the other, where lanes go on, and how close a "
        "conflict with the UV is",
    )
    until: Literal["commit", "end"] = Field(
        "commit",
        description="until when windows of an event count as the maneuver; `commit`: those after the commit are left "
        "out of the training, because an alarm then comes too late to predict",
    )
    background_every_s: float = Field(
        1.0,
        gt=0.0,
        le=1e5,
        description="interval between training windows outside events, s; they get the weight of all",
    )
    before_onset_s: float = Field(
        0.5, ge=0.0, le=1e5, description="how early before onset a window already counts as the maneuver, s"
    )
    rounds: int = Field(100, ge=1, le=100_000, description="boosting rounds")
    folds: int = Field(
        4, ge=2, le=1000, description="parts of the development seeds; trees of the others answer a part"
    )


class ScoringSettings(Settings):
    """How alarms are scored."""

    before_onset_s: float = Field(
        2.0, ge=0.0, le=10.0, description="an alarm may come this long before the onset of its event, s"
    )
    false_alarms_per_vehicle_hour: tuple[Annotated[float, Field(gt=0, le=1e6)], ...] = Field(
        (0.1, 0.3, 1.0, 3.0, 10.0), min_length=1, description="rates at which the curve is read"
    )
    confidence: float = Field(0.95, gt=0.0, lt=1.0, description="confidence of the intervals")
    near_misses: Literal["neutral", "false"] = Field(
        "neutral", description="what an alarm for a motion just under a threshold is: neither right nor false, or false"
    )

    @model_validator(mode="before")
    @classmethod
    def _without_resamples(cls, content: object) -> object:
        """Leave out `resamples`, which results of earlier versions hold: intervals are no longer bootstraps."""
        if not isinstance(content, Mapping):
            return content
        return {key: value for key, value in content.items() if key != "resamples"}


class LiveSettings(Settings):
    """Everything that the evaluation adds to the traffic and to the run."""

    streams: StreamSettings = StreamSettings()
    near_misses: NearMissSettings = NearMissSettings()
    choice: ChoiceSettings = ChoiceSettings()
    background: BackgroundSettings = BackgroundSettings()
    scoring: ScoringSettings = ScoringSettings()


BEFORE: dict[str, dict[str, Any]] = {
    "streams": {"outcome_s": 0.0},
    "choice": {"rise": None},
    "background": {"lanes": False, "until": "end"},
    "scoring": {"near_misses": "false"},
}
"""What settings were before they were stored."""


class LiveStudy(Settings):
    """An evaluation in running traffic.

    dataset: settings of traffic, labels, pairs and sensing, with the one scenario and the seeds to measure.
    development: seeds of the same scenario on which alarms are chosen. development_h: if given, no more of them are run
    than it takes to predict for so many vehicle-hours; the study of a result names those that were.
    """

    dataset: DatasetStudy
    development: SeedRange
    development_h: float | None = Field(None, gt=0.0, le=1e6)
    live: LiveSettings = LiveSettings()

    @field_validator("dataset", mode="before")
    @classmethod
    def _dataset_of_any_version(cls, dataset: object) -> object:
        """Read what earlier versions wrote as they meant it."""
        return as_stored(dataset) if isinstance(dataset, Mapping) else dataset

    @field_validator("live", mode="before")
    @classmethod
    def _live_of_any_version(cls, live: object) -> object:
        """Read results of versions without some of the settings as they were."""
        if not isinstance(live, Mapping):
            return live
        stored = {name: live[name] for name in BEFORE if isinstance(live.get(name), Mapping)}
        return {**live, **{name: {**BEFORE[name], **content} for name, content in stored.items()}}

    @model_validator(mode="after")
    def _apart(self) -> Self:
        measured = self.dataset.seeds
        if measured.first <= self.development.last and self.development.first <= measured.last:
            raise ValueError(
                f"development seeds {self.development.first}:{self.development.last} and measured seeds "
                f"{measured.first}:{measured.last} overlap: alarms may not be chosen on the seeds that measure them"
            )
        if len(self.dataset.scenarios) != 1:
            raise ValueError("evaluate one scenario at a time")
        return self

    @property
    def sensor_settings(self) -> SensorSettings:
        """The settings of what senses the TVs."""
        streams = self.live.streams
        return SensorSettings(sensing=self.dataset.sensing, radar=streams.radar, options=streams.options)

    @property
    def seeds(self) -> list[int]:
        """The development seeds, then the measured ones."""
        return [*self.development, *self.dataset.seeds]
