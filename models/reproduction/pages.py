"""Tables and the page of a reproduction: the papers' numbers beside ours, as CSV and as one HTML file."""

from __future__ import annotations

import csv
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from isacsim.files import replace_file
from models.report import html_page
from models.reproduction.claims import Claim
from models.reproduction.estimates import Estimate
from models.reproduction.stages import Identity

TABLES, FIGURES, PAGE, CLAIMS = "tables", "figures", "index.html", "claims"
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


def write_pages(title: str, identity: Identity, parts: Sequence[Part], missing: Sequence[str], out: Path) -> Path:
    """Write a CSV file for each part with rows, and the page. Returns the page's path.

    missing: stages that were not run, with what they answer. The figures must be there already.
    """
    (out / TABLES).mkdir(exist_ok=True)
    for part in parts:
        if part.rows:
            write_table(part.rows, out / TABLES / f"{part.name}.csv")
    page = out / PAGE
    content = html_page.document(title, _body(identity, parts, missing, out))
    replace_file(page, lambda path: path.write_text(content, encoding="utf-8"))
    return page


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


def claims_part(claims: Sequence[Claim]) -> Part:
    """Return the checklist of a paper's claims."""
    rows: list[Row] = [
        {
            "claim": claim.claim,
            "verdict": claim.verdict,
            "ours": claim.measured,
            "paper": claim.paper,
            "holds if": claim.rule,
        }
        for claim in claims
    ]
    text = (
        "A verdict follows from the 95 % interval alone: a claim holds, or does not hold, where the whole interval "
        "says so, and is not told otherwise. Intervals cover the test seeds or folds, and the trainings "
        "where there are several."
    )
    return Part(CLAIMS, "What the paper claims", text, rows)


def text_of(cell: Cell) -> str:
    """Return a cell as people read it: an estimate with its spread over trainings and its interval."""
    if isinstance(cell, Estimate):
        if cell.value is None:
            return NO_VALUE
        spread = "" if cell.sd is None else f" ±{cell.sd:.3f}"
        interval = "" if cell.low is None or cell.high is None else f" ({cell.low:.3f} to {cell.high:.3f})"
        over = "" if cell.over is None else f" over {cell.over[0]} of {cell.over[1]} intentions"
        return f"{cell.value:.3f}{spread}{interval}{over}"
    if cell is None:
        return NO_VALUE
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)


def _flat(row: Row) -> dict[str, str | float | int]:
    flat: dict[str, str | float | int] = {}
    for name, cell in row.items():
        if isinstance(cell, Estimate):
            numbers = {"": cell.value, " low": cell.low, " high": cell.high, " sd": cell.sd}
            if cell.over is not None:
                numbers[" over intentions"] = cell.over[0]
            flat |= {f"{name}{end}": "" if number is None else round(number, 6) for end, number in numbers.items()}
        else:
            flat[name] = "" if cell is None else cell
    return flat


def _body(identity: Identity, parts: Sequence[Part], missing: Sequence[str], out: Path) -> str:
    notice = ""
    if identity.size != "full":
        notice = (
            f"<p class=verdict><b>Size {html.escape(identity.size)}: these figures only show that every stage runs. "
            "They say nothing about the paper.</b></p>"
        )
    if missing:
        items = "".join(f"<li>{html.escape(line)}</li>" for line in missing)
        notice += f"<h2>Not run</h2><ul>{items}</ul>"
    sections = "".join(_section(part, out) for part in parts)
    return f"{notice}{sections}{html_page.made_by(identity.model_dump_json(indent=1))}"


def _section(part: Part, out: Path) -> str:
    table = ""
    if part.rows:
        head = list(dict.fromkeys(name for row in part.rows for name in row))
        cells = [[html.escape(text_of(row.get(name))) for name in head] for row in part.rows]
        table = html_page.table([html.escape(name) for name in head], cells)
    figures = "".join(html_page.image(out / FIGURES / name, caption) for name, caption in part.figures)
    return f"<h2>{html.escape(part.title)}</h2><p>{html.escape(part.text)}</p>{table}{figures}"
