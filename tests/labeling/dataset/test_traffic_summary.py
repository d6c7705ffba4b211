"""What a dataset says of its traffic: numbers with what they are of, and one line for each thing to know."""

from __future__ import annotations

from typing import Any

from isac_cosim.isacsim.traffic.recordings.sumo_messages import SumoWarning
from isac_cosim.isacsim.traffic.recordings.traffic_facts import TrafficFacts
from isac_cosim.labeling.dataset.shard import Episode
from isac_cosim.labeling.dataset.traffic_summary import seconds_text, share_text, traffic_faults, traffic_summary

SLOW = SumoWarning(kind="'...' is slow", count=3, example="'a' is slow")


def episode(seed: int, collided: int = 0, scenario: str = "road", **facts: Any) -> Episode:
    content = {"from_s": 90.0, "to_s": 330.0, "vehicles": 30, "recorded": 20, "by_class": {"passenger": 30}, **facts}
    return Episode(scenario=scenario, seed=seed, collided=collided, traffic=TrafficFacts.model_validate(content))


def test_numbers_come_with_what_they_are_of() -> None:
    values = traffic_summary([episode(1, 13), episode(2)])
    assert share_text(values, "collided", 13) == "13 of 60 vehicles"
    assert share_text(values, "teleported", 0) == "0 of 60 vehicles"
    assert traffic_faults(values) == [
        "13 of 60 vehicles collided and are in no sample: SUMO's warnings name places",
    ]


def test_a_dataset_that_does_not_know_its_vehicles_names_the_number_alone() -> None:
    """Earlier datasets, and those of other sources; also one whose other half was made by an earlier version."""
    assert traffic_summary([Episode(scenario="road", seed=1, collided=2)]) is None
    assert share_text(None, "collided", 2) == "2"
    assert traffic_faults(None) == []
    assert share_text(traffic_summary([episode(1), Episode(scenario="road", seed=2, collided=2)]), "collided", 2) == "2"


def test_each_kind_of_warning_is_one_line_with_number_and_example() -> None:
    once = SumoWarning(kind="odd", count=1, example="odd")
    values = traffic_summary([episode(1, warnings=(once, SLOW)), episode(2, warnings=(SLOW,)), episode(3)])
    assert values is not None
    assert [(row["count"], row["episodes"]) for row in values["warnings"]] == [(6, 2), (1, 1)]
    assert traffic_faults(values) == [
        "SUMO warned 6 times in 2 episodes, for example: 'a' is slow",
        "SUMO warned once: odd",
    ]


def test_many_kinds_of_warnings_are_not_all_shown() -> None:
    kinds = tuple(SumoWarning(kind=f"kind {'x' * k}", count=20 - k, example=str(k)) for k in range(11))
    lines = traffic_faults(traffic_summary([episode(1, warnings=kinds)]))
    assert len(lines) == 9
    assert lines[-1] == "SUMO gave 33 more warnings of 3 other kinds: `inspect --json` shows them"


def test_a_span_without_vehicles_is_named_with_the_first_departure() -> None:
    empty = {"vehicles": 0, "recorded": 0, "by_class": {}, "first_departure_s": 25_205.0}
    lines = traffic_faults(traffic_summary([episode(1, **empty), episode(2, **empty), episode(3)]))
    assert len(lines) == 1
    assert lines[0].startswith(
        "road: no vehicle between 90 and 330 s in 2 of 3 episodes; the first departs at 25,205 s: set `begin`"
    )
    unknown = {**empty, "first_departure_s": None}
    assert "none of its demand departs at a known time" in traffic_faults(traffic_summary([episode(1, **unknown)]))[0]


def test_a_span_in_which_all_collided_is_not_empty() -> None:
    assert not any("no vehicle" in line for line in traffic_faults(traffic_summary([episode(1, 30, recorded=0)])))


def test_discarded_vehicles_and_classes_that_are_no_cars_are_named() -> None:
    classes = {"passenger": 20, "bus": 2, "bicycle": 7, "tram": 1}
    assert traffic_faults(traffic_summary([episode(1, discarded=133, by_class=classes)])) == [
        "SUMO discarded 133 vehicles that found no room to depart in time (`max-depart-delay`); 30 departed",
        "8 of 30 vehicles are neither cars nor trucks (bicycle 7, tram 1): they echo and block as cars do; "
        "`pairs.tv_kinds` and `pairs.uv_kinds` leave classes out",
    ]


def test_times_are_written_in_full() -> None:
    assert seconds_text(1_732_518_000.0) == "1,732,518,000"
    assert seconds_text(123_456.75) == "123,456.75"
    assert seconds_text(90.0) == "90"
