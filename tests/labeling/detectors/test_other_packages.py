"""Detectors that other installed packages offer: selected by a study, they replace built-in definitions."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path

import pytest
from pydantic import ValidationError

from isac_cosim.base.errors import InputError
from isac_cosim.base.registry import Registry
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.registry import DETECTORS
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Intention
from isac_cosim.labeling.road.straight_road import ScriptedVehicle, straight_road
from isac_cosim.labeling.samples.candidates import RecordSettings, candidates
from isac_cosim.labeling.samples.uv_choice import PairSettings

PACKAGE = '''
"""Detectors by other definitions than the built-in ones."""

from dataclasses import dataclass, replace

from pydantic import Field

from isac_cosim.base.settings import Settings
from isac_cosim.labeling.detectors.threshold_crossings import intervals_above
from isac_cosim.labeling.intentions import Event, Intention


class GentleSettings(Settings):
    threshold_mps2: float = Field(1.0, gt=0.0, description="minimum deceleration, m/s2")


@dataclass(frozen=True)
class GentleBrake:
    """Any deceleration above a threshold is a brake."""

    settings_type = GentleSettings
    finds = (Intention.HARD_BRAKE,)
    settings: GentleSettings

    def detect(self, view):
        intervals = intervals_above(view.motion.times, -view.motion.a, self.settings.threshold_mps2)
        return [Event(view.vehicle, Intention.HARD_BRAKE, a, a, b, -1.0) for a, b in intervals]


class WrongIntention(GentleBrake):
    """Finds brakes, but says that it finds swerves."""

    finds = (Intention.EVASIVE_SWERVE,)


class Backwards(GentleBrake):
    """Returns events that end before they begin."""

    def detect(self, view):
        return [replace(event, end=event.onset - 1.0) for event in super().detect(view)]


class EveryPullOut(GentleBrake):
    """Every left lane change is an overtake of vehicle `slow`."""

    finds = (Intention.OVERTAKE,)

    def detect(self, view):
        left = [change for change in view.lane_changes if change.intention is Intention.LEFT_LANE_CHANGE]
        return [replace(e, intention=Intention.OVERTAKE, other="slow", motion_end=e.end, end=e.end + 3) for e in left]


class NoLeftChange(GentleBrake):
    """Nobody ever changes to the left."""

    finds = (Intention.LEFT_LANE_CHANGE,)

    def detect(self, view):
        return []


class Quiet(GentleBrake):
    """Following is wherever no other detector has found an event."""

    finds = (Intention.FOLLOWING,)

    def detect(self, view):
        return [] if view.events else [Event(view.vehicle, Intention.FOLLOWING, 5.0, 5.0, 6.0, 0.0)]


def not_a_detector():
    pass
'''
ENTRY_POINTS = """
[isac_cosim.detectors]
gentle_brake = other_detectors:GentleBrake
gentle_too = other_detectors:GentleBrake
wrong_intention = other_detectors:WrongIntention
backwards = other_detectors:Backwards
every_pull_out = other_detectors:EveryPullOut
no_left = other_detectors:NoLeftChange
quiet = other_detectors:Quiet
not_a_detector = other_detectors:not_a_detector
missing = no_such_package:Detector
"""
BRAKES = ScriptedVehicle("brakes", speed=[(10, 30), (12, 18), (20, 18), (24, 10)], duration_s=60.0)
"""Brakes at 6 m/s2, and later at 2 m/s2."""
PULLS_OUT = ScriptedVehicle("brakes", speed=25.0, lateral=[(10, 0.0), (14, 3.2)], duration_s=60.0)


@pytest.fixture(autouse=True)
def _installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An installed package that offers detectors, importable and with metadata."""
    (tmp_path / "other_detectors.py").write_text(PACKAGE)
    metadata = tmp_path / "other_detectors-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: other-detectors\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(ENTRY_POINTS)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "other_detectors", raising=False)
    built_in = {name: DETECTORS[name] for name in LabelSettings().active_detectors()}
    registry = Registry("detector", built_in, "isac_cosim.detectors")
    monkeypatch.setattr("isac_cosim.labeling.detectors.settings.DETECTORS", registry)


def selecting(**detectors: dict[str, float]) -> LabelSettings:
    return LabelSettings.model_validate({"preset": "other", "detectors": detectors})


def times(settings: LabelSettings, intention: Intention = Intention.HARD_BRAKE) -> list[int]:
    """Rounded onsets of the events of one intention where a vehicle brakes twice, s."""
    return [round(event.onset) for event in label(straight_road(BRAKES), settings).of(intention)]


def test_installed_but_not_selected_changes_nothing() -> None:
    assert times(LabelSettings()) == [10]
    assert "detectors" not in LabelSettings().model_dump(mode="json")


def test_a_selected_detector_replaces_the_built_in_definition_of_its_intention() -> None:
    """Were the built-in brakes kept, the one at 10 s would be there twice."""
    assert times(selecting(gentle_brake={})) == [10, 20]
    assert times(selecting(gentle_brake={"threshold_mps2": 3.0})) == [10]
    assert list(selecting(gentle_brake={}).active_detectors()) == [
        "lane_change", "overtake", "hard_accel", "evasive_swerve", "gentle_brake", "following"
    ]  # fmt: skip


