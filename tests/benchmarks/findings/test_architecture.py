"""docs/architecture.md is drawn from the imports, and is up to date."""

from __future__ import annotations

from pathlib import Path

import pytest

from isac_cosim.benchmarks.findings import architecture


def test_the_page_is_up_to_date() -> None:
    assert architecture.PAGE.read_text(encoding="utf-8") == architecture.drawn(), "run `make architecture`"


def test_each_package_stands_above_what_it_imports() -> None:
    page = architecture.drawn()
    headings = [line.removeprefix("## ") for line in page.splitlines() if line.startswith("## ")]
    assert headings == list(reversed(architecture.FLOORS[:-1]))
    for package, text in zip(headings, page.split("\n## ")[1:], strict=True):
        named = text.partition("It imports ")[2].partition(".")[0]
        assert all(f"`{other}`" not in named for other in headings[: headings.index(package) + 1])


def test_rooms_stand_above_those_beside_them_that_they_import() -> None:
    names = [line.split("`")[1] for line in architecture.drawn().splitlines() if line.startswith("| `")]
    assert names.index("training") < names.index("runs") < names.index("networks")
    assert names.index("scene") < names.index("radio") < names.index("traffic") < names.index("scenarios")


def test_a_changed_docstring_or_import_outdates_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    before = architecture.drawn()
    graph = {module: set(names) for module, names in architecture.imports().items()}
    graph["isacsim.radio.echo"].add("isacsim.scenarios.scenario")
    monkeypatch.setattr(architecture, "imports", lambda: graph)
    assert architecture.drawn() != before
    monkeypatch.undo()
    monkeypatch.setattr(architecture, "purpose", lambda folder: Path(folder).name)
    assert architecture.drawn() != before
