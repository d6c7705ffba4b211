"""A page of results: one HTML file that needs no other file, made of the parts of a result."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from pathlib import Path

from isac_cosim.base.files import replace_file
from isac_cosim.evaluation.report.parts import Cell, Link, Part, text_of

PAGE = "index.html"
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


def write_page(title: str, parts: Sequence[Part], origin: str, folder: Path, figures: Path | None = None) -> Path:
    """Write index.html into a folder and return its path. Raises OutputError.

    title, origin: plain text; origin: what made the result. figures: where the parts' figures lie, the folder itself by
    default; those that are not there are left out.
    """
    drawn = folder if figures is None else figures
    body = "\n".join(_part(part, drawn) for part in parts if part.on_page)
    content = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{html.escape(title)}</title>
<style>{STYLE}</style></head><body>
<h1>{html.escape(title)}</h1>
{body}
<details><summary>What made it</summary><pre>{html.escape(origin)}</pre></details>
</body></html>
"""
    page = folder / PAGE
    replace_file(page, lambda partial: partial.write_text(content, encoding="utf-8"))
    return page


def _part(part: Part, folder: Path) -> str:
    numbers = "".join(f"<div><b>{html.escape(value)}</b>{html.escape(name)}</div>" for value, name in part.numbers)
    return "".join(
        [
            f"<h2>{html.escape(part.title)}</h2>" if part.title else "",
            *(f"<p class=verdict>{html.escape(sentence)}</p>" for sentence in part.sentences),
            f"<p>{html.escape(part.text)}</p>" if part.text else "",
            f"<div class=big>{numbers}</div>" if numbers else "",
            _table(part) if part.rows else "",
            f"<ul>{''.join(f'<li>{html.escape(line)}</li>' for line in part.lines)}</ul>" if part.lines else "",
            *(_figure(folder / name, caption) for name, caption in part.figures if (folder / name).is_file()),
        ]
    )


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