def test_its_settings_are_stored_and_read_back() -> None:
    settings = selecting(gentle_brake={})
    stored = settings.model_dump(mode="json")
    assert stored["detectors"] == {"gentle_brake": {"threshold_mps2": 1.0}}
    assert LabelSettings.model_validate(stored) == settings
    assert times(pickle.loads(pickle.dumps(settings))) == [10, 20]


def test_following_keeps_clear_of_its_events() -> None:
    """Following begins 10 s after the last brake that counts: the one at 12 s, or the one at 24 s."""
    leads = ScriptedVehicle("leads", speed=BRAKES.speed, start_m=30.0, duration_s=60.0)
    recording = straight_road(BRAKES, leads)
    onsets = {}
    for name, settings in (("built-in", LabelSettings()), ("gentle", selecting(gentle_brake={}))):
        following = label(recording, settings).of(Intention.FOLLOWING)
        onsets[name] = min(event.onset for event in following if event.vehicle == "brakes")
    assert onsets["built-in"] < 30.0
    assert onsets["gentle"] >= 34.0


def test_of_a_detector_of_two_intentions_one_can_be_replaced() -> None:
    """The lane changes themselves stay known, with marks of the overtake rule or without."""
    out_and_back = ScriptedVehicle("tv", lateral=[(10, 0.0), (14, 3.2), (18, 3.2), (22, 0.0)], start_m=1000.0)
    recording = straight_road(out_and_back, PULLS_OUT, ScriptedVehicle("slow", 10.0, start_m=220.0, duration_s=60.0))
    built_in, labels = label(recording, LabelSettings()), label(recording, selecting(no_left={}))
    assert {event.mark for event in built_in.of(Intention.LEFT_LANE_CHANGE)} == {None, "passed_did_not_return"}
    assert labels.of(Intention.LEFT_LANE_CHANGE) == []
    assert labels.of(Intention.RIGHT_LANE_CHANGE) == built_in.of(Intention.RIGHT_LANE_CHANGE) != []
    assert (labels.changes, labels.counts) == (built_in.changes, built_in.counts)


def test_a_detector_of_following_runs_last() -> None:
    assert times(selecting(quiet={}), Intention.FOLLOWING) == []
    assert list(selecting(quiet={}, gentle_brake={}).active_detectors())[-1] == "quiet"


def test_an_overtake_of_another_vehicle_than_the_uv_is_a_left_lane_change() -> None:
    """The vehicle ahead is passed by nobody: by the built-in rule no vehicle is overtaken."""
    ahead = ScriptedVehicle("ahead", speed=25.0, start_m=60.0, duration_s=60.0)
    for vehicle, expected in (("ahead", Intention.LEFT_LANE_CHANGE), ("slow", Intention.OVERTAKE)):
        uv = ScriptedVehicle(vehicle, ahead.speed, ahead.lateral, ahead.start_m, ahead.duration_s)
        recording = straight_road(PULLS_OUT, uv)
        labels = label(recording, selecting(every_pull_out={}))
        (event,) = labels.of(Intention.OVERTAKE)
        assert labels.of(Intention.LEFT_LANE_CHANGE) == []
        samples = candidates(recording, labels, PairSettings(), RecordSettings()).samples
        (sample,) = [sample for sample in samples if sample.intention is not Intention.FOLLOWING]
        assert (sample.uv, sample.intention) == (vehicle, expected)
        assert sample.t_end == (event.end if expected is Intention.OVERTAKE else event.motion_end)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "wrong_intention",
            "detector wrong_intention: returned an event <Intention.HARD_BRAKE: 0> of vehicle 'brakes'",
        ),
        ("backwards", r"detector backwards: returned an event with onset 9\.\d+, commit 9\.\d+ and end 8\.\d+; fix"),
    ],
)
def test_events_that_it_may_not_return_are_reported(name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        label(straight_road(BRAKES), selecting(**{name: {}}))


@pytest.mark.parametrize(
    ("detectors", "message"),
    [
        ({"gentle_brake": {}, "gentle_too": {}}, "gentle_brake and gentle_too both find hard_brake; select one"),
        ({"gentle_brake": {"threshold_mps2": -1.0}}, r"gentle_brake\.threshold_mps2: Input should be greater than 0"),
        ({"gentle_brake": {"treshold_mps2": 1.0}}, r"gentle_brake\.treshold_mps2: Extra inputs are not permitted"),
        ({"not_a_detector": {}}, "not_a_detector is not a detector class"),
        ({"gentle_break": {}}, "unknown detector 'gentle_break': did you mean gentle_brake"),
    ],
)
def test_a_wrong_selection_is_refused(detectors: dict[str, dict[str, float]], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        selecting(**detectors)


def test_a_package_that_cannot_be_imported_is_named() -> None:
    with pytest.raises(InputError, match="detector missing: package other-detectors cannot be imported"):
        selecting(missing={})


def test_selected_definitions_need_a_preset_name_of_their_own() -> None:
    with pytest.raises(ValidationError, match="detectors differs from preset isac-2"):
        LabelSettings.model_validate({"detectors": {"gentle_brake": {}}})
