"""The documents: their code runs, their links lead somewhere, and what they say of the project is so."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

import pytest
from cffconvert import Citation

import cosim

ROOT = Path(cosim.__file__).parent
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("sumo_nets/**/*.md")])


def blocks(page: Path, language: str) -> list[str]:
    """The fenced blocks of a page in one language."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_files_that_are_named_exist(page: Path) -> None:
    """`isacsim/radio/echo.py` in a text, unless a path of the example package."""
    for name in re.findall(
        r"`((?:isacsim|labeling|models|benchmarks|command_line|tests|docs)/[\w/.]+)`", page.read_text()
    ):
        assert (ROOT / name).exists(), name


def test_the_citation_is_valid_and_of_this_version() -> None:
    citation = Citation((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    citation.validate()
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert f"version: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"## {version}\n" in (ROOT / "CHANGELOG.md").read_text()


@pytest.fixture
def parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The example package of docs/extending.md, installed: its modules, and metadata with its entry points."""
    page = ROOT / "docs/extending.md"
    project = tomllib.loads(blocks(page, "toml")[0])["project"]
    package = tmp_path / "my_cosim_parts"
    package.mkdir()
    (package / "__init__.py").touch()
    for block in blocks(page, "python"):
        name = re.match(r'"""my_cosim_parts/(\w+\.py)', block)
        assert name, block
        assert len(block.splitlines()) < 40
        (package / name[1]).write_text(block)
    metadata = tmp_path / "my_cosim_parts-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: my-cosim-parts\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(
        "".join(
            f"[{group}]\n" + "".join(f"{name} = {place}\n" for name, place in points.items())
            for group, points in project["entry-points"].items()
        )
    )
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    for module in [name for name in sys.modules if name.startswith("my_cosim_parts")]:
        del sys.modules[module]
