"""Studies of earlier versions are read as they were meant; those of this version as they are."""

from isac_cosim.labeling.generation.settings import FORMER, DatasetStudy, as_stored


def test_a_stored_study_of_this_version_is_read_as_it_is() -> None:
    stored = DatasetStudy().model_dump(mode="json")
    assert as_stored(stored) == stored
    assert DatasetStudy.model_validate(as_stored(stored)) == DatasetStudy()


def test_what_an_earlier_version_did_not_store_is_as_it_was_then() -> None:
    stored = DatasetStudy().model_dump(mode="json")
    del stored["traffic"]["speed_wander"]
    del stored["maneuvers"]["hard_brake"]["rise_s"]
    del stored["maneuvers"]["lane_change"]["clear_s"]
    study = DatasetStudy.model_validate(as_stored(stored))
    assert study.traffic.speed_wander.sd_share == (0.0, 0.0)
    assert study.maneuvers.hard_brake.rise_s == (0.0, 0.0)
    assert study.maneuvers.lane_change.clear_s == 0.0
    assert "speed_wander" not in stored["traffic"], "what was given is left alone"


def test_every_former_value_is_another_than_todays_default() -> None:
    """Otherwise it would not have to be named."""
    today = DatasetStudy().model_dump()
    for path, value in FORMER.items():
        section = today
        for key in path:
            section = section[key]
        assert section != value, path


def test_sections_that_are_not_stored_stay_away() -> None:
    assert as_stored({"scenarios": ["motorway"]}) == {"scenarios": ["motorway"]}
