"""Claims of a paper, and the verdict on each: a function of the interval, the trainings and the other claims.

A verdict needs the whole 95 % interval on one side of the rule, and more than one training. The claims of one table or
figure are a family: the more of them there are, the more would be decided by chance, so they are corrected by Holm's
method (Holm 1979, Scand. J. Statist. 6, 65-70). What the correction does not leave is undecided.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from pydantic import Field
from scipy.stats import t as student_t

from isac_cosim.base.settings import Settings
from isac_cosim.evaluation.statistics import LEVEL, Estimate

Verdict = Literal["holds", "does not hold", "undecided"]
LEAST_TRAININGS = 2
"""With fewer trainings nothing is decided: what sets two networks apart may be their draws of weights and batches."""


class Claim(Settings):
    """A claim of a paper beside what was measured.

    claim: in words. paper: the paper's figure. rule: what has to be so for the claim to hold. measured: our figure with
    its interval; None where its stage was not run. verdict: `undecided` where the interval does not decide, or the
    correction. family: table or figure whose claims are corrected together. p_value: two-sided, that chance alone puts
    the figure so far from the bound of the rule; before the correction, None where it is unknown.
    """

    claim: str
    paper: str
    rule: str
    measured: Estimate | None
    verdict: Verdict
    family: str = ""
    p_value: float | None = Field(None, ge=0, le=1)


@dataclass(frozen=True)
class Rule:
    """What has to be so for a claim to hold.

    text: in words. verdict: judges an interval. distance: of a value from the nearest bound of the rule.
    """

    text: str
    verdict: Callable[[Estimate | None], Verdict]
    distance: Callable[[float], float]

    def p_value(self, measured: Estimate | None) -> float | None:
        """Return the two-sided p-value of the value lying on its side of the nearest bound, None where it is unknown.

        It is below 1 - LEVEL just where the interval decides.
        """
        if measured is None or measured.value is None:
            return None
        error, freedom = measured.standard_error, measured.freedom
        if error is None or freedom is None:
            return None
        distance = self.distance(measured.value)
        if error == 0:
            return 0.0 if distance > 0 else 1.0
        return float(2 * student_t.sf(distance / error, freedom))


def is_above(text: str, bound: float = 0.0) -> Rule:
    """Return the rule that a number is above a bound."""
    return Rule(text, lambda measured: above(measured, bound), lambda value: abs(value - bound))


def is_at_most(text: str, bound: float) -> Rule:
    """Return the rule that a number is at most a bound."""
    return Rule(text, lambda measured: at_most(measured, bound), lambda value: abs(value - bound))


def is_within(text: str, bound: float, middle: float = 0.0) -> Rule:
    """Return the rule that a number is within `bound` of `middle`: equivalence."""
    return Rule(text, lambda measured: within(measured, bound, middle), lambda value: abs(abs(value - middle) - bound))


def judged(
    family: str, words: str, paper: str, rule: Rule, measured: Estimate | None, trainings: int | None = None
) -> Claim:
    """Return a claim with its verdict, before the correction.

    trainings: behind the figure, of the network that has the fewest; None where that makes no difference.
    """
    too_few = trainings is not None and trainings < LEAST_TRAININGS
    return Claim(
        claim=words,
        paper=paper,
        rule=rule.text,
        measured=measured,
        verdict="undecided" if too_few else rule.verdict(measured),
        family=family,
        p_value=None if too_few else rule.p_value(measured),
    )


def corrected(claims: Sequence[Claim]) -> list[Claim]:
    """Return claims of which those are undecided that Holm's correction within their family does not leave decided."""
    kept = {family: _decided([c for c in claims if c.family == family]) for family in {c.family for c in claims}}
    return [
        c if c.p_value is None or c.p_value <= kept[c.family] else c.model_copy(update={"verdict": "undecided"})
        for c in claims
    ]


def _decided(family: Sequence[Claim]) -> float:
    """Return the largest p-value that Holm's step-down method rejects, -1 if it rejects none."""
    ordered = sorted(c.p_value for c in family if c.p_value is not None)
    largest = -1.0
    for k, p_value in enumerate(ordered):
        if p_value > (1 - LEVEL) / (len(ordered) - k):
            break
        largest = p_value
    return largest


def above(measured: Estimate | None, bound: float = 0.0) -> Verdict:
    """Return whether a number is above a bound: `holds` or `does not hold` where the whole interval says so."""
    if measured is None or measured.low is None or measured.high is None:
        return "undecided"
    if measured.low > bound:
        return "holds"
    return "does not hold" if measured.high <= bound else "undecided"


def at_most(measured: Estimate | None, bound: float) -> Verdict:
    """Return whether a number is at most a bound: `holds` or `does not hold` where the whole interval says so."""
    opposite: dict[Verdict, Verdict] = {"holds": "does not hold", "does not hold": "holds", "undecided": "undecided"}
    return opposite[above(measured, bound)]


def within(measured: Estimate | None, bound: float, middle: float = 0.0) -> Verdict:
    """Return whether a number lies within `bound` of `middle`: equivalence, for claims that two scores are alike."""
    if measured is None or measured.low is None or measured.high is None:
        return "undecided"
    low, high = measured.low - middle, measured.high - middle
    if -bound <= low and high <= bound:
        return "holds"
    return "does not hold" if low > bound or high < -bound else "undecided"


def all_of(verdicts: list[Verdict]) -> Verdict:
    """Return the verdict of a claim with several parts: it holds where all hold, and not where one does not."""
    if "does not hold" in verdicts:
        return "does not hold"
    return "undecided" if "undecided" in verdicts or not verdicts else "holds"
