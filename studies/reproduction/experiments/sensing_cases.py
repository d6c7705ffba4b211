"""The ways of sensing that the ASI-BIP paper compares in Table I, and their datasets.

All of them hold the same motion. The first is generated; the others are its records, sensed anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from isac_cosim.base.feedback import Feedback
from isac_cosim.base.parsing import channel
from isac_cosim.base.settings import checked
from isac_cosim.base.workers.engine import Engine
from isac_cosim.isacsim.sensing.onboard_radar import RADAR_PRESETS
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.generation.resense import ResenseSettings, own_sensing, resense
from isac_cosim.studies.reproduction.experiments.stage_results import DatasetFacts
from isac_cosim.studies.sweep import finished

RAIN_MM_PER_H = 150.0
"""A violent rain. At 77 GHz it costs an echo from 100 m 8 dB, at 3.5 GHz 0.03 dB (ITU-R P.838-3)."""
WEATHER_LOSS_DB = 20.0
"""Loss of the echo in adverse weather. Source: ASI-BIP, Section IV-D, Case 5."""
PAPER_CHAIN: Mapping[str, Any] = {"fusion": {"method": "eq5", "eq5_weights": "paper"}}
"""Fusion of the paper: Eq. (5), weighted least squares with the paper's weights."""
FRAMEWORK = RADAR_PRESETS["framework"]
"""One reading of the paper's radar: that it is "re-implemented within our uniform simulation framework"."""
GENERATED = "isac"
"""The case whose dataset is generated."""


@dataclass(frozen=True)
class SensingCase:
    """One way of sensing.

    name: of its stage and folder. title: for people. paper_case: number of the case in Table I, if it is one.
    sensor: a registered one. sensing, radar: settings that differ from those of the generated dataset. loss_db: by how
    much the SNR of the sites is lower.
    """

    name: str
    title: str
    paper_case: int | None
    sensor: str = "isac"
    sensing: Mapping[str, Any] = field(default_factory=dict)
    radar: Mapping[str, Any] = field(default_factory=dict)
    loss_db: float = 0.0


TRAINED = (
    SensingCase("truth", "true motion", 1, "truth"),
    SensingCase("isac", "ISAC, our estimator and fusion", 2),
    SensingCase(
        "isac-padded-parabola",
        "ISAC, padded grid and parabola, Eq. 5",
        2,
        sensing={**PAPER_CHAIN, "estimator": "padded_parabola"},
    ),
    SensingCase("isac-padded-grid", "ISAC, padded grid, Eq. 5", 2, sensing={**PAPER_CHAIN, "estimator": "padded_grid"}),
    SensingCase("isac-grid", "ISAC, plain grid, Eq. 5", 2, sensing={**PAPER_CHAIN, "estimator": "grid"}),
    SensingCase("radar-clear", "onboard radar, clear", 3, "radar", radar={"condition": "clear"}),
    SensingCase("radar-nlos", "onboard radar, NLoS", 4, "radar", radar={"condition": "nlos", "pattern": "random"}),
    SensingCase("radar-weather", "onboard radar, adverse weather", 5, "radar", radar={"condition": "weather"}),
    SensingCase("framework-clear", "radar at 400 Hz, clear", 3, "radar", radar=FRAMEWORK),
    SensingCase(
        "framework-nlos",
        "radar at 400 Hz, NLoS",
        4,
        "radar",
        radar={**FRAMEWORK, "condition": "nlos", "pattern": "random"},
    ),
    SensingCase(
        "framework-weather", "radar at 400 Hz, adverse weather", 5, "radar", radar={**FRAMEWORK, "condition": "weather"}
    ),
)  # fmt: skip
"""Cases with a training of their own."""


def weather_stage(chain: str) -> str:
    """Return the name of the stage that measures an ISAC case in adverse weather."""
    return f"{chain}-weather"


def weather_cases(chain: str) -> list[SensingCase]:
    """Return an ISAC case in adverse weather. It is measured with the predictors that were trained in clear weather.

    The paper asks for "the same adverse weather" as that of the radar. There are two readings of it: the same rain, and
    the same loss. chain: name of the ISAC case.
    """
    trained = next(case for case in TRAINED if case.name == chain)
    rain = {**trained.sensing, "channel": {"rain_mm_per_h": RAIN_MM_PER_H}}
    in_rain = replace(
        trained, name=f"{chain}-rain", title=f"{trained.title}; rain of {RAIN_MM_PER_H:g} mm/h", sensing=rain
    )
    with_loss = replace(
        trained,
        name=f"{chain}-loss",
        title=f"{trained.title}; echo loss of {WEATHER_LOSS_DB:g} dB",
        loss_db=WEATHER_LOSS_DB,
    )
    return [in_rain, with_loss]


def sensed(
    generated: Dataset, case: SensingCase, folder: Path, engine: Engine, feedback: Feedback, snr: str | None = None
) -> Dataset:
    """Return a case's dataset, sensed anew unless the folder holds it.

    snr: per-element SNR of the sites, as `cosim sense --snr` takes it; that of the case when None.
    """
    if finished(folder):
        return Dataset.open(folder)
    return resense(generated, resense_settings(generated, case, snr), folder, engine, feedback)


def resense_settings(generated: Dataset, case: SensingCase, snr: str | None = None) -> ResenseSettings:
    """Return the settings by which a case's records are sensed."""
    sensing = own_sensing(generated).model_dump()
    for key, value in case.sensing.items():
        sensing[key] = {**sensing[key], **value} if isinstance(value, Mapping) else value
    if case.loss_db:
        low, high = sensing["channel"]["snr_range_db"]
        sensing["channel"]["snr_range_db"] = (low - case.loss_db, high - case.loss_db)
    if snr is not None:
        sensing["channel"] |= channel(snr)
    content = {"sensor": case.sensor, "sensing": sensing, "radar": dict(case.radar)}
    return checked(ResenseSettings, content, f"case {case.name}")


def of_groups(dataset: Dataset, groups: list[str]) -> Dataset:
    """Return the part of a dataset that some scenario seeds make up; groups: `<scenario>-<seed>` of each."""
    chosen, shards = {f"{group}.parquet" for group in groups}, dataset.meta.shards
    shards = shards.select(file for file in shards.files if file in chosen)
    return replace(dataset, meta=dataset.meta.model_copy(update={"shards": shards}))


def description(dataset: Dataset) -> DatasetFacts:
    """Return what a stage's file says of a dataset."""
    errors: list[float] = []
    for states in dataset.arrays_by_shard("tv", "tv_truth"):
        apart = states["tv"][:, :2] - states["tv_truth"][:, :2]
        errors.extend(np.median(np.hypot(apart[:, 0], apart[:, 1]), axis=1))
    return DatasetFacts(
        digest=dataset.digest,
        samples=dataset.meta.samples,
        by_intention=dataset.meta.by_intention(),
        left_out=dataset.meta.left_out(),
        median_position_error_m=round(float(np.median(errors)), 5) if errors else None,
    )
