"""Tables and the page of a reproduction: the papers' numbers beside ours, as CSV and as one HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import get_args

from isac_cosim.evaluation.report.page import write_page
from isac_cosim.evaluation.report.parts import Part, Row, Shown, counted, text_of, write_table
from isac_cosim.evaluation.report.registry import parts_of
from isac_cosim.evaluation.report.replay.content import Replay
from isac_cosim.studies.reproduction.experiments.stages import Identity
from isac_cosim.studies.reproduction.experiments.verdicts import Claim, Verdict

LEAST_P = 1e-4
"""Smaller p-values are not told apart."""
TABLES, FIGURES, CLAIMS = "tables", "figures", "claims"
MOST_NUMBERS = 3
SMALL = "Size {}: these figures only show that every stage runs. They say nothing about the paper."


def write_pages(
    title: str,
    identity: Identity,
    parts: Sequence[Part],
    missing: Sequence[str],
    out: Path,
    claims: Sequence[Claim] = (),
    replay: Replay | None = None,
) -> Path:
    """Write a CSV file for each part with rows, and the page. Returns the page's path.

    title: of the page; it begins with the paper's name, and a comma.
    missing: stages that were not run, with what they answer. claims: of the paper, which the page begins with. replay:
    of an episode that was tested on. The figures must be there already, in FIGURES.
    """
    (out / TABLES).mkdir(exist_ok=True)
    for part in parts:
        if part.rows:
            write_table(part.rows, out / TABLES / f"{part.name}.csv")
    small = [] if identity.size == "full" else [Part("size", sentences=[SMALL.format(identity.size)])]
    not_run = [Part("not-run", "Not run", lines=missing)] if missing else []
    moving = [] if replay is None else [Part("replay", replay.title, replay=replay)]
    shown = [
        _first(title.partition(",")[0], claims),
        *small,
        *moving,
        *not_run,
        *parts,
        *parts_of(Shown(identity, out / FIGURES)),
    ]
    return write_page(title, shown, identity.model_dump_json(indent=1), out, out / FIGURES)


def _first(paper: str, claims: Sequence[Claim]) -> Part:
    """Return what became of a paper's claims, in a sentence, and the first of the figures that were measured.

    paper: its name as people write it.
    """
    verdicts = [claim.verdict for claim in claims]
    hold, fail, open_ = (verdicts.count(verdict) for verdict in get_args(Verdict))
    text = (
        f"What the {paper} paper claims, measured again on motion of our own: of {counted(len(claims), 'claim')}, "
        f"{hold} hold, {fail} do not, and {open_} are undecided."
    )
    measured = [claim for claim in claims if claim.measured is not None and claim.measured.value is not None]
    numbers = [(text_of(claim.measured), f"{claim.claim}: {claim.rule}?") for claim in measured[:MOST_NUMBERS]]
    return Part("reproduction-first", text=text, numbers=numbers)


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
