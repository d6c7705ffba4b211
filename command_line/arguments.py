"""Turn the arguments of the command line into settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from isac_cosim.base.errors import InputError
from isac_cosim.base.parsing import channel, number_range
from isac_cosim.base.settings import checked
from isac_cosim.isacsim.scenarios.scenario import resolved
from isac_cosim.isacsim.sensing.onboard_radar import LONG_RANGE, RADAR_PRESETS
from isac_cosim.isacsim.sensing.sensors import DEFAULT as SENSOR
from isac_cosim.isacsim.sensing.sensors import SCENE, SENSORS
from isac_cosim.isacsim.traffic.sources.registry import natural_world, recognised, source_class
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.generation.resense import ResenseSettings, own_sensing
from isac_cosim.labeling.generation.settings import DatasetStudy

WHERE = "arguments"
STREAM_SEEDS = "1:14"
"""The seeds of streams where no --seeds are given: some 43 vehicle-hours of the bundled motorway."""
LINK = "link"
"""The channel of a scene."""
SEEDS_WITH_WINDOWS = (1, 1000)
"""The seeds that --windows may use up where no --seeds bound them."""


def one_of(samples: int | None, windows: int | None) -> int | None:
    """Return the number of samples; `--windows` is the former name of `--samples`. Raises InputError for both."""
    if samples is not None and windows is not None:
        raise InputError("--windows is the former name of --samples; give one of them")
    return windows if samples is None else samples


def box_of(text: str) -> tuple[float, float, float, float]:
    """West, south, east, north, degrees, from W,S,E,N. Raises InputError where it is no box."""
    try:
        west, south, east, north = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--box {text}: is not a box; write west,south,east,north in degrees") from None
    if not (-180 <= west < east <= 180 and -90 <= south < north <= 90):
        raise InputError(f"--box {text}: is not a box; write west,south,east,north in degrees, west and south first")
    return west, south, east, north


def dataset_study(
    scenarios: list[str],
    windows: int | None,
    seeds: str | None,
    snr: str | None,
    source: str | None = None,
    natural: bool = False,
    drivers: str = "theirs",
    demand: str = "as_given",
    scene: bool = False,
    network: str | None = None,
) -> DatasetStudy:
    """Return the study that the arguments of `generate` describe. Raises InputError.

    scenarios: may be empty where the source has scenarios of its own. source: name of the motion source; by default,
    that which recognises the scenarios. natural: leave the drivers alone. drivers, demand: as in `TrafficSettings`, of
    sources that have such a section. scene: the sites sense all vehicles at once. network: the scenario or network that
    a file of trajectories was driven on, of sources that have such a setting.
    """
    source = source or recognised(scenarios)
    kind = source_class(source)
    if not scenarios and not kind.own_scenarios:
        raise InputError("Missing argument 'SCENARIO': name a bundled scenario, a folder, a .sumocfg or a .net.xml")
    content: dict[str, Any] = {"source": source, "selection": {"windows": windows}}
    if scenarios:
        content["scenarios"] = scenarios
    if seeds is not None or windows is not None:
        first, last = number_range(seeds, "--seeds", int, "1:20") if seeds else SEEDS_WITH_WINDOWS
        content["seeds"] = {"first": first, "last": last}
    if snr is not None:
        content["sensing"] = {"channel": channel(snr)}
    if scene:
        if snr not in (None, LINK):
            raise InputError(f"--snr {snr}: a scene has the link budget; leave --snr out")
        content["sensing"] = {"channel": {"kind": LINK}, "scene": {}}
    if natural:
        content["world"] = natural_world(source)
    traffic = {"drivers": drivers, "demand": demand.replace("-", "_")}
    if "traffic" in kind.sections:
        content["traffic"] = traffic
    elif traffic != {"drivers": "theirs", "demand": "as_given"}:
        raise InputError(f"--drivers, --demand: source {source} has no demand to drive; leave them out")
    if network is not None:
        content |= {of_network(source): {"network": resolved(network)}}
    return checked(DatasetStudy, content, WHERE)


def of_network(source: str) -> str:
    """Return the section of a source's settings that names a road network. Raises InputError where it has none."""
    for name, section in source_class(source).sections.items():
        if "network" in section.model_fields:
            return name
    raise InputError(f"--network: source {source} reads no road network beside its scenario; leave it out")


