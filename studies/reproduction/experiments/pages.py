"""Tables and the page of a reproduction: the papers' numbers beside ours, as CSV and as one HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from isac_cosim.evaluation.report.page import write_page
from isac_cosim.evaluation.report.parts import Part, Row, Shown, write_table
from isac_cosim.evaluation.report.registry import parts_of
from isac_cosim.studies.reproduction.experiments.stages import Identity
from isac_cosim.studies.reproduction.experiments.verdicts import Claim

LEAST_P = 1e-4
"""Smaller p-values are not told apart."""
TABLES, FIGURES, CLAIMS = "tables", "figures", "claims"
SMALL = "Size {}: these figures only show that every stage runs. They say nothing about the paper."


def write_pages(title: str, identity: Identity, parts: Sequence[Part], missing: Sequence[str], out: Path) -> Path:
    """Write a CSV file for each part with rows, and the page. Returns the page's path.

    missing: stages that were not run, with what they answer. The figures must be there already, in FIGURES.
    """
    (out / TABLES).mkdir(exist_ok=True)
    for part in parts:
        if part.rows:
            write_table(part.rows, out / TABLES / f"{part.name}.csv")
    small = [] if identity.size == "full" else [Part("size", sentences=[SMALL.format(identity.size)])]
    not_run = [Part("not-run", "Not run", lines=missing)] if missing else []
    shown = [*small, *not_run, *parts, *parts_of(Shown(identity, out / FIGURES))]
    return write_page(title, shown, identity.model_dump_json(indent=1), out, out / FIGURES)


def claims_part(claims: Sequence[Claim]) -> Part:
    """Return the checklist of a paper's claims."""
    rows: list[Row] = [
        {
            "claim": claim.claim,
            "verdict": claim.verdict,
            "ours": claim.measured,
            "paper": claim.paper,
            "holds if": claim.rule,
            "p": _spoken(claim.p_value),
        }
        for claim in claims
    ]
    text = (
        "A claim holds, or does not hold, where the whole 95 % interval says so; otherwise it is undecided. So it is "
        "where a network was trained only once, or where Holm's correction, for the several claims of one table or "
        "figure, leaves nothing: p is the two-sided p-value before it. Intervals cover the test seeds or folds, and "
        "the trainings where there are several."
    )
    return Part(CLAIMS, "What the paper claims", text, rows)


def _spoken(p_value: float | None) -> str | float | None:
    if p_value is not None and p_value < LEAST_P:
        return f"< {LEAST_P:.4f}"
    return None if p_value is None else round(p_value, 4)
