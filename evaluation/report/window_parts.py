"""What is shown of an evaluation on windows."""

from __future__ import annotations

from isac_cosim.evaluation.on_windows.results import EvaluationResult
from isac_cosim.evaluation.report.parts import Part, Shown
from isac_cosim.evaluation.report.score_table import by_lead_table, headline, sections
from isac_cosim.evaluation.report.verdict import headline_difference, seeds_text, verdict

RECORD_FIGURE = "record.png"
CAPTIONS = {
    RECORD_FIGURE: "One record of an unseen seed: the target vehicle as the sites sensed it, with its true motion.",
    "confusion.png": "Predicted intentions of the windows of each true intention.",
    "lead_time.png": "Score against the time left until the maneuver commits.",
    "window_end.png": "Score against the time at which every window ends.",
    "unknown_lead_time.png": "Separation of following, against the time left until the maneuver commits.",
    "unknown_window_end.png": "Separation of following, against the time at which every window ends.",
    "unknown_roc.png": "Separation of the intentions seen in training from following, which was not.",
    "loss.png": "Training.",
}
"""Figures, in order, with their captions."""


class Headline:
    """What was measured, and the scores that sum it up."""

    result_class = EvaluationResult

    def parts(self, shown: Shown) -> list[Part]:
        result: EvaluationResult = shown.result
        windows, seeds = result.windows, result.made_by.seeds
        early, late = windows.end_after_s
        text = (
            f"{result.n} windows of {windows.window_s:g} s from {seeds_text(len(seeds))}, used neither for training "
            f"nor for any choice ({', '.join(seeds)}). Each window ends {early:g} to {late:g} s after "
            f"{windows.relative_to}. To classify a window that ends before the maneuver commits is prediction; one "
            "that ends after it, recognition."
        )
        numbers = [(value, name) for value, name in headline(result)]
        return [Part("headline", text=text, numbers=numbers, on_terminal=False)]


class WindowScores:
    """Prediction, recognition and the unknown class, run beside run."""

    result_class = EvaluationResult

    def parts(self, shown: Shown) -> list[Part]:
        return sections(shown.result)


class ScoresByLeadTime:
    """The scores of the evaluated run by lead time and intention; nothing where they were not measured."""

    result_class = EvaluationResult

    def parts(self, shown: Shown) -> list[Part]:
        result: EvaluationResult = shown.result
        if result.before_commit is None or not result.before_commit.by_lead:
            return []
        top, rows = by_lead_table(result.before_commit, result.classes)
        return [
            Part(
                "lead-times",
                f"{result.name}: windows that end so long before the commit, and not before the onset",
                rows=[dict(zip(top, row, strict=True)) for row in rows],
                strong=range(len(result.classes), len(rows)),
                on_terminal=False,
            )
        ]


class Verdict:
    """Which run is ahead, if it can be said, and how differences come about."""

    result_class = EvaluationResult

    def parts(self, shown: Shown) -> list[Part]:
        result: EvaluationResult = shown.result
        text = ""
        if result.compared:
            text = "Differences are paired on the same windows"
            paired = headline_difference(result.compared[0])
            if paired is not None and paired.has_interval:
                text += (
                    "; intervals are 95 % t intervals of the delete-one jackknife over the test seeds, and do not "
                    "cover what another training would change"
                )
            text += "."
        return [Part("verdict", text=text, sentences=verdict(result))]


class WindowFigures:
    """The figures that the folder holds."""

    result_class = EvaluationResult

    def parts(self, shown: Shown) -> list[Part]:
        captions = [(name, f"{text} {shown.remarks.get(name, '')}".strip()) for name, text in CAPTIONS.items()]
        return [Part("figures", figures=captions, on_terminal=False)]
