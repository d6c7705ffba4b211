"""Claims of a paper, each with a verdict that follows from an interval alone."""

from __future__ import annotations

from typing import Literal

from isacsim.settings import Settings
from models.reproduction.estimates import Estimate

Verdict = Literal["holds", "does not hold", "not told"]


class Claim(Settings):
    """A claim of a paper beside what was measured.

    claim: in words. paper: the paper's figure. rule: what has to be so for the claim to hold. measured: our figure with
    its interval; None where its stage was not run. verdict: `not told` where the interval does not decide.
    """

    claim: str
    paper: str
    rule: str
    measured: Estimate | None
    verdict: Verdict


def above(measured: Estimate | None, bound: float = 0.0) -> Verdict:
    """Return whether a number is above a bound: `holds` or `does not hold` where the whole interval says so."""
    if measured is None or measured.low is None or measured.high is None:
        return "not told"
    if measured.low > bound:
        return "holds"
    return "does not hold" if measured.high <= bound else "not told"


def at_most(measured: Estimate | None, bound: float) -> Verdict:
    """Return whether a number is at most a bound: `holds` or `does not hold` where the whole interval says so."""
    opposite: dict[Verdict, Verdict] = {"holds": "does not hold", "does not hold": "holds", "not told": "not told"}
    return opposite[above(measured, bound)]


def within(measured: Estimate | None, bound: float) -> Verdict:
    """Return whether a number lies between -bound and bound: equivalence, for claims that two scores are alike."""
    if measured is None or measured.low is None or measured.high is None:
        return "not told"
    if -bound <= measured.low and measured.high <= bound:
        return "holds"
    return "does not hold" if measured.low > bound or measured.high < -bound else "not told"


def all_of(verdicts: list[Verdict]) -> Verdict:
    """Return the verdict of a claim with several parts: it holds where all hold, and not where one does not."""
    if "does not hold" in verdicts:
        return "does not hold"
    return "not told" if "not told" in verdicts or not verdicts else "holds"
