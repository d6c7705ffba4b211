"""Curves that the page draws itself: from the rows of its tables, in a browser, and where no script runs."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from isac_cosim.evaluation.report.html.charts import Chart
from isac_cosim.evaluation.report.page import packed_plotly, write_page
from isac_cosim.evaluation.report.parts import Part, Row, read_table, write_table
from isac_cosim.evaluation.statistics import Estimate
from tests.support.browser import opened, serious_faults

HOSTILE = "b</script><script>document.title='taken'</script><b>%{y}"
LEAD = Chart("lead s", ("F1",), backwards=True, guide=(0.0, "commit"), least=20, whole=("over", 6))
ROWS: list[Row] = [
    {"predictor": name, "lead s": lead, "windows": windows, "F1": score, "over": over}
    for name in ("a", HOSTILE)
    for lead, windows, score, over in ((-0.5, 40, 0.9, 6), (0.0, 40, 0.8, 5), (0.5, 40, None, 0), (1.0, 5, 0.1, 6))
]
SEVEN: list[Row] = [{"predictor": f"run {k}", "at": x, "F1": k / 10 + x / 20} for k in range(7) for x in (0, 1, 2)]
ALARMS: list[Row] = [
    {"predictor": "a", "alarms": "any", "rate": 0.0, "recall": 0.25},
    {"predictor": "a", "alarms": "any", "rate": 2.0, "recall": 0.5},
    {"predictor": "a", "alarms": "frozen", "rate": 1.0, "recall": 0.4},
    {"predictor": "rule", "alarms": "frozen", "rate": 3.0, "recall": 0.7},
]
CURVE = Chart(
    "rate", ("recall",), ranges=((0.03, 100.0), (0.0, 1.02)), log=True, stairs=True, single=("alarms", "frozen")
)
BLUE = "rgb(109, 184, 242)"
"""The colour of the first line in the dark theme."""


def test_lines_hold_the_values_of_the_rows_that_are_drawn() -> None:
    first, second = LEAD.content(ROWS)["lines"]
    assert (first["name"], first["x"], first["y"], first["hollow"]) == ("a", [-0.5, 0.0], [0.9, 0.8], [False, True])
    assert second["name"] == HOSTILE
    assert not LEAD.hollow({"predictor": "of an earlier version", "over": None})
    assert len(LEAD.drawn(ROWS)) == 6


def test_panels_share_rows_and_marks_stand_apart_from_lines() -> None:
    rows: list[Row] = [{"predictor": "a", "at": 1.0, "up": Estimate(value=0.25), "down": float("nan")}]
    assert [line["y"] for line in Chart("at", ("up", "down")).content(rows)["lines"]] == [[0.25]]
    lines = CURVE.content(ALARMS)["lines"]
    assert [(line["name"], line["single"], line["x"]) for line in lines] == [
        ("a", False, [0.0, 2.0]), ("a", True, [1.0]), ("rule", True, [3.0]),
    ]  # fmt: skip


def test_a_table_is_read_as_it_was_written(tmp_path: Path) -> None:
    rows: list[Row] = [{"name": "a,\n<b>", "n": 3, "score": 0.125, "none": None}]
    write_table(rows, tmp_path / "table.csv")
    assert read_table(tmp_path / "table.csv") == [{"name": "a,\n<b>", "n": 3.0, "score": 0.125, "none": None}]


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b'a,b\n"1', b"", b"a\n1,2,3\n"])
def test_a_damaged_table_breaks_no_page(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "table.csv").write_bytes(content)
    rows = read_table(tmp_path / "table.csv")
    assert Chart("a", ("b",)).content(rows)["lines"] == []
    assert read_table(tmp_path / "missing.csv") == []


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("charts")
    names = ("lead.png", "seven.png", "alarms.png", "picture.png")
    for name in names:
        Figure(figsize=(4, 2)).savefig(folder / name)
    part = Part(
        "figures",
        figures=[(name, f"What {name} shows.") for name in names],
        seen={"lead.png": "F1 falls from 0.9 to 0.8."},
        figure_rows={"lead.png": ROWS, "seven.png": SEVEN, "alarms.png": ALARMS},
        charts={"lead.png": LEAD, "seven.png": Chart("at", ("F1", "F1")), "alarms.png": CURVE},
    )
    return write_page("Curves", [part, replace(part, name="again")], "made up", folder)


def draw_all(page: Any) -> None:
    """Go down the page: a curve is drawn when it comes near."""
    for chart in page.locator(".chart").all():
        chart.locator("..").scroll_into_view_if_needed()
        chart.locator("svg.main-svg").first.wait_for()
    page.evaluate("window.scrollTo(0, 0)")


def test_curves_far_down_are_pictures_until_they_come_near(browser: Any, page_file: Path, tmp_path: Path) -> None:
    far = page_file.read_text().replace("<h1>", "<div style='height: 9000px'></div><h1>")
    (tmp_path / "far.html").write_text(far)
    shown = opened(browser, tmp_path / "far.html")
    shown.wait_for_timeout(300)
    assert shown.evaluate("typeof Plotly") == "undefined"
    draw_all(shown)
    assert shown.locator(".chart:visible").count() == 6
    shown.context.close()


@pytest.fixture
def page(browser: Any, page_file: Path) -> Iterator[Any]:
    shown = opened(browser, page_file)
    draw_all(shown)
    yield shown
    assert shown.errors == []
    shown.context.close()


def test_the_library_is_on_the_page_once_and_small(page_file: Path, tmp_path: Path) -> None:
    text = page_file.read_text()
    assert text.count('id="plotly"') == 1
    assert len(text) < 3_000_000
    assert 'id="plotly"' not in write_page("None", [Part("a", text="No curve.")], "", tmp_path).read_text()


def test_an_environment_without_the_library_makes_a_page_of_pictures(
    page_file: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    packed_plotly.cache_clear()
    part = Part("a", figures=[("lead.png", "F1.")], figure_rows={"lead.png": ROWS}, charts={"lead.png": LEAD})
    text = write_page("Curves", [part], "", tmp_path, page_file.parent).read_text()
    packed_plotly.cache_clear()
    assert "data:image/png" in text
    assert 'id="plotly"' not in text


def test_curves_replace_their_pictures_and_ask_for_nothing(page: Any, page_file: Path) -> None:
    assert page.locator(".chart svg.main-svg").first.is_visible()
    assert page.locator(".chart:visible").count() == 6
    assert page.locator("figure img:visible").count() == 2  # Those without curves.
    assert page.locator("figure").first.locator(".scatterlayer .trace").count() == 2
    assert page.locator("figure").nth(2).locator(".scatterlayer .trace").count() == 3
    assert [url for url in page.requests if not url.startswith(("data:", "blob:"))] == [page_file.as_uri()]
    assert page.title() == "Curves"


def test_values_are_read_by_pointer_and_by_key(page: Any) -> None:
    first = page.locator(".chart").first
    first.focus()
    page.keyboard.press("ArrowRight")
    assert first.locator(".reading").text_content() == "a: F1 0.900 (lead s: -0.5)"
    assert first.locator(".hoverlayer").text_content() == "a: 0.900 at -0.5"
    page.keyboard.press("ArrowLeft")  # To the left there is more time.
    assert first.locator(".reading").text_content() == "a: F1 0.800 (lead s: 0)"
    page.keyboard.press("ArrowDown")
    assert first.locator(".reading").text_content() == f"{HOSTILE}: F1 0.800 (lead s: 0)"
    page.keyboard.press("Escape")
    assert first.locator(".reading").text_content() == ""
    alarms = page.locator(".chart").nth(2)
    alarms.focus()
    page.keyboard.press("ArrowRight")
    assert alarms.locator(".reading").text_content() == "a: recall 0.250 (rate: 0)"  # Left of a logarithmic axis.


def test_lines_differ_in_mark_or_dash_and_can_be_left_out(page: Any) -> None:
    seven = page.locator(".chart").nth(1)
    looks = page.evaluate(
        """() => [...document.querySelectorAll('.chart')][1].querySelector('.plot').data.slice(0, 7)
          .map(({ marker, line }) => `${marker.symbol} ${line.dash}`)"""
    )
    assert len(set(looks)) == 7
    button = seven.get_by_role("button", name="run 3")
    traces = seven.locator(".scatterlayer .trace")
    before = traces.count()
    button.focus()
    page.keyboard.press("Enter")
    assert button.get_attribute("aria-pressed") == "false"
    assert traces.count() == before - 2
    page.keyboard.press("Enter")
    assert traces.count() == before


def test_curves_follow_the_theme(page: Any) -> None:
    line = page.locator(".chart").first.locator(".js-line").first
    assert BLUE not in (line.get_attribute("style") or "")
    page.select_option("#theme", "dark")
    page.wait_for_function(f"document.querySelector('.chart .js-line').getAttribute('style').includes('{BLUE}')")


@pytest.mark.parametrize("theme", ["light", "dark", "projector"])
def test_axe_finds_nothing_serious(page: Any, theme: str) -> None:
    page.select_option("#theme", theme)
    assert serious_faults(page) == []


@pytest.mark.parametrize("width", [400, 1920])
def test_nothing_scrolls_sideways(browser: Any, page_file: Path, width: int) -> None:
    shown = opened(browser, page_file, width, "dark")
    draw_all(shown)
    shown.select_option("#theme", "projector")
    assert shown.evaluate("document.documentElement.scrollWidth") <= width
    assert shown.errors == []
    shown.context.close()


def test_without_scripts_or_an_old_browser_the_pictures_stay(browser: Any, page_file: Path) -> None:
    shown = opened(browser, page_file, java_script_enabled=False)
    assert shown.locator("figure img:visible").count() == 8
    assert shown.locator(".chart:visible").count() == 0
    shown.context.close()
    old = browser.new_context()
    old.add_init_script("delete window.DecompressionStream")
    page = old.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(page_file.as_uri())
    page.wait_for_timeout(300)
    assert page.locator("figure img:visible").count() == 8
    assert errors == []
    old.close()
