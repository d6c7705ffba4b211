"""Tables and the page of a reproduction: the papers' numbers beside ours, as CSV and as one HTML file."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path

from isac_cosim.base.files import replace_file
from isac_cosim.evaluation.report import page as html_page
from isac_cosim.evaluation.report.page import Part, Row, _section, write_table
from isac_cosim.studies.reproduction.experiments.stages import Claim, Identity

TABLES, PAGE, CLAIMS = "tables", "index.html", "claims"


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
