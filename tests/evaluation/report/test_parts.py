"""Parts of a result: one list that the page and the terminal show, and that other packages add to."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import unquote

import pytest
from rich.console import Console

from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import Settings
from isac_cosim.evaluation import questions
from isac_cosim.evaluation.report import terminal
from isac_cosim.evaluation.report.page import pages_beside, write_page
from isac_cosim.evaluation.report.parts import Link, Part, write_table
from isac_cosim.evaluation.statistics import Estimate

PARTS = [
    Part("said", text="On the page alone.", sentences=["A is ahead of B."]),
    Part("first", "First [b]section[/b]", rows=[{"": "a", "score": 0.5}, {"": "b", "score": None}], strong=(1,)),
    Part("second", "Second <i>section</i>", rows=[{"": "c", "score": Estimate(value=0.1, low=0.0, high=0.2)}]),
    Part("wide", "Another table", rows=[{"name": "x" * 90, "page": Link("open", "a&b/index.html")}]),
    Part("hidden", rows=[{"": "page only", "score": 1}], on_terminal=False),
    Part("list", lines=["one <script>", "two"]),
    Part("drawn", figures=[("there.png", "What is to be seen."), ("missing.png", "Not there.")], on_terminal=False),
]


def printed(parts: list[Part], **given: bool | str) -> str:
    console = Console(file=io.StringIO(), width=40)
    terminal.show(parts, console, **given)  # type: ignore[arg-type]
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_the_terminal_shares_a_table_among_parts_of_the_same_headings() -> None:
    text = printed(PARTS, title="Scores")
    assert text.count("┏") == 2
    assert text.index("Scores") < text.index("First [b]section[/b]") < text.index("Second <i>section</i>")
    assert "0.100 (0.000 to 0.200)" in text
    assert "page only" not in text
    assert "On the page alone." not in text
    assert [line for line in text.splitlines() if line in ("A is ahead of B.", "one <script>", "two")] == [
        "A is ahead of B.", "one <script>", "two",
    ]  # fmt: skip


def test_no_table_in_a_pipe_is_narrower_than_its_content() -> None:
    assert "x" * 90 in printed(PARTS)
    console = Console(file=io.StringIO(), width=40, force_terminal=True)
    terminal.show(PARTS, console)
    assert "x" * 90 not in console.file.getvalue()  # type: ignore[attr-defined]
    assert console.width == 40
    console = Console(file=io.StringIO(), width=40, force_terminal=True)
    terminal.show(PARTS, console, whole=True)
    assert "x" * 90 in console.file.getvalue()  # type: ignore[attr-defined]


def test_the_page_escapes_everything_and_leaves_out_what_is_missing(tmp_path: Path) -> None:
    (tmp_path / "there.png").write_bytes(b"png")
    page = write_page("<Title>", PARTS, "made <by>", tmp_path).read_text()
    assert page.count("<figure>") == 1
    assert "one &lt;script&gt;" in page
    assert "<h1>&lt;Title&gt;</h1>" in page
    assert '<a href="a&amp;b/index.html">open</a>' in page
    assert "<tr class=strong><td>b</td><td>-</td></tr>" in page
    assert "made &lt;by&gt;" in page
    assert page.count("<script>") == 1  # Of the page itself.


def test_a_table_keeps_the_text_of_links_and_the_parts_of_estimates(tmp_path: Path) -> None:
    write_table([{"page": Link("open", "x"), "F1": Estimate(value=0.5, sd=0.1)}], tmp_path / "table.csv")
    with (tmp_path / "table.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert row == {"page": "open", "F1": "0.5", "F1 low": "", "F1 high": "", "F1 sd": "0.1"}


class Answer(Settings):
    value: int


def offer(monkeypatch: pytest.MonkeyPatch, **parts: object) -> None:
    monkeypatch.setattr(questions, "OFFERED", parts)


def test_a_part_without_a_measurement_is_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    measures = SimpleNamespace(result_class=str, measure=lambda evaluation: Answer(value=len(evaluation.result)))
    nothing = SimpleNamespace(result_class=str, measure=lambda evaluation: None)
    other = SimpleNamespace(result_class=int, measure=lambda evaluation: Answer(value=0))
    offer(monkeypatch, measures=measures, shows=SimpleNamespace(result_class=str), nothing=nothing, other=other)
    assert questions.answers(SimpleNamespace(result="four")) == {"measures": {"value": 4}}


def test_a_part_that_fails_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    offer(monkeypatch, broken=SimpleNamespace(result_class=str, measure=lambda evaluation: 1 / 0))
    with pytest.raises(InputError, match="result part broken: ZeroDivisionError: division by zero; fix"):
        questions.answers(SimpleNamespace(result=""))


def test_the_pages_of_a_run_lead_to_each_other_and_to_its_study(tmp_path: Path) -> None:
    run = tmp_path / "run"
    names = ("evaluation", 'traffic-a "b')
    for folder in (tmp_path / "report", *(run / name for name in names)):
        folder.mkdir(parents=True)
        write_page("Page", [], "", folder)
    assert pages_beside(run / "evaluation", "run.json") == []
    (run / "run.json").touch()
    links = pages_beside(run / "evaluation", "run.json")
    assert [link.text for link in links] == ['traffic-a "b', "report of the study"]
    page = write_page("Page", [], "", run / "evaluation", links=links)
    for target in re.findall(r'<a href="([^"]+)"', page.read_text()):
        assert (page.parent / unquote(target)).is_file()
    assert [link.text for link in pages_beside(run / names[1], "run.json")] == ["evaluation", "report of the study"]
    for other in (tmp_path / "report", run / names[1]):  # They got a link back, once.
        write_page("Page", [], "", run / "evaluation", links=links)
        (target,) = re.findall(r'<a href="([^"]+)">evaluation</a>', (other / "index.html").read_text())
        assert (other / unquote(target)).resolve() == page
    assert [link.text for link in pages_beside(tmp_path / "report", "run.json")] == [*sorted(names)]
