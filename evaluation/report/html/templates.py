"""Fills in the templates of pages. Every text is escaped; a page needs no other file."""

from __future__ import annotations

import importlib.resources
import re
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from isac_cosim.base.files import json_text

HERE = __package__ or ""
JSON_ESCAPES = str.maketrans(
    {"<": r"\u003c", ">": r"\u003e", "&": r"\u0026", "\u2028": r"\u2028", "\u2029": r"\u2029"}
)  # fmt: skip
"""What must not stand as it is in JSON within HTML: `</script>` in a name would end the element."""


def render(template: str, **content: Any) -> Markup:
    """Return a template of this package, filled in. content: plain values and texts, which are escaped."""
    return Markup(_environment().get_template(template).render(content))


def coded(text: str) -> Markup:
    """Return a text in which what stands between backticks is code.

    >>> coded("`a` < b")
    Markup('<code>a</code> &lt; b')
    """
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def embedded_json(content: Any) -> Markup:
    """Return plain values as JSON that can stand in a `<script>` element of a page.

    >>> embedded_json({"name": "</script>"})
    Markup('{"name": "\\\\u003c/script\\\\u003e"}')
    """
    return Markup(json_text(content).translate(JSON_ESCAPES))


@cache
def file_text(name: str) -> Markup:
    """Return a file of this package, which goes into pages as it is: a style sheet or a script of ours."""
    return Markup((importlib.resources.files(HERE) / name).read_text(encoding="utf-8"))


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader(HERE, "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.globals |= {"file_text": file_text, "embedded_json": embedded_json}
    environment.filters["coded"] = coded
    return environment
