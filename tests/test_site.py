"""The documents as a site: built without a warning, with every page in it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import cosim

DOCS = Path(cosim.__file__).parent / "docs"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "-q", "-b", "html", "-d", str(folder / "kept"), str(DOCS)]
    built = subprocess.run([*command, str(folder / "html")], capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return folder / "html"


def test_every_page_is_in_the_site_and_reached_from_its_first(site: Path) -> None:
    index = (site / "index.html").read_text(encoding="utf-8")
    for page in DOCS.glob("*.md"):
        assert (site / f"{page.stem}.html").is_file(), page.name
        assert page.stem == "index" or f'href="{page.stem}.html"' in index, page.name


def test_the_api_says_what_functions_take_and_give(site: Path) -> None:
    api = (site / "api.html").read_text(encoding="utf-8")
    for name in ("isac_cosim.open", "isac_cosim.load", "isac_cosim.evaluate", "OpenedDataset.windows", "fit"):
        assert name in api, name


def test_no_page_links_to_a_file_that_the_site_lacks(site: Path) -> None:
    for page in site.glob("*.html"):
        assert 'href="../' not in page.read_text(encoding="utf-8"), page.name
