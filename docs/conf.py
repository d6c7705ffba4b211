"""The documents as a site: `make site` builds it in build/site, from the pages as they are and the docstrings."""

from __future__ import annotations

import re
import sys
from importlib.metadata import version as installed_version
from pathlib import Path

from sphinx.application import Sphinx

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

project = "isac-cosim"
copyright = "the authors of isac-cosim; MIT licence"
version = release = installed_version("isac-cosim")
extensions = ["myst_parser", "sphinx.ext.autodoc"]
exclude_patterns = ["tables/*", "full_study/*", "reproduction/README.md"]
html_theme = "furo"
html_title = f"isac-cosim {version}"
html_static_path: list[str] = []
myst_heading_anchors = 4
autodoc_typehints = "description"
autodoc_member_order = "bysource"
nitpicky = False
OUTSIDE = re.compile(r"\[([^\]]+)\]\(\.\./(?!\.\.)([^)#]+)(#[^)]*)?\)")
"""A link to a file of the checkout that is no page of the site."""


def without_links_outside(app: Sphinx, name: str, text: list[str]) -> None:
    """Name the files of the checkout that pages link to: a site has no place for them."""
    depth = name.count("/")
    if not depth:
        text[0] = OUTSIDE.sub(lambda found: f"{found[1]} (`{found[2]}`)", text[0])


def setup(app: Sphinx) -> None:
    """Let Sphinx call what is above."""
    app.connect("source-read", without_links_outside)
