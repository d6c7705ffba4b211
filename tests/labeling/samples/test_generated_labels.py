"""Labels from the motion source: the candidates they give, and what counts as agreement of the detectors."""

from __future__ import annotations

import pytest

from isac_cosim.isacsim.traffic.motion import MotionSettings
from isac_cosim.isacsim.traffic.recordings.recording import GeneratedManeuver, LabelledRecording
from isac_cosim.isacsim.traffic.sources.kinematic import SCENARIO, KinematicSource
from isac_cosim.isacsim.traffic.sources.kinematic_settings import KinematicSettings
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Event, Intention
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.samples.candidates import RecordSettings
from isac_cosim.labeling.samples.generated_labels import (
    agreement,
    agreement_counts,
    detected_as,
    generated_candidates,
    other_counts,
)

BRAKE = GeneratedManeuver("hard_brake", "tv", "uv", onset=10.0, commit=10.8, end=12.0)
FOLLOWING = GeneratedManeuver("following", "tv", "uv", onset=10.0, commit=10.0, end=10.0)


def event(intention: Intention, onset: float, commit: float, mark: str | None = None) -> Event:
    return Event("tv", intention, onset, commit, commit + 1.0, 0.0, mark=mark)


@pytest.mark.parametrize(
    ("maneuver", "events", "verdict"),
    [
        (BRAKE, [], "nothing"),
        (BRAKE, [event(Intention.HARD_BRAKE, 10.1, 10.5)], "hard_brake"),
        (BRAKE, [event(Intention.HARD_BRAKE, 14.0, 14.5)], "nothing"),
        (BRAKE, [event(Intention.EVASIVE_SWERVE, 10.1, 10.8), event(Intention.HARD_BRAKE, 10.1, 10.2)], "hard_brake"),
        (BRAKE, [event(Intention.EVASIVE_SWERVE, 10.1, 10.8)], "evasive_swerve"),
        (BRAKE, [event(Intention.LEFT_LANE_CHANGE, 10.1, 10.8, "unresolved")], "unresolved"),
        (BRAKE, [event(Intention.FOLLOWING, 10.5, 10.5)], "following"),
        (FOLLOWING, [event(Intention.FOLLOWING, 10.5, 10.5)], "following"),
        (FOLLOWING, [event(Intention.FOLLOWING, 10.5, 10.5), event(Intention.HARD_BRAKE, 11.0, 11.3)], "hard_brake"),
        (FOLLOWING, [event(Intention.FOLLOWING, 20.0, 20.0)], "nothing"),
    ],
)
def test_what_the_detectors_make_of_a_maneuver(maneuver: GeneratedManeuver, events: list[Event], verdict: str) -> None:
    assert detected_as(maneuver, events) == verdict


def test_counts_become_a_table_and_leave_the_others() -> None:
    counts = {"generated hard_brake detected nothing": 1, "generated hard_brake detected hard_brake": 3, "cut_off": 2}
    assert agreement(counts) == {"hard_brake": {"hard_brake": 3, "nothing": 1}}
    assert other_counts(counts) == {"cut_off": 2}


@pytest.fixture(scope="module")
def recording() -> LabelledRecording:
    source = KinematicSource(KinematicSettings(per_class=8, following_scenes=8))
    return source.record(source.load(SCENARIO), 77)


def test_detectors_find_nearly_every_generated_maneuver(recording: LabelledRecording) -> None:
    """The definitions of the labels are met: by at least 19 of 20 maneuvers overall, and 7 of 8 of each intention."""
    table = agreement(agreement_counts(recording, label(recording, LabelSettings())))
    assert set(table) == {intention.text for intention in Intention}
    for intention, verdicts in table.items():
        assert sum(verdicts.values()) == 8
        assert verdicts.get(intention, 0) >= 7, (intention, verdicts)
    assert sum(verdicts.get(name, 0) for name, verdicts in table.items()) >= 0.95 * 56


def test_a_record_longer_than_a_scene_is_left_out(recording: LabelledRecording) -> None:
    around, motion = Surroundings(recording), MotionSettings()
    assert generated_candidates(recording, RecordSettings(), motion, around).left_out == {}
    longer = RecordSettings(duration_s=9.0, before_onset_s=6.5)
    offered = generated_candidates(recording, longer, motion, around)
    assert {candidate.intention for candidate in offered.samples} == {Intention.FOLLOWING}
    assert offered.left_out == {"tv_outside_track": 48}
