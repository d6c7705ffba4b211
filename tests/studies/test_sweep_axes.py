"""The axes of a sweep: the cells they span, the values they refuse, and what a sweep costs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import cosim
from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import checked
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.sources.fcd import FcdSettings
from isac_cosim.isacsim.traffic.sources.registry import natural_world
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings
from isac_cosim.labeling.generation.cost_estimate import estimate
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.studies.cost_estimate import estimate_study
from isac_cosim.studies.study import Study, read_study
from isac_cosim.studies.sweep_axes import WayOfSensing


def study_of(**axes: object) -> Study:
    return checked(Study, {"name": "small", "sweep": axes}, "test")


def test_cells_are_the_product_of_the_axes() -> None:
    """The SNR applies to the sites only; axes that are absent have the study's own value."""
    axes = {"snr": ["0:10", "link"], "sensors": ["truth", "isac", "radar"], "models": ["castformer", "trees"]}
    study = study_of(scenarios=["a/x.sumocfg", "y"], **axes)
    expected = [
        WayOfSensing("truth"),
        WayOfSensing("isac", "0:10"),
        WayOfSensing("isac", "link"),
        WayOfSensing("radar"),
    ]
    assert [(cell.network, cell.sensing, cell.model) for cell in study.cells] == [
        (network, sensing, model) for network in ("x", "y") for sensing in expected for model in ("trees", "castformer")
    ]
    assert len({cell.path for cell in study.cells}) == 16
    assert study.networks["x"].scenarios == ("a/x.sumocfg",)
    assert study.networks["x"].sensing.channel.snr_range_db == (0.0, 10.0)
    assert study.sensing_at("link").channel.kind == "link"
    assert study_of().axes.training_seeds == (study.training.seed,)
    assert list(study_of().networks) == ["motorway"]


def test_the_bundled_sweep_is_as_documented() -> None:
    study = read_study(Path(cosim.__file__).parent / "studies" / "sweep.toml")
    assert (study.name, len(study.cells)) == ("sweep", 12)
    assert study.sensing_at("-20:-10").channel.snr_range_db == (-20.0, -10.0)


def test_a_network_may_have_motion_from_elsewhere() -> None:
    own = {"source": "fcd", "scenarios": ["a.fcd.csv", "b.fcd.csv"], "fcd": {"network": "motorway"}}
    study = study_of(scenarios=["motorway", "recorded"], test_on=["motorway", "recorded"], datasets={"recorded": own})
    simulated, recorded = study.networks["motorway"], study.networks["recorded"]
    assert (simulated.source, simulated.scenarios) == ("sumo", ("motorway",))
    assert (recorded.source, recorded.scenarios) == ("fcd", ("a.fcd.csv", "b.fcd.csv"))
    assert recorded.of(FcdSettings).network == "motorway"
    assert (recorded.labels, recorded.record, recorded.sensing) == (
        simulated.labels, simulated.record, simulated.sensing
    )  # fmt: skip
    assert (recorded.seeds.first, recorded.seeds.last) == (1, 10_000)  # as many as the files have blocks
    assert estimate(recorded).episodes == 4


def test_the_bundled_study_from_simulation_to_recordings_tests_both_ways() -> None:
    study = read_study(Path(cosim.__file__).parent / "studies" / "sim_to_real.toml")
    assert {network: dataset.source for network, dataset in study.networks.items()} == {
        "motorway": "sumo", "recorded": "levelx"
    }  # fmt: skip
    assert {dataset.labels.preset for dataset in study.networks.values()} == {"isac-2-one-change"}
    assert set(study.axes.test_on) == set(study.networks)
    with pytest.raises(InputError, match=r"there is no file .*highD/data/01_tracks\.csv: give a file of trajectories"):
        study.check_scenarios()


def test_a_network_of_a_sweep_may_be_in_another_world() -> None:
    """With the values of that world, and what the study says otherwise."""
    study = checked(
        Study,
        {
            "dataset": {"pairs": {"range_m": 70.0}},
            "sweep": {
                "scenarios": ["motorway", "urban"],
                "datasets": {"urban": {"world": natural_world("sumo"), "traffic": {"step_s": 0.02}}},
            },
        },
        "test",
    )
    motorway, urban = study.networks["motorway"], study.networks["urban"]
    natural = DatasetStudy(scenarios=("urban",), world=natural_world("sumo"))
    assert motorway.of(ManeuverSettings) == DatasetStudy().of(ManeuverSettings) != natural.of(ManeuverSettings)
    assert urban.of(ManeuverSettings) == natural.of(ManeuverSettings)
    assert (urban.world, urban.pairs.range_m, urban.of(TrafficSettings).step_s) == (natural.world, 70.0, 0.02)


