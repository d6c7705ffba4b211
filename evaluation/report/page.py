"""A page of results: one HTML file that needs no other file, made of the parts of a result."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from urllib.parse import quote

from markupsafe import Markup

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import replace_file
from isac_cosim.evaluation.report.html.templates import render
from isac_cosim.evaluation.report.parts import Link, Part, Row, counted, csv_text, text_of

PAGE = "index.html"
STUDY_REPORT = "report"
"""Where a study keeps its report: in a folder of this name beside the run's."""
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
    library = packed_plotly() if CHART in body else None
    content = render("page.html.j2", mark=MARK, title=title, body=body, origin=origin, links=links, library=library)
    replace_file(page, lambda partial: partial.write_text(content, encoding="utf-8"))


def pages_beside(folder: Path, mark: str) -> list[Link]:
    """Return links to the other pages of a run and to that of its study, for a page whose folder lies in the run's.

    mark: name of the file that every run's folder holds.
    """
    run = folder.absolute().parent
    if not (run / mark).is_file():
        return []
    pages = [page for page in sorted(run.glob(f"*/{PAGE}")) if page.parent.name != folder.name]
    links = [Link(page.parent.name, f"../{quote(page.parent.name)}/{PAGE}") for page in pages]
    if (run.parent / STUDY_REPORT / PAGE).is_file():
        links.append(Link(f"{STUDY_REPORT} of the study", f"../../{STUDY_REPORT}/{PAGE}"))
    return links


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
            "alt": part.seen.get(name, caption),
            "data": base64.b64encode((folder / name).read_bytes()).decode(),
            "rows": part.figure_rows.get(name, ()),
            "chart": charts[name] if name in charts and charts[name]["lines"] else None,
        }
        for name, caption in part.figures
        if (folder / name).is_file()
    ]
    return render("part.html.j2", part=part, figures=figures, text_of=text_of, csv=_csv, counted=counted)


def _csv(rows: Sequence[Row]) -> str:
    """Return the address of a table that lies in the page itself."""
    return f"data:text/csv;charset=utf-8;base64,{base64.b64encode(csv_text(rows).encode()).decode()}"
