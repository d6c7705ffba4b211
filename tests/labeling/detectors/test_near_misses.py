"""Near misses: motion just under a threshold, and nothing that is an event or far from one."""

from __future__ import annotations

import pytest

from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.near_misses import NearMissSettings
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Intention
from isac_cosim.labeling.road.straight_road import ScriptedVehicle, straight_road

GENTLE = LabelSettings.model_validate({"preset": "gentle", "hard_brake": {"threshold_mps2": 3.0, "hold_s": 0.2}})


def speed_change(mps2: float, seconds: float) -> list[tuple[float, float]]:
    return [(10, 25.0), (10 + seconds, 25.0 + mps2 * seconds)]


@pytest.mark.parametrize(
    ("mps2", "seconds", "found"),
    [
        (-3.5, 2.0, "hard_brake"),
        (-2.5, 2.0, None),
        (-6.0, 2.0, None),
        (-6.0, 0.35, "hard_brake"),
        (2.2, 2.0, "hard_accel"),
        (1.5, 2.0, None),
        (3.5, 2.0, None),
    ],
    ids=["just under", "far under", "an event", "too short", "just under, speeding up", "far under", "an event"],
)
def test_a_near_miss_reaches_its_share_of_the_threshold_and_is_no_event(
    mps2: float, seconds: float, found: str | None
) -> None:
    recording = straight_road(ScriptedVehicle("tv", speed=speed_change(mps2, seconds)))
    labels = label(recording, LabelSettings(), near=NearMissSettings())
    assert [event.intention.text for event in labels.near_misses] == ([] if found is None else [found])
    for event in labels.near_misses:
        assert 9.7 < event.onset <= event.commit <= event.end < 10.5 + seconds
    assert label(recording, LabelSettings()).near_misses == ()


def test_the_band_lies_beside_the_threshold_of_the_study() -> None:
    recording = straight_road(ScriptedVehicle("tv", speed=speed_change(-2.5, 2.0)))
    assert [event.intention for event in label(recording, GENTLE, near=NearMissSettings()).near_misses] == [
        Intention.HARD_BRAKE
    ]
    narrow = NearMissSettings(hard_brake=0.95)
    assert label(recording, GENTLE, near=narrow).near_misses == ()


def test_a_jerk_aside_that_is_too_gentle_for_a_swerve_is_a_near_miss() -> None:
    aside = [(10, 0.0), (10.9, 0.9), (12, 0.9), (12.9, 0.0)]
    labels = label(straight_road(ScriptedVehicle("tv", lateral=aside)), LabelSettings(), near=NearMissSettings())
    assert labels.of(Intention.EVASIVE_SWERVE) == []
    assert Intention.EVASIVE_SWERVE in {event.intention for event in labels.near_misses}
