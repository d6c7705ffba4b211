"""The documents and the plan: tables are those of the stored results, and no page claims more than it shows."""

from __future__ import annotations

import doctest
import io
import runpy
import shlex
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path

import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.benchmarks.findings import architecture, settings_page
from isac_cosim.benchmarks.findings.figures import pages
from isac_cosim.benchmarks.findings.figures.pages import claims, printed_tables, rewritten, tables_of
from isac_cosim.benchmarks.findings.figures.plan import ROOT, FigureStage, read_plan
from isac_cosim.benchmarks.findings.figures.record import PRESENT, RECORDS, status
from isac_cosim.benchmarks.findings.figures.unfinished import kept_files
from isac_cosim.evaluation.report import parts
from isac_cosim.isacsim.scenarios import demand
from tests.test_documents import PAGES

STAGES = read_plan().stage
TEXTS = {
    str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
    for path in [*PAGES, *ROOT.glob("docs/*/*.md")]
    if path.parent.name != "tables"
}
CLAIMS = {page: claims(text) for page, text in TEXTS.items()}
WRITTEN_BY_COMMANDS = {
    "docs/api.md",
    architecture.PAGE.relative_to(ROOT).as_posix(),
    settings_page.PAGE.relative_to(ROOT).as_posix(),
}
MOST_LINES_BY_HAND = 2600


def printed(command: str, monkeypatch: pytest.MonkeyPatch) -> str:
    """What a command of the plan prints, run in this process where it is a script of the documents."""
    program, *arguments = shlex.split(command)
    if program == "cat":
        return (ROOT / arguments[0]).read_text(encoding="utf-8")
    assert program == "python", command
    if arguments[0] == "-m":
        return subprocess.run(
            [sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, encoding="utf-8", check=True
        ).stdout
    monkeypatch.setattr("sys.argv", arguments)
    monkeypatch.chdir(ROOT)
    output = io.StringIO()
    with redirect_stdout(output):
        if arguments[0] == "-c":
            exec(arguments[1], {})
        else:
            runpy.run_path(arguments[0], run_name="__main__")
    return output.getvalue()


def outdated(page: str) -> dict[str, str]:
    """The stages that a page claims to be present and that are not, with why."""
    present = [name for name, claimed in CLAIMS[page].items() if claimed]
    return {name: why for name in present if (why := status(name, STAGES[name], ROOT)) != PRESENT}


@pytest.mark.parametrize("page", [page for page, found in CLAIMS.items() if any(found.values())] or [None])
def test_a_page_that_claims_present_figures_rests_on_them(page: str | None) -> None:
    assert page is None or outdated(page) == {}, "make figures STAGE=..., or STAGE=withdraw"


def test_a_changed_default_names_the_pages_that_it_outdates(monkeypatch: pytest.MonkeyPatch) -> None:
    """A page that claims what nobody made since, and with a default that has changed."""
    monkeypatch.setitem(CLAIMS, "docs/live.md", {"live-motorway": True})
    monkeypatch.setattr(demand, "HEADWAY_S", 9.5)
    assert list(outdated("docs/live.md")) == ["live-motorway"]


@pytest.mark.parametrize("name", [name for name, stage in STAGES.items() if stage.pages])
def test_the_pages_of_a_stage_say_of_which_settings_its_figures_are(name: str) -> None:
    assert {page for page, found in CLAIMS.items() if name in found} == set(STAGES[name].pages)


@pytest.mark.parametrize("page", TEXTS)
def test_the_tables_of_a_page_are_of_stages_that_print_them(page: str) -> None:
    tables = tables_of(TEXTS[page])
    for stage, name in tables:
        of_stage = {each: table for (of, each), table in tables.items() if of == stage}
        assert rewritten(TEXTS[page], stage, of_stage) == TEXTS[page], "a table is not under its command"
        assert stage in STAGES, name
        assert page in STAGES[stage].pages, name
        assert STAGES[stage].tables, name


@pytest.mark.parametrize(
    "name", [name for name, stage in STAGES.items() if stage.tables and all(stage.files(ROOT).values())]
)
def test_the_tables_of_pages_are_those_of_the_stored_results(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = STAGES[name]
    tables: dict[str, str] = {}
    for command in stage.tables:
        tables |= printed_tables(printed(command, monkeypatch))
    shown = {table: text for page in stage.pages for (of, table), text in tables_of(TEXTS[page]).items() if of == name}
    assert shown == tables
    assert tables


@pytest.mark.parametrize(
    "path",
    [
        path
        for kind in ("json", "png")
        for path in sorted(ROOT.glob(f"docs/**/*.{kind}"))
        if path.parent.relative_to(ROOT).as_posix() not in (RECORDS, "docs/benchmark")  # rows carry digests themselves
    ],
    ids=lambda path: str(path.relative_to(ROOT)),
)
def test_every_stored_result_is_made_by_a_stage(path: Path) -> None:
    assert any(
        path in [file for files in stage.files(ROOT).values() for file in files] + kept_files(name, stage, ROOT)
        for name, stage in STAGES.items()
    )


def lines_by_hand(text: str) -> int:
    """How many lines of a page are left without the tables that a command prints."""
    return len(pages.TABLE.sub("", text).splitlines())


def test_the_documents_are_kept_short() -> None:
    """Printed tables, and pages that a command writes, do not count."""
    counted = {
        page: lines_by_hand(text)
        for page, text in TEXTS.items()
        if page.count("/") == 1 and page.startswith("docs/") and page not in WRITTEN_BY_COMMANDS
    }
    assert sum(counted.values()) <= MOST_LINES_BY_HAND, sorted(counted.items(), key=lambda item: -item[1])


def test_a_printed_table_does_not_count_as_written_by_hand() -> None:
    table = "<!-- table a: Leads -->\n### Leads: 3 windows\n\n`make figures STAGE=a`\n\n| n |\n| --- |\n| 3 |\n"
    assert lines_by_hand(f"# Page\n\n{table}\n| own |\n| --- |\n") == 5


def test_the_commands_of_the_plan_name_programs_of_the_project() -> None:
    for stage in STAGES.values():
        for command in stage.commands:
            words = shlex.split(command)
            if words[:2] == ["python", "-m"]:
                module = words[2].removeprefix("isac_cosim.").replace(".", "/")
                assert (ROOT / f"{module}.py").is_file(), words[2]
            elif words[0] == "python":
                assert (ROOT / words[1]).is_file(), words[1]
            else:
                assert words[0] in ("cosim", "cp", "mkdir", "rm"), command


def test_a_table_keeps_its_neighbours_and_loses_its_old_heading() -> None:
    page = "<!-- table a: Leads -->\n### Leads: 3 windows\n\n| n |\n| --- |\n| 3 |\n\n<!-- table b: Leads -->\n| x |\n"
    after = rewritten(page, "a", printed_tables("### Leads: 4 windows\n\n| n |\n| --- |\n| 4 |\n"))
    assert after == page.replace("3", "4").replace("\n\n", "\n\n`make figures STAGE=a`\n\n", 1)
    assert rewritten(after, "a", {"Leads": tables_of(after)["a", "Leads"]}) == after
    with pytest.raises(InputError, match="prints no table 'Leads'"):
        rewritten(page, "b", {})


def test_the_examples_of_tables_hold() -> None:
    assert doctest.testmod(pages).failed == doctest.testmod(parts).failed == 0


def test_a_stage_counts_each_part_by_default() -> None:
    stage = FigureStage(question="?", commands=("true",), results=("a",), cost_min=1, cost_is="made up")
    assert stage.parts == ("traffic", "recordings", "maneuvers", "labels", "sensing", "predictors", "evaluation")
