"""A page of results: one HTML file that needs no other file, made of the parts of a result."""

from __future__ import annotations

import base64
import gzip
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

from markupsafe import Markup

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import replace_file
from isac_cosim.evaluation.report.html.templates import render
from isac_cosim.evaluation.report.parts import Link, Part, Row, counted, csv_text, text_of

PAGE = "index.html"
STUDY_PAGES = ("report", "live")
"""Where a study keeps its page: in a folder of one of these names beside that of its run, STUDY_RUN."""
STUDY_RUN = "run"
NAVIGATION = '<nav aria-label="Page">'
"""By which the links of a page begin."""
CHART = 'class="chart"'
"""By which the templates mark curves that the page draws itself."""
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
    default; those that are not there are left out. links: to other pages, relative to this one, which link back.
    """
    page = folder / PAGE
    write_content(page, title, parts, origin, folder if figures is None else figures, links)
    link_back(page, links)
    return page


def write_content(
    page: Path, title: str, parts: Sequence[Part], origin: str, figures: Path, links: Sequence[Link] = ()
) -> None:
    """Write a page to a file; see `write_page`. Raises OutputError."""
    body = Markup("\n").join(_part(part, figures) for part in parts if part.on_page)
    library = packed_plotly() if CHART in body else None
    content = render("page.html.j2", mark=MARK, title=title, body=body, origin=origin, links=links, library=library)
    replace_file(page, lambda partial: partial.write_text(content, encoding="utf-8"))


def pages_beside(folder: Path, mark: str) -> list[Link]:
    """Return links from a page to the others of its run and of its study. folder: of the page, in that of its run.

    A study's own page lies beside the folder of its run. mark: name of the file that every run's folder holds.
    """
    above = folder.absolute().parent
    run = above if (above / mark).is_file() else above / STUDY_RUN
    if not (run / mark).is_file():
        return []
    pages = [*sorted(run.glob(f"*/{PAGE}")), *(run.parent / name / PAGE for name in STUDY_PAGES)]
    return [_link(page, folder) for page in pages if page.is_file() and page.parent != folder.absolute()]


def link_back(page: Path, links: Sequence[Link]) -> None:
    """Add a link to a page to those that it links to, where they have none yet. Raises OutputError.

    links: of the page, relative to it.
    """
    for link in links:
        other = Path(os.path.normpath(page.absolute().parent / unquote(link.target)))
        back = _link(page, other.parent)
        with suppress(OSError, UnicodeDecodeError):
            before, begins, rest = other.read_text(encoding="utf-8").partition(NAVIGATION)
            if begins and f'content="{MARK}"' in before and f'href="{back.target}"' not in rest:
                added = Markup('<a href="{}">{}</a>').format(back.target, back.text)
                content = f"{before}{begins}\n{added}{rest}"
                replace_file(other, partial(Path.write_text, data=content, encoding="utf-8"))


def _link(page: Path, folder: Path) -> Link:
    """Return a link to a page for one that lies in a folder."""
    name = page.absolute().parent.name
    target = Path(os.path.relpath(page.absolute(), folder.absolute())).as_posix()
    return Link(f"{name} of the study" if name in STUDY_PAGES else name, quote(target))


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


@cache
def packed_plotly() -> str | None:
    """Return the library of the curves, plotly.js, packed by gzip in base64: 2 MB instead of 5.

    None where an environment of an earlier version lacks it: the page then has the pictures, and is whole.
    """
    try:
        from plotly.offline import get_plotlyjs
    except ModuleNotFoundError:
        return None
    return base64.b64encode(gzip.compress(get_plotlyjs().encode(), mtime=0)).decode()


def _part(part: Part, folder: Path) -> Markup:
    charts = {name: chart.content(part.figure_rows.get(name, ())) for name, chart in part.charts.items()}
    figures = [
        {
            "name": Path(name).stem,
            "caption": caption,
            "alt": part.seen.get(name) or _alternative(part, caption),
            "data": base64.b64encode((folder / name).read_bytes()).decode(),
            "rows": part.figure_rows.get(name, ()),
            "chart": charts[name] if name in charts and charts[name]["lines"] else None,
        }
        for name, caption in part.figures
        if (folder / name).is_file() and not _is_empty(part, name, charts)
    ]
    return render("part.html.j2", part=part, figures=figures, text_of=text_of, csv=_csv, counted=counted)


def _is_empty(part: Part, name: str, charts: Mapping[str, Any]) -> bool:
    """Return whether a figure has rows of which none can be drawn, such as too few windows: its picture is a frame."""
    return bool(part.figure_rows.get(name)) and name in charts and not charts[name]["lines"]


def _alternative(part: Part, caption: str) -> str:
    """Return the text that stands for a figure which nothing describes: where its numbers are."""
    return f"{caption} The table of {part.title or 'this part'} has the numbers." if part.rows else caption


def _csv(rows: Sequence[Row]) -> str:
    """Return the address of a table that lies in the page itself."""
    return f"data:text/csv;charset=utf-8;base64,{base64.b64encode(csv_text(rows).encode()).decode()}"
