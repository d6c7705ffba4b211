"""The replay in a browser: the tracks and detections of a scene, and what the modules of a predictor do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from isac_cosim.evaluation.report.page import write_page
from isac_cosim.evaluation.report.parts import Part
from isac_cosim.evaluation.report.replay.content import (
    AnswersAlong,
    Detected,
    Inside,
    Moving,
    Replay,
    ShownAlarm,
    Told,
    TrackPath,
    VehicleNear,
)
from tests.support.browser import opened, serious_faults, texts_drawn


def track(number: str, from_s: float, instants: int) -> TrackPath:
    places = np.stack([np.linspace(0.0, 4.0 * instants, instants), np.full(instants, 3.0)])
    return TrackPath(number, from_s, 0.2, places, np.tile([[0.3], [0.1], [0.1]], (1, instants)))


def page_of(folder: Path, detected: bool) -> Path:
    path = np.stack([np.linspace(0.0, 100.0, 126), np.zeros(126)])
    found = Detected(0.0, 0.2, [np.array([[4.0 * k + 5.0, 1.0]]) if detected else np.empty((0, 2)) for k in range(26)])
    record = Moving(
        "a", "overtake", "natural", "tv", "uv", 0.0, [], path, path, path + 30.0,
        tracks=[track("417", 0.0, 26), track("523", 2.0, 5)], detected=found,
    )  # fmt: skip
    return write_page("Scene", [Part("replay", replay=Replay("Scene", [record], [], []))], "made up", folder)


def test_tracks_are_drawn_while_they_last(browser: Any, tmp_path: Path) -> None:
    shown = opened(browser, page_of(tmp_path, True))
    drawn = texts_drawn(shown)
    for time_ms, expected in ((100, {"417"}), (500, {"417", "523"}), (900, {"417"})):
        shown.fill("#replay-time", str(time_ms))
        assert {text for text in drawn() if text in ("417", "523")} == expected
    assert "2 tracks of the network near" in shown.text_content("#replay-status")
    assert shown.errors == []
    shown.context.close()


def test_detections_are_drawn(browser: Any, tmp_path: Path) -> None:
    pictures = []
    for detected in (False, True):
        folder = tmp_path / str(detected)
        folder.mkdir()
        shown = opened(browser, page_of(folder, detected))
        shown.fill("#replay-time", "400")
        pictures.append(shown.evaluate("document.getElementById('replay').toDataURL()"))
        shown.context.close()
    assert pictures[0] != pictures[1]


def test_a_chart_for_each_module_follows_the_time(browser: Any, tmp_path: Path) -> None:
    path = np.stack([np.linspace(0.0, 100.0, 126), np.zeros(126)])
    modules = [
        Inside("CPE: gate", ("in", "out"), np.full((2, 50), 0.5)),
        Inside("RSF: age, s", ("in",), np.full((1, 50), 1.7)),
    ]
    answers = AnswersAlong(1.0, 0.04, np.full((50, 2), 0.5), "overtake", False, modules)
    explained = Moving("a", "overtake", "natural", "tv", "uv", 0.0, [], path, path, path + 30.0, answers=answers)
    plain = Moving(
        "b",
        "overtake",
        "natural",
        "tv",
        "uv",
        0.0,
        [],
        path,
        path,
        path,
        answers=AnswersAlong(1.0, 0.04, answers.probabilities, None, None),
    )
    replay = Replay("Explained", [explained, plain], [], [], ["overtake", "following"])
    shown = opened(browser, write_page("Explained", [Part("replay", replay=replay)], "made up", tmp_path))
    drawn = texts_drawn(shown)
    shown.fill("#replay-time", "500")
    assert {"CPE: gate", "RSF: age, s", "in", "out", "2"} <= set(drawn())
    shown.select_option("#replay-record", "1")
    drawn()
    shown.fill("#replay-time", "600")
    assert "CPE: gate" not in drawn()
    assert serious_faults(shown) == []
    assert shown.errors == []
    shown.context.close()


def test_instructions_are_drawn_while_they_last(browser: Any, tmp_path: Path) -> None:
    path = np.stack([np.linspace(0.0, 100.0, 251), np.zeros(251)])
    hostile = "</script><b>v</b>"
    told = [
        Told("uv", "slow down", "hard brake of tv", 1.0, 2.0, 5.0, "followed to its end"),
        Told(hostile, "open the gap", "hard brake of tv", 1.0, None, None, "ignored by the driver"),
        Told("elsewhere", "hold the lane", "hard brake of tv", 7.0, 7.5, None, "under way"),
    ]
    other = VehicleNear(hostile, "car", 4.5, 1.8, 0.0, 0.2, path[:, ::5] + 5.0)
    record = Moving(
        "a", "hard_brake", "natural", "tv", "uv", 0.0, [], path, path, path - 30.0,
        others=[other], alarms=[ShownAlarm("hard_brake", 0.5, None)], about=f"On the alarm, vehicle {hostile} is told.",
        told=told,
    )  # fmt: skip
    replay = Replay("Told", [record], [], [], noun="moment")
    shown = opened(browser, write_page("Told", [Part("replay", replay=replay)], "made up", tmp_path))
    drawn = texts_drawn(shown)
    about = ", on the alarm for hard brake of tv"
    for time_ms, expected in (
        (70, {"alarm: hard brake"}),
        (150, {"slow down (told)", "open the gap (ignored by the driver)", f"uv: slow down (told){about}"}),
        (400, {"slow down (does so)", f"uv: slow down (does so){about}"}),
        (600, {"slow down (followed to its end)", f"uv: slow down (followed to its end){about}"}),
        (800, {f"elsewhere: hold the lane (does so){about}"}),
    ):
        shown.fill("#replay-time", str(time_ms))
        said = {text for text in drawn() if "(" in text or "alarm" in text}
        assert expected <= said
        assert len([text for text in said if "slow down" in text]) == (2 if 150 <= time_ms <= 600 else 0)
    assert f"vehicle {hostile} is told" in shown.text_content("#replay-status")
    assert serious_faults(shown) == []
    assert shown.errors == []
    shown.context.close()