WRONG: dict[str, dict[str, Any]] = {
    "sweep.seeds: unknown key": {"seeds": [1]},
    "sweep.snr.1: snr loud: is not a range, a value or link": {"snr": ["0:10", "loud"]},
    "sweep.snr.0: snr_range_db.1: must be at most 80, not 900": {"snr": ["0:900"]},
    "sweep.sensors.0: ": {"sensors": ["sonar"]},
    "sweep.sensors: ": {"sensors": []},
    "sweep.models.0: ": {"models": ["oracle"]},
    "sweep: training_seeds has 1 twice": {"training_seeds": [1, 1]},
    "sweep: scenarios has road twice": {"scenarios": ["a/road", "b/road.sumocfg"]},
    "sweep: snr applies to the sites only": {"snr": ["link"], "sensors": ["truth"]},
    "sweep: datasets names south, which is not among scenarios": {"scenarios": ["north"], "datasets": {"south": {}}},
    "sweep.datasets.north.source: ": {"scenarios": ["north"], "datasets": {"north": {"source": "sonar"}}},
    "sweep.datasets.north.fcd.noise: unknown key": {
        "scenarios": ["north"],
        "datasets": {"north": {"source": "fcd", "fcd": {"noise": 1}}},
    },
    "sweep: test_on names south, which is not among scenarios": {"scenarios": ["north"], "test_on": ["south"]},
}


@pytest.mark.parametrize("message", WRONG)
def test_a_wrong_axis_is_reported_with_its_key(message: str) -> None:
    with pytest.raises(InputError) as error:
        study_of(**WRONG[message])
    assert str(error.value).startswith(f"test: {message}")
    assert "\n" not in str(error.value)


def test_blockage_is_not_sensed_anew() -> None:
    content = {"dataset": {"sensing": {"channel": {"blockage": True}}}, "sweep": {"snr": ["link", "0:10"]}}
    with pytest.raises(InputError, match=r"sweep\.snr: with more than one"):
        checked(Study, content, "test")


def test_a_scene_is_one_way_of_sensing() -> None:
    """It has the link budget whatever the SNR of the sites, so a sweep over that has it once."""
    study = study_of(scenarios=["x"], snr=["0:10", "link"], sensors=["isac", "scene"], models=["trees"])
    ways = [WayOfSensing("isac", "0:10"), WayOfSensing("isac", "link"), WayOfSensing("scene")]
    assert [cell.sensing for cell in study.cells] == ways
    with pytest.raises(InputError, match="snr applies to the sites only"):
        study_of(snr=["link"], sensors=["scene"])
    with pytest.raises(InputError, match=r"dataset\.sensing\.scene.* add \"scene\" to sweep\.sensors"):
        checked(Study, {"dataset": {"sensing": {"scene": {}}}, "sweep": {"models": ["trees"]}}, "test")


def test_the_cost_of_a_sweep_grows_with_its_axes() -> None:
    one = estimate_study(study_of(scenarios=["motorway"], models=["asi-bip"]))
    assert (one.cells, one.trainings, one.datasets, one.sensed_anew) == (2, 2, 1, 0)
    seeds = estimate_study(study_of(scenarios=["motorway"], models=["asi-bip"], training_seeds=[0, 1, 2]))
    assert (seeds.cells, seeds.trainings, seeds.cpu_s) == (2, 6, one.cpu_s)
    assert seeds.training_s == pytest.approx(3 * one.training_s, rel=0.01)
    ways = estimate_study(
        study_of(scenarios=["motorway"], models=["asi-bip"], snr=["link", "0"], sensors=["isac", "truth"])
    )
    assert (ways.cells, ways.datasets, ways.episodes) == (6, 3, one.episodes)
    assert ways.sensed_anew == 2 * ways.samples == 2 * one.samples
    assert one.cpu_s < ways.cpu_s < 2 * one.cpu_s
    networks = estimate_study(study_of(scenarios=["motorway", "urban"], models=["asi-bip"]))
    assert (networks.cells, networks.samples) == (4, 2 * one.samples)
    assert networks.seconds(1) == pytest.approx(2 * one.seconds(1), rel=0.01)
    # A training has two threads.
    assert networks.seconds(4) == pytest.approx(networks.cpu_s / 4 + networks.training_s / 2, abs=0.1)
    assert [networks.trainings_at_once(workers) for workers in (1, 3, 6, 100)] == [1, 1, 3, 4]
    assert one.bytes < seeds.bytes < ways.bytes
    plain = estimate_study(checked(Study, {}, "test"))
    assert (plain.cells, plain.trainings, plain.trainings_at_once(8)) == (1, 2, 1)
