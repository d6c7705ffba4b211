"""A page of results: one HTML file that needs no other file, made of the parts of a result."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import replace_file
from isac_cosim.evaluation.report.html.templates import render
from isac_cosim.evaluation.report.parts import Cell, Link, Part, text_of

PAGE = "index.html"
MARK = "isac-cosim"
"""What a page says that it was made by; a file without it is not replaced."""


def write_page(
    title: str,
    parts: Sequence[Part],
    origin: str,
    folder: Path,
    figures: Path | None = None,
    links: Sequence[Link] = (),
) -> Path:
    """Write index.html into a folder and return its path. Raises OutputError.

    title, origin: plain text; origin: what made the result. figures: where the parts' figures lie, the folder itself by
    default; those that are not there are left out. links: to other pages, relative to this one.
    """
    page = folder / PAGE
    write_content(page, title, parts, origin, folder if figures is None else figures, links)
    return page


def write_content(
    page: Path, title: str, parts: Sequence[Part], origin: str, figures: Path, links: Sequence[Link] = ()
) -> None:
    """Write a page to a file; see `write_page`. Raises OutputError."""
    body = Markup("\n").join(_part(part, figures) for part in parts if part.on_page)
    content = render("page.html.j2", mark=MARK, title=title, body=body, origin=origin, links=links)
    replace_file(page, lambda partial: partial.write_text(content, encoding="utf-8"))


def check_page(page: Path) -> None:
    """Raise InputError where a page cannot be written to a path, or would replace what is no page of this tool."""
    if page.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{page}: is not the name of a page; let it end in .html")
    if page.is_dir():
        raise InputError(f"{page}: is a folder; give the name of a page in it, such as {page / 'replay.html'}")
    if not page.parent.is_dir():
        raise InputError(f"{page}: there is no folder {page.parent}; make it first, or choose another one")
    if page.exists():
        try:
            ours = f'content="{MARK}"' in page.open(encoding="utf-8", errors="replace").read(2000)
        except OSError as error:
            raise InputError(f"{page}: cannot be read ({error.strerror}); choose another name") from None
        if not ours:
            raise InputError(f"{page}: exists and is no page of this tool; choose another name")


def _part(part: Part, folder: Path) -> Markup:
    numbers = "".join(f"<div><b>{html.escape(value)}</b>{html.escape(name)}</div>" for value, name in part.numbers)
    texts = [
        f"<h2>{html.escape(part.title)}</h2>" if part.title else "",
        *(f"<p class=verdict>{html.escape(sentence)}</p>" for sentence in part.sentences),
        f"<p>{html.escape(part.text)}</p>" if part.text else "",
        f"<div class=big>{numbers}</div>" if numbers else "",
        render("replay.html.j2", replay=part.replay) if part.replay is not None else "",
        _table(part) if part.rows else "",
        f"<ul>{''.join(f'<li>{html.escape(line)}</li>' for line in part.lines)}</ul>" if part.lines else "",
        *(_figure(folder / name, caption) for name, caption in part.figures if (folder / name).is_file()),
    ]
    return Markup("".join(texts))


def _table(part: Part) -> str:
    top = "".join(f"<th>{html.escape(heading)}</th>" for heading in part.headings)
    rows = "".join(
        f"<tr{' class=strong' if k in part.strong else ''}>"
        f"{''.join(f'<td>{_cell(row.get(heading))}</td>' for heading in part.headings)}</tr>"
        for k, row in enumerate(part.rows)
    )
    return f"<div class=scroll><table><thead><tr>{top}</tr></thead><tbody>{rows}</tbody></table></div>"


def _cell(cell: Cell) -> str:
    if isinstance(cell, Link):
        return f'<a href="{html.escape(cell.target)}">{html.escape(cell.text)}</a>'
    return html.escape(text_of(cell))


def _figure(path: Path, caption: str) -> str:
    """Return a PNG file, embedded in the page, with a caption of plain text."""
    data, alt = base64.b64encode(path.read_bytes()).decode(), html.escape(caption)
    return f'<figure><img alt="{alt}" src="data:image/png;base64,{data}"><figcaption>{alt}</figcaption></figure>'
