"""The parts of every kind of result, in the order in which they are shown.

To add a part, write a class that fulfils `parts.ResultPart` and give it a line below; a package of its own gives it an
entry point of the group `isac_cosim.result_parts`. One that also measures something has a method `measure`
(`evaluation.questions`).
"""

from __future__ import annotations

from collections.abc import Sequence

from isac_cosim.base.registry import Registry
from isac_cosim.evaluation.in_traffic.scores.results import TrafficResult
from isac_cosim.evaluation.on_windows.results import EvaluationResult
from isac_cosim.evaluation.questions import GROUP
from isac_cosim.evaluation.report import live_parts, loop_parts, window_parts
from isac_cosim.evaluation.report.explained_part import Explained
from isac_cosim.evaluation.report.first_screen import ByIntention, ConfusionMatrix, MovingRoad
from isac_cosim.evaluation.report.parts import Part, ResultPart, Shown
from isac_cosim.evaluation.report.passing_part import PassesUv


class MostSpecific:
    """Answers of one question for kinds of results: that for the narrowest class which a result has is shown.

    answers: that for all results first, each further one for a class of its own.
    """

    def __init__(self, *answers: ResultPart) -> None:
        self.answers = answers
        self.result_class = answers[0].result_class

    def parts(self, shown: Shown) -> Sequence[Part]:
        return [answer for answer in self.answers if isinstance(shown.result, answer.result_class)][-1].parts(shown)


RESULT_PARTS: Registry[ResultPart] = Registry(
    "result part",
    {
        "headline": window_parts.Headline(),
        "dependent-seeds": window_parts.DependentSeeds(),
        "replay": MovingRoad(EvaluationResult),
        "f1-by-intention": ByIntention(),
        "confusion": ConfusionMatrix(),
        "verdict": window_parts.Verdict(),
        "window-figures": window_parts.WindowFigures(),
        "scores": window_parts.WindowScores(),
        "lead-times": window_parts.ScoresByLeadTime(),
        "passing": PassesUv(),
        "how-measured": window_parts.HowMeasured(),
        "explained": Explained(),
        "live-first": MostSpecific(live_parts.LiveFirst(), loop_parts.LoopFirst()),
        "live-replay": MovingRoad(TrafficResult),
        "advisories": loop_parts.Advisories(),
        "live-headline": live_parts.LiveHeadline(),
        "live-compared": live_parts.LiveCompared(),
        "alarms": live_parts.AlarmsByIntention(),
        "alarms-in-words": live_parts.InWords(),
        "live-figures": live_parts.LiveFigures(),
    },
    GROUP,
)


def parts_of(shown: Shown) -> list[Part]:
    """Return all parts of a result, in order. Raises InputError for a part of a package that cannot be imported."""
    chosen = [part for part in RESULT_PARTS.values() if isinstance(shown.result, part.result_class)]
    return [answer for part in chosen for answer in part.parts(shown)]
