"""Parts of a page of results: one HTML file that needs no other file."""

from __future__ import annotations

import base64
import csv
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from isac_cosim.base.files import replace_file
from isac_cosim.evaluation.statistics import Estimate

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1f2937; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; } .big { display: flex; gap: 2.5rem; flex-wrap: wrap; margin: 1.2rem 0; }
.big b { display: block; font-size: 2rem; color: #0072b2; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; }
td, th { padding: .35rem .9rem; text-align: right; border-bottom: 1px solid #e5e7eb; }
td:first-child, th:first-child { text-align: left; } th { background: #f3f4f6; }
tr.strong { font-weight: 600; }
figure { margin: 2rem 0; } img { max-width: 100%; } figcaption { color: #4b5563; }
pre { background: #f3f4f6; padding: 1rem; overflow-x: auto; font-size: .8rem; }
"""


def document(title: str, body: str) -> str:
    """Return a whole page; title: plain text, body: HTML."""
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{html.escape(title)}</title>
<style>{STYLE}</style></head><body>
<h1>{html.escape(title)}</h1>
{body}
</body></html>
"""


def table(head: Sequence[str], rows: Sequence[Sequence[str]], strong: Sequence[int] = ()) -> str:
    """Return a table.

    head, rows: cells, as HTML. strong: numbers of the rows that are set in bold.
    """
    top = "".join(f"<th>{text}</th>" for text in head)
    cells = "".join(
        f"<tr{' class=strong' if k in strong else ''}>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>"
        for k, row in enumerate(rows)
    )
    return f"<div class=scroll><table><thead><tr>{top}</tr></thead><tbody>{cells}</tbody></table></div>"


def image(path: Path, text: str) -> str:
    """Return a PNG file, embedded in the page, with a caption of plain text."""
    data, alt = base64.b64encode(path.read_bytes()).decode(), html.escape(text)
    return f'<figure><img alt="{alt}" src="data:image/png;base64,{data}"><figcaption>{alt}</figcaption></figure>'


def made_by(text: str) -> str:
    """Return what made the results, as plain text in a part of the page that unfolds."""
    return f"<details><summary>What made it</summary><pre>{html.escape(text)}</pre></details>"


FIGURES = "figures"
"""Folder of a page's figures."""
Cell = Estimate | str | float | int | None


Row = Mapping[str, Cell]


NO_VALUE = "-"


@dataclass(frozen=True)
class Part:
    """One table of the page, with its figures.

    name: of its CSV file. title, text: for people. rows: their keys are the headings. figures: file names in FIGURES,
    with their captions.
    """

    name: str
    title: str
    text: str
    rows: Sequence[Row] = ()
    figures: Sequence[tuple[str, str]] = field(default_factory=tuple)


def write_table(rows: Sequence[Row], path: Path) -> None:
    """Write rows as CSV; an estimate takes the columns of its value, its interval and its spread."""
    flat = [_flat(row) for row in rows]
    names = list(dict.fromkeys(name for row in flat for name in row))

    def write(partial: Path) -> None:
        with partial.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, names, restval="")
            writer.writeheader()
            writer.writerows(flat)

    replace_file(path, write)


def text_of(cell: Cell) -> str:
    """Return a cell as people read it: an estimate with its spread over trainings and its interval."""
    if isinstance(cell, Estimate):
        if cell.value is None:
            return NO_VALUE
        spread = "" if cell.sd is None else f" ±{cell.sd:.3f}"
        interval = "" if cell.low is None or cell.high is None else f" ({cell.low:.3f} to {cell.high:.3f})"
        return f"{cell.value:.3f}{spread}{interval}"
    if cell is None:
        return NO_VALUE
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)


def _flat(row: Row) -> dict[str, str | float | int]:
    flat: dict[str, str | float | int] = {}
    for name, cell in row.items():
        if isinstance(cell, Estimate):
            numbers = {"": cell.value, " low": cell.low, " high": cell.high, " sd": cell.sd}
            flat |= {f"{name}{end}": "" if number is None else round(number, 6) for end, number in numbers.items()}
        else:
            flat[name] = "" if cell is None else cell
    return flat


def _section(part: Part, out: Path) -> str:
    rows = ""
    if part.rows:
        head = list(dict.fromkeys(name for row in part.rows for name in row))
        cells = [[html.escape(text_of(row.get(name))) for name in head] for row in part.rows]
        rows = table([html.escape(name) for name in head], cells)
    figures = "".join(image(out / FIGURES / name, caption) for name, caption in part.figures)
    return f"<h2>{html.escape(part.title)}</h2><p>{html.escape(part.text)}</p>{rows}{figures}"
