"""The definitions of a study: what is stored of them, and how other detectors are selected."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from isac_cosim.labeling.detectors.registry import DETECTORS
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Intention

STORED_ISAC_1 = (
    '{"preset":"isac-1","width_s":0.15,'
    '"lane_change":{"stay_s":1.0,"onset_mps":0.2,"pause_s":0.5},'
    '"overtake":{"horizon_s":30.0,"before_onset_s":1.0,"look_ahead_m":100.0},'
    '"hard_brake":{"threshold_mps2":4.0,"hold_s":0.5,"rest_mps2":0.5,"trace_back_s":3.0},'
    '"hard_accel":{"threshold_mps2":2.5,"hold_s":1.0,"rest_mps2":0.5,"trace_back_s":3.0},'
    '"evasive_swerve":{"threshold_mps2":3.0,"reversal_mps2":1.5,"reversal_s":2.5,"aside_m":0.4,"return_m":0.8,'
    '"return_s":5.0,"threat_ttc_s":4.0,"motion_mps":0.2,"rest_mps2":0.5},'
    '"following":{"headway_s":3.0,"clear_s":10.0,"before_s":2.6,"after_s":2.4,"check_s":0.5,"spacing_s":10.0}}'
)
"""The `labels` section of every dataset made with preset isac-1; fingerprints of datasets depend on it."""
STORED = (
    STORED_ISAC_1.partition('"following"')[0].replace("isac-1", "isac-2")
    + '"following":{"headway_s":3.0,"clear_s":10.0,"before_s":2.8,"after_s":2.6,"lateral_mps":0.2,'
    '"acceleration_mps2":2.0,"check_s":0.5,"spacing_s":10.0}}'
)
"""The same of preset isac-2."""


def test_the_default_definitions_are_stored_as_ever() -> None:
    assert LabelSettings().model_dump_json() == STORED
    assert LabelSettings.model_validate_json(STORED) == LabelSettings()


def test_the_definitions_of_an_earlier_preset_are_read_and_stored_as_they_were() -> None:
    former = LabelSettings.model_validate_json(STORED_ISAC_1)
    assert former.model_dump_json() == STORED_ISAC_1
    assert former == LabelSettings.model_validate({"preset": "isac-1"}) != LabelSettings()
    assert (former.following.lateral_mps, former.following.acceleration_mps2) == (None, None)
    assert (former.following.before_s, former.following.after_s) == (2.6, 2.4)
    for changed in ({"hard_brake": {"hold_s": 0.4}}, {"following": {"before_s": 2.8}}):
        with pytest.raises(ValidationError, match="differs from preset isac-1"):
            LabelSettings.model_validate({"preset": "isac-1", **changed})


def test_a_bound_that_is_absent_comes_back_absent() -> None:
    settings = LabelSettings.model_validate({"preset": "other", "following": {"lateral_mps": None}})
    assert LabelSettings.model_validate_json(settings.model_dump_json()) == settings


def test_every_intention_has_one_built_in_definition() -> None:
    defined = [intention for detector in LabelSettings().active_detectors().values() for intention in detector.finds]
    assert sorted(defined) == sorted(Intention)


def test_the_built_in_detectors_run_in_the_order_of_the_registry_with_their_sections() -> None:
    settings = LabelSettings()
    assert list(settings.active_detectors()) == list(DETECTORS)
    for name, detector in DETECTORS.items():
        assert type(getattr(settings, name)) is detector.settings_type


def test_a_preset_s_name_stands_for_its_values() -> None:
    for changed in ({"width_s": 0.2}, {"hard_brake": {"hold_s": 0.4}}):
        with pytest.raises(ValidationError, match="differs from preset isac-2"):
            LabelSettings.model_validate(changed)
        assert LabelSettings.model_validate({"preset": "other", **changed}) != LabelSettings()


def test_definitions_for_short_tracks_have_names_and_are_stored() -> None:
    assert "judged" not in LabelSettings().model_dump()["overtake"]  # as before there was a choice
    for preset, judged in (("isac-2-as-seen", "track"), ("isac-2-one-change", "never")):
        settings = LabelSettings.model_validate({"preset": preset})
        stored = settings.model_dump(mode="json")
        assert (stored["preset"], stored["overtake"]["judged"]) == (preset, judged)
        assert LabelSettings.model_validate(stored) == settings
        with pytest.raises(ValidationError, match=f"overtake differs from preset {preset}"):
            LabelSettings.model_validate({"preset": preset, "overtake": {"judged": "horizon"}})
    with pytest.raises(ValidationError, match="differs from preset isac-2"):
        LabelSettings.model_validate({"overtake": {"judged": "track"}})


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("hard_brakes", "unknown detector 'hard_brakes': did you mean hard_brake"),
        ("hard_brake", r"hard_brake is built in and always selected; its settings are in labels\.hard_brake"),
    ],
)
def test_only_other_detectors_can_be_selected(name: str, message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        LabelSettings.model_validate({"preset": "other", "detectors": {name: {}}})
