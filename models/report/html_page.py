"""Parts of a page of results: one HTML file that needs no other file."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from pathlib import Path

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
