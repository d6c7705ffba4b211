"""Worlds: named values of a source's settings, which a study can override and a dataset writes out."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

import isac_cosim
from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import checked
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.sources.kinematic_settings import KinematicSettings
from isac_cosim.isacsim.traffic.sources.registry import OWN, motion_source
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings
from isac_cosim.labeling.generation.generate import describe, read_scenarios
from isac_cosim.labeling.generation.settings import DatasetStudy, as_stored

DOCS = Path(isac_cosim.__file__).parents[1] / "docs"
WORLDS = [(name, world) for name, source in OWN.items() for world in source.worlds]
RATES = [name for name in ManeuverSettings.model_fields if name.endswith("_hour")]


def study(**content: object) -> DatasetStudy:
    return checked(DatasetStudy, content, "study.toml")


@pytest.mark.parametrize(("source", "world"), WORLDS)
def test_a_world_stands_for_values_that_are_all_written_out(source: str, world: str) -> None:
    named = study(source=source, world=world)
    stored = named.model_dump(mode="json")
    for section, kind in OWN[source].sections.items():
        assert stored[section].keys() == kind.model_fields.keys()
    assert stored["world"] == world
    assert study(**stored) == named
    assert re.fullmatch(r"[a-z]+-\d+", world), "a name with a number, which another value raises"


def test_the_first_world_is_the_default_and_has_all_defaults() -> None:
    assert study() == study(world="stimulated-2")
    assert study().of(ManeuverSettings) == ManeuverSettings()
    assert study().of(TrafficSettings) == TrafficSettings()


def test_drivers_are_left_alone_in_the_natural_world() -> None:
    natural = study(world="natural-1").of(ManeuverSettings)
    assert {getattr(natural, rate) for rate in RATES} == {0.0}
    assert natural.quiet
    assert not ManeuverSettings().quiet


def test_single_values_of_a_world_can_be_overridden() -> None:
    maneuvers = study(world="natural-1", maneuvers={"cut_in_per_vehicle_hour": 2.0}).of(ManeuverSettings)
    assert {name for name in RATES if getattr(maneuvers, name)} == {"cut_in_per_vehicle_hour"}
    assert maneuvers.cut_in_per_vehicle_hour == 2.0
    deep = study(maneuvers={"hard_brake": {"rise_s": [1.0, 2.0]}}).of(ManeuverSettings)
    assert deep.hard_brake.rise_s == (1.0, 2.0)
    assert deep.hard_brake.model_copy(update={"rise_s": ManeuverSettings().hard_brake.rise_s}) == (
        ManeuverSettings().hard_brake
    )


def test_the_example_of_the_page_is_a_study() -> None:
    section = (DOCS / "traffic.md").read_text().partition("### Worlds\n")[2]
    [block, *_] = re.findall(r"```toml\n(.*?)```", section, re.DOTALL)
    content = tomllib.loads(block)["dataset"]
    assert study(**content).of(ManeuverSettings).cut_in_per_vehicle_hour == 2.0
    assert content["world"] in section.partition("```toml")[0]


def test_an_overridden_value_makes_another_dataset() -> None:
    """What identifies a dataset holds every value, not the name of a world."""
    prints = set()
    for maneuvers in ({}, {"cut_in_per_vehicle_hour": 2.0}):
        given = study(scenarios=["straight_road"], world="natural-1", maneuvers=maneuvers)
        scenarios = read_scenarios(given)
        prints.add(describe(given, scenarios, motion_source(given)).fingerprint)
    assert len(prints) == 2


def test_the_overlap_world_turns_two_assumptions_round() -> None:
    """The first response may be as strong as a hard brake; an overtake shows its speed within the window."""
    worlds = ("kinematic-2", "overlap-1")
    usual, overlap = (study(source="kinematic", world=name).of(KinematicSettings) for name in worlds)
    assert usual.response.braking_mps2[1] < usual.hard_brake.peak_mps2[0]
    assert overlap.response.braking_mps2[0] < overlap.hard_brake.peak_mps2[0]
    assert overlap.response.braking_mps2[1] >= overlap.hard_brake.peak_mps2[1]
    assert usual.overtake.acceleration_mps2[0] < usual.lane_change.acceleration_mps2[1]
    assert overlap.overtake.acceleration_mps2[0] > overlap.lane_change.acceleration_mps2[1]
    changed = {name for name, value in overlap if value != getattr(usual, name)}
    assert changed == {"response", "hard_brake", "overtake"}


def test_scenes_of_the_overlap_world_are_drawn() -> None:
    settings = study(source="kinematic", world="overlap-1", kinematics={"per_class": 4, "following_scenes": 1})
    source = motion_source(settings)
    recording = source.record(source.load("straight_road"), 1)
    assert len(recording.maneuvers) == 25


def test_a_stored_study_of_a_former_world_is_read() -> None:
    stored = {**study(source="kinematic").model_dump(mode="json"), "world": "kinematic-1"}
    read = DatasetStudy.model_validate(as_stored(stored))
    assert read.world is None
    assert read.source_settings() == study(source="kinematic").source_settings()
    with pytest.raises(InputError, match="source kinematic has no world 'kinematic-1'; choose one of kinematic-2"):
        study(source="kinematic", world="kinematic-1")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"world": "natural"}, "world: source sumo has no world 'natural'; choose one of stimulated-2, natural-1"),
        ({"world": "natural-1", "source": "kinematic"}, "world: source kinematic has no world 'natural-1'"),
        ({"world": 3}, "world: "),
    ],
)
def test_an_unknown_world_is_refused_with_the_known_ones(content: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(f"study.toml: {message}")):
        study(**content)
