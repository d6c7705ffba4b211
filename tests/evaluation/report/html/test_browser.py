"""The page in a browser: Debian's chromium, driven by Playwright. Skipped where one of them is missing."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from isac_cosim.evaluation.on_windows.evaluation import evaluate_records
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.evaluation.report.figures import draw_figures
from isac_cosim.evaluation.report.first_screen import confused
from isac_cosim.evaluation.report.page import write_page as write_parts
from isac_cosim.evaluation.report.parts import Part
from isac_cosim.evaluation.report.replay.content import AnswersAlong, Maneuver, Moving, Replay, ShownAlarm
from isac_cosim.evaluation.report.replay.making import replay_of
from isac_cosim.evaluation.report.report import write_page
from isac_cosim.labeling.dataset.finding import find_episode
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.data.windows import Records
from isac_cosim.models.runs.run import Run
from tests.evaluation.report.replay.test_making import HereEngine
from tests.support.browser import opened, serious_faults, texts_drawn
from tests.support.made_up import MADE_OF
from tests.support.made_up_dataset import write_dataset

HOSTILE = "</script><script>document.title='taken'</script><b>"


@pytest.fixture(scope="module")
def page_file(records: Records, trees_run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of an evaluation, its replay with a hostile name and at least one wrong record."""
    folder = tmp_path_factory.mktemp("browser")
    dataset = write_dataset(folder / "data")
    evaluation = evaluate_records(trees_run, records, MADE_OF, folder / "out", EvaluateSettings(ends_per_record=2))
    draw_figures(evaluation, folder / "out")
    shown = replay_of(dataset, find_episode(dataset, "toy-1"), HereEngine(), trees_run)
    *kept, last = shown.records
    assert last.answers is not None
    last = replace(last, tv_id=HOSTILE, answers=replace(last.answers, predicted="overtake", wrong=True))
    cells = confused(evaluation.measured[0].predictions, evaluation.result)
    cell = next(iter(cells))
    cells = {**cells, cell: [kept[2].id, *cells[cell]]}
    return write_page(
        evaluation.result, folder / "out", "", Replay(**{**shown.__dict__, "records": [*kept, last]}), cells
    )


@pytest.fixture
def page(browser: Any, page_file: Path) -> Iterator[Any]:
    shown = opened(browser, page_file)
    yield shown
    assert shown.errors == []
    shown.context.close()


def at(page: Any) -> float:
    return float(page.get_attribute("#replay", "data-time"))


def which(page: Any) -> str:
    return str(page.get_attribute("#replay", "data-record"))


def test_the_page_asks_for_no_other_file(page: Any, page_file: Path) -> None:
    assert [url for url in page.requests if not url.startswith("data:")] == [page_file.as_uri()]
    assert page.title() != "taken"
    assert page.locator("b").count() == 3  # The three figures.


def test_its_curves_are_those_of_the_evaluation(page: Any) -> None:
    chart = page.locator(".chart").first  # The ROC: lead times have too few windows.
    chart.locator("..").scroll_into_view_if_needed()
    chart.locator("svg.main-svg").first.wait_for()
    chart.focus()
    page.keyboard.press("ArrowRight")
    read = r"\(AUROC [\d.]+\): share of known kept 0\.000 \(share of following taken for known: 0\)"
    assert re.search(read, chart.locator(".reading").text_content())


def test_space_plays_and_pauses_and_arrows_step(page: Any) -> None:
    page.focus("#replay")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    assert at(page) == pytest.approx(0.08)
    page.keyboard.press("Shift+ArrowRight")
    assert at(page) == pytest.approx(0.58)
    page.keyboard.press("ArrowLeft")
    assert at(page) == pytest.approx(0.54)
    page.keyboard.press("Space")
    page.wait_for_function("Number(document.getElementById('replay').dataset.time) > 0.7")
    page.keyboard.press("Space")
    paused = at(page)
    assert page.text_content("#replay-play") == "Play"
    page.wait_for_timeout(150)
    assert at(page) == paused


def test_playing_ends_at_the_end_and_begins_anew(page: Any) -> None:
    page.focus("#replay")
    page.keyboard.press("End")
    end = at(page)
    assert end == pytest.approx(4.96)
    page.keyboard.press("Space")
    page.wait_for_function(f"Number(document.getElementById('replay').dataset.time) < {end - 1}")


def test_records_are_chosen_by_key_picker_and_cell(page: Any) -> None:
    first = which(page)
    page.focus("#replay")
    page.keyboard.press("ArrowDown")
    second = which(page)
    assert second != first
    page.keyboard.press("ArrowUp")
    assert which(page) == first
    page.select_option("#replay-record", "1")
    assert which(page) == second
    third = page.get_attribute("[data-record]:not(canvas)", "data-record")
    cell = page.locator("button[data-cell]").first
    cell.click()
    assert cell.get_attribute("aria-expanded") == "true"
    page.click(f"button[data-record='{third}']")
    assert which(page) == third
    cell.click()
    assert cell.get_attribute("aria-expanded") == "false"