@dataclass(frozen=True)
class SenseArguments:
    """The arguments of `sense`; None leaves the dataset's own setting.

    fusion: a fusion method, or `eq5-covariance`. sites: at most so many. rain_mm_per_h: rain rate, mm/h.
    radar: condition of the onboard radar. pattern: which cycles it loses. records: how many to sense. scene: the same
    as the sensor `scene`. radar_preset: which onboard radar.
    """

    sensor: str | None
    snr: str | None = None
    estimator: str | None = None
    fusion: str | None = None
    sites: int | None = None
    rain_mm_per_h: float | None = None
    blockage: bool = True
    radar: str | None = None
    pattern: str | None = None
    records: int | None = None
    scene: bool = False
    radar_preset: str | None = None


def _refuse_given(options: Mapping[str, bool], belongs_to: str) -> None:
    """Raise InputError for the first option that is given, though the command would ignore it.

    belongs_to: what these options apply to, and how to mend the command.
    """
    for option, given in options.items():
        if given:
            raise InputError(f"{option} applies to {belongs_to}")


def resense_settings(dataset: Dataset, arguments: SenseArguments) -> ResenseSettings:
    """Return a dataset's own sensing settings, changed by what the arguments give. Raises InputError."""
    if arguments.scene and arguments.sensor not in (None, SCENE):
        raise InputError(f"--scene is a sensor of its own: remove it, or --sensor {arguments.sensor}")
    sensor = SCENE if arguments.scene else arguments.sensor or SENSOR
    if sensor in SENSORS and not SENSORS[sensor].by_sites:
        of_sites = {
            "--snr": arguments.snr is not None,
            "--estimator": arguments.estimator is not None,
            "--fusion": arguments.fusion is not None,
            "--sites": arguments.sites is not None,
            "--no-blockage": not arguments.blockage,
        }
        _refuse_given(of_sites, f"the sites: remove it, or --sensor {sensor}")
    of_echoes = {"--rain": sensor == "truth" and arguments.rain_mm_per_h is not None}
    _refuse_given(of_echoes, "sensors with echoes: remove it, or --sensor truth")
    if sensor == SCENE:
        one_by_one = {
            "--snr": arguments.snr not in (None, LINK),
            "--estimator": arguments.estimator is not None,
            "--fusion": arguments.fusion is not None,
            "--sites": arguments.sites is not None,
        }
        _refuse_given(one_by_one, "vehicles that are sensed one by one: remove it, or the scene")
    sensing = own_sensing(dataset).model_dump()
    if sensor == SCENE:
        sensing["channel"]["kind"] = LINK
        sensing.setdefault("scene", {})
    else:
        sensing.pop("scene", None)
    if arguments.snr is not None:
        sensing["channel"] |= channel(arguments.snr)
    if not arguments.blockage:
        sensing["channel"]["blockage"] = False
    if arguments.rain_mm_per_h is not None:
        sensing["channel"]["rain_mm_per_h"] = arguments.rain_mm_per_h
    if arguments.estimator is not None:
        sensing["estimator"] = arguments.estimator
    if arguments.fusion is not None:
        method, _, weights = arguments.fusion.partition("-")
        sensing["fusion"] |= {"method": method, "eq5_weights": weights or "paper"}
    if arguments.sites is not None:
        sensing["view"]["sites"] = arguments.sites
    of_radar = {
        "--radar": arguments.radar,
        "--radar-preset": arguments.radar_preset,
        "--pattern": arguments.pattern,
    }
    for option, value in of_radar.items():
        if value is not None and sensor != "radar":
            raise InputError(f"{option} applies to the onboard radar only: add --sensor radar")
    _refuse_given({"--pattern": arguments.pattern is not None and arguments.radar != "nlos"}, "--radar nlos: add it")
    preset = arguments.radar_preset or LONG_RANGE
    if preset not in RADAR_PRESETS:
        raise InputError(f"--radar-preset {preset}: no such radar; choose one of {', '.join(RADAR_PRESETS)}")
    radar = {
        **RADAR_PRESETS[preset],
        "condition": arguments.radar,
        "pattern": arguments.pattern,
        "rain_mm_per_h": arguments.rain_mm_per_h,
    }
    content = {
        "sensor": sensor,
        "sensing": sensing,
        "radar": {name: value for name, value in radar.items() if value is not None},
        "records": arguments.records,
    }
    return checked(ResenseSettings, content, WHERE)
