"""Labels do not depend on causes and commands: those of stimulated traffic come from its states alone."""

from dataclasses import replace

import pytest

from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.detectors.events import label, provenance
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Intention

SETTINGS = LabelSettings()


@pytest.fixture(scope="module")
def stimulated() -> Recording:
    """A hundred seconds of the motorway: many overtakes are commanded, most drivers are left alone."""
    none = {name: 0.0 for name in ManeuverSettings.model_fields if name.endswith("_hour")}
    some = {"hard_brake": 10.0, "debris": 30.0, "swerve": 10.0, "surge": 10.0, "hard_accel": 10.0, "overtake": 40.0}
    rates = none | {f"{name}_per_vehicle_hour": rate for name, rate in some.items()}
    return record(
        load("motorway"), 6, TrafficSettings(run_in_s=40.0, duration_s=100.0), ManeuverSettings.model_validate(rates)
    )


def test_labels_are_the_same_without_the_commands(stimulated: Recording) -> None:
    labels = label(stimulated, SETTINGS)
    assert len({event.intention for event in labels.events}) >= 6
    assert {command.maneuver for command in stimulated.commands} >= {"hard_brake", "overtake", "evasive_swerve"}
    assert label(replace(stimulated, commands=()), SETTINGS) == labels
    reasons = [provenance(stimulated, event) for event in labels.events]
    assert {reason.origin for reason in reasons} == {"natural", "reaction", "commanded"}
    assert {(reason.origin == "reaction", reason.cause != "") for reason in reasons} == {(True, True), (False, False)}


def test_swerves_evade_something_a_few_seconds_away(stimulated: Recording) -> None:
    swerves = label(stimulated, SETTINGS).of(Intention.EVASIVE_SWERVE)
    reasons = [provenance(stimulated, event) for event in swerves]
    to_debris = [reason.cause_ttc_s for reason in reasons if reason.cause == "debris"]
    assert len(to_debris) >= 5
    assert 0.0 < min(to_debris) < max(to_debris) < 4.0


def test_overtakes_on_command_are_commanded(stimulated: Recording) -> None:
    """A commanded one has a command to the same vehicle; most of these commands are overtakes."""
    overtakes = label(stimulated, SETTINGS).of(Intention.OVERTAKE)
    origins = [provenance(stimulated, event).origin for event in overtakes]
    assert origins.count("commanded") >= 4
    commanded = {command.vehicle for command in stimulated.commands if command.maneuver == "overtake"}
    by_command = [
        event.vehicle in commanded for event, origin in zip(overtakes, origins, strict=True) if origin == "commanded"
    ]
    assert sum(by_command) >= 0.5 * len(by_command)