def test_w_finds_the_next_wrong_record(page: Any) -> None:
    page.focus("#replay")
    page.keyboard.press("w")
    assert "wrong" in page.text_content("#replay-status")
    assert "✗" in page.locator("#replay-record option:checked").text_content()
    number = page.locator("#replay-record option").count() - 1
    page.select_option("#replay-record", str(number))
    assert HOSTILE in page.text_content("#replay-status")


def test_the_road_and_the_probabilities_are_drawn(page: Any) -> None:
    page.fill("#replay-time", "900")
    for canvas in ("replay", "replay-answers"):
        colours = page.evaluate(
            f"""() => {{
              const canvas = document.getElementById('{canvas}'), pen = canvas.getContext('2d');
              const data = new Uint32Array(pen.getImageData(0, 0, canvas.width, canvas.height).data.buffer);
              return new Set(data).size;
            }}"""
        )
        assert colours > 20


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [400, 1280, 1920])
def test_nothing_scrolls_sideways(browser: Any, page_file: Path, width: int, scheme: str) -> None:
    shown = opened(browser, page_file, width, scheme)
    assert shown.evaluate("document.documentElement.scrollWidth") <= width
    shown.select_option("#theme", "projector")
    assert shown.evaluate("document.documentElement.scrollWidth") <= width
    assert shown.errors == []
    shown.context.close()


@pytest.mark.parametrize("theme", ["light", "dark", "projector"])
def test_axe_finds_nothing_serious(browser: Any, page_file: Path, theme: str) -> None:
    shown = opened(browser, page_file)
    shown.select_option("#theme", theme)
    shown.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    assert serious_faults(shown) == []
    shown.context.close()


@pytest.mark.parametrize("damage", ["", "{", '{"records": []}'])
def test_a_page_without_its_data_says_so(browser: Any, page_file: Path, tmp_path: Path, damage: str) -> None:
    text = page_file.read_text()
    begin = text.index('id="replay-data">') + len('id="replay-data">')
    (tmp_path / "damaged.html").write_text(text[:begin] + damage + text[text.index("</script>", begin) :])
    shown = opened(browser, tmp_path / "damaged.html")
    assert re.search("data are missing from this page", shown.text_content("#replay-status"))
    assert shown.errors == []
    shown.context.close()


@pytest.fixture(scope="module")
def live_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a stretch of traffic in which a false alarm for a brake comes before a swerve that nobody foresaw."""
    folder, places = tmp_path_factory.mktemp("live"), np.stack([np.linspace(0.0, 200.0, 226), np.zeros(226)])
    stretch = Moving(
        "road-1-tv-5.0", "hard_brake", "natural", "tv", HOSTILE, 10.0,
        [Maneuver("left_lane_change", 0.5, 1.5), Maneuver("evasive_swerve", 6.0, 7.5, "near miss")],
        places, places[:, 50:150] + 0.5, places[:, 100:] + 30.0,
        answers=AnswersAlong(1.0, 0.1, np.tile([0.9, 0.02, 0.02, 0.02, 0.02, 0.02], (60, 1)), None, True),
        alarms=[ShownAlarm("left_lane_change", 0.8, False), ShownAlarm("hard_brake", 5.0, True)],
        sensed_from_s=2.0, uv_from_s=4.0, name=f"False alarm {HOSTILE}", about=f"TV tv {HOSTILE}.",
    )  # fmt: skip
    classes = [intention.text for intention in KNOWN]
    shown = Replay("Moments", [stretch, replace(stretch, id="other")], [(3.2, places.T)], [], classes, noun="moment")
    return write_parts("Live", [Part("live-replay", replay=shown)], "made up", folder)


def test_a_moment_of_traffic_moves_with_its_alarms_and_without_an_uv_at_first(browser: Any, live_file: Path) -> None:
    shown = opened(browser, live_file)
    drawn = texts_drawn(shown)
    shown.focus("#replay")
    shown.keyboard.press("Home")
    said = drawn()
    assert "left lane change, before onset" in said
    assert "UV" not in said
    assert "alarm" not in said
    for time_ms, expected in ((100, ["left lane change, begun", "✓ alarm: left lane change"]),
                              (600, ["evasive swerve (near miss), before onset", "✗ false alarm: hard brake", "UV"]),
                              (1000, ["evasive swerve (near miss), committed", "✗ alarm", "✓ alarm"])):  # fmt: skip
        shown.fill("#replay-time", str(time_ms))
        said = drawn()
        assert [text for text in expected if text not in said] == []
    assert "false alarm: " not in said  # It has passed.
    assert HOSTILE in shown.text_content("#replay-status")
    assert HOSTILE in shown.locator("#replay-record option").first.text_content()
    assert shown.locator("#replay-wrong").count() == 0
    shown.keyboard.press("ArrowDown")
    assert shown.errors == []
    assert shown.title() != "taken"
    shown.context.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_page_of_traffic_fits_a_phone(browser: Any, live_file: Path, scheme: str) -> None:
    shown = opened(browser, live_file, 400, scheme)
    assert shown.evaluate("document.documentElement.scrollWidth") <= 400
    assert shown.errors == []
    shown.context.close()
