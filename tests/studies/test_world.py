"""The world of a figure is the same on every processor."""

from __future__ import annotations

import pytest

from isac_cosim.isacsim.scenarios import reference_line
from isac_cosim.studies.world import constants, differing, digests

ROOM = ["isacsim.scenarios.reference_line"]
WIDTHS = "isacsim.scenarios.reference_line.WIDTHS_M"


def test_the_last_digits_of_what_a_processor_computes_are_no_setting(monkeypatch: pytest.MonkeyPatch) -> None:
    before = {"traffic": constants(ROOM)}
    widths = reference_line.WIDTHS_M
    elsewhere = widths * (1 + 2**-52)
    assert (elsewhere != widths).any()
    monkeypatch.setattr(reference_line, "WIDTHS_M", elsewhere)
    now = {"traffic": constants(ROOM)}
    assert digests(now) == digests(before)
    assert not differing(before, now)
    recorded = {"traffic": {**before["traffic"], WIDTHS: elsewhere.tolist()}}
    assert not differing(recorded, now)
    monkeypatch.setattr(reference_line, "WIDTHS_M", widths * (1 + 1e-9))
    assert differing(before, {"traffic": constants(ROOM)}) == {"traffic": [WIDTHS]}


def test_only_the_parts_that_the_present_rests_on_count() -> None:
    before = {"traffic": {"a.A_M": 1.0}, "recordings": {"b.B_M": 2.0}}
    assert not differing(before, {"traffic": {"a.A_M": 1.0}})
    assert differing({"traffic": {"a.A_M": 1.0}}, before) == {"recordings": ["b.B_M"]}
    assert differing(before, {"traffic": {}}) == {"traffic": ["a.A_M"]}


def test_figures_of_lone_vehicles_do_not_rest_on_how_scenes_are_sensed() -> None:
    rolling, gate = "isacsim.scene.rolling.ACROSS_MPS", "isacsim.tracking.kalman.GATE"
    # Records from before scenes were a part of their own hold their constants among those of sensing.
    before = {"sensing": {gate: 1.0, rolling: 0.1}}
    assert not differing(before, {"sensing": {gate: 1.0}})
    assert differing(before, {"sensing": {gate: 2.0}}) == {"sensing": [gate]}
    assert differing(before, {"sensing": {gate: 1.0}, "scene": {rolling: 0.2}}) == {"scene": [rolling]}
