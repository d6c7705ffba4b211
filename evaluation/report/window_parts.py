"""What is shown of an evaluation on windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from isac_cosim.evaluation.on_windows.results import EvaluationResult
from isac_cosim.evaluation.report.figures import FALSE_KNOWN, LEAST_WINDOWS, SCORE, TRUE_KNOWN
from isac_cosim.evaluation.report.html.charts import Chart
from isac_cosim.evaluation.report.parts import Part, Row, Shown, counted, read_table
from isac_cosim.evaluation.report.score_table import by_lead_table, headline, sections
from isac_cosim.evaluation.report.verdict import headline_difference, seeds_text, verdict
from isac_cosim.labeling.intentions import KNOWN, spoken
from isac_cosim.models.data.sides import warning

RECORD_FIGURE = "record.png"
CAPTIONS = {
    RECORD_FIGURE: "One record of an unseen seed: the target vehicle as the sites sensed it, with its true motion.",
    "confusion.png": "Predicted intentions of the windows of each true intention, before and after the commit.",
    "lead_time.png": "Score against the time left until the maneuver commits.",
    "window_end.png": "Score against the time at which every window ends.",
    "unknown_lead_time.png": "Separation of following, against the time left until the maneuver commits.",
    "unknown_window_end.png": "Separation of following, against the time at which every window ends.",
    "unknown_roc.png": "Separation of the intentions seen in training from following, which was not.",
    "loss.png": "How the training went: loss, and scores on the validation seeds, by epoch.",
}
"""Figures, in order, with their captions."""
SEEN = {
    RECORD_FIGURE: "The road from above with the sensed path over the true one, six panels of position, velocity and "
    "acceleration, true and sensed, and the probability of each intention against the end of the window.",
    "unknown_lead_time.png": "Two charts: AUROC of following and its false-positive rate, a line for each predictor.",
    "unknown_window_end.png": "Two charts: AUROC of following and its false-positive rate, a line for each predictor.",
    "unknown_roc.png": "ROC curves above the diagonal of chance, a line for each score, named with its area.",
    "loss.png": "Two charts by epoch: loss of training and validation; validation scores, the kept epoch marked.",
}
"""What there is to be seen, where it does not depend on the result."""

OVER, UNKNOWN = "over intentions", ("AUROC of following", "false-positive rate at 95 % recall")
"""Columns of the tables behind the figures."""
HOLLOW = f"Hollow marks: over fewer than {len(KNOWN)} intentions."
LEAD = Chart(
    "lead s",
    ("macro-F1",),
    x_title="end of window before the commit, s",
    backwards=True,
    guide=(0.0, "commit"),
    least=LEAST_WINDOWS,
    whole=(OVER, len(KNOWN)),
)
"""Time runs to the right: windows that end long before the commit come first."""
CHARTS = {
    "lead_time.png": LEAD,
    "unknown_lead_time.png": replace(LEAD, panels=UNKNOWN, whole=None),
    "unknown_roc.png": Chart(
        FALSE_KNOWN, (TRUE_KNOWN,), "score", ranges=((0.0, 1.0), (0.0, 1.01)), diagonal="chance"
    ),
    "loss.png": Chart("epoch", ("loss", SCORE), "of", ranges=(None, None)),
}  # fmt: skip
"""Curves that the page draws itself."""


class Headline:
    """What was measured, in a sentence, and the scores that sum it up."""

    result_class = EvaluationResult

    def parts(self, shown: Shown) -> list[Part]:
        result: EvaluationResult = shown.result
        text = (
            f"What {result.name} knows of a driver's intention from {counted(result.n, 'window')} of "
            f"{result.windows.window_s:g} s, in {seeds_text(len(result.made_by.seeds))} of traffic that it never saw."
        )
        return [Part("headline", text=text, numbers=headline(result)[:3], on_terminal=False)]


class DependentSeeds:
    """A warning beside the headline where test samples have twins among those that were trained on."""

    result_class = EvaluationResult

    def parts(self, shown: Shown) -> list[Part]:
        result: EvaluationResult = shown.result
        line = warning(result.dependence)
        return [] if line is None else [Part("dependent-seeds", sentences=[line])]


class HowMeasured:
    """Which windows of which seeds were measured, and what prediction and recognition mean."""

    result_class = EvaluationResult

    def parts(self, shown: Shown) -> list[Part]:
        result: EvaluationResult = shown.result
        windows, seeds = result.windows, result.made_by.seeds
        early, late = windows.end_after_s
        text = (
            f"{counted(result.n, 'window')} of {windows.window_s:g} s from {seeds_text(len(seeds))}, used neither for "
            f"training nor for any choice ({', '.join(seeds)}). Each window ends {early:g} to {late:g} s after "
            f"{windows.relative_to}. To classify a window that ends before the maneuver commits is prediction; one "
            "that ends after it, recognition."
        )
        return [Part("how-measured", "How it was measured", text, on_terminal=False)]


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
                folded=True,
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
    """The figures that the folder holds, with what there is to be seen and the numbers behind them."""

    result_class = EvaluationResult

    def parts(self, shown: Shown) -> list[Part]:
        result: EvaluationResult = shown.result
        leads, ends = _lead_rows(result), _end_rows(result)
        rows = {
            "confusion.png": _confusion_rows(result),
            "lead_time.png": leads,
            "unknown_lead_time.png": leads,
            "window_end.png": ends,
            "unknown_window_end.png": ends,
            **{name: read_table((shown.folder / name).with_suffix(".csv")) for name in ("unknown_roc.png", "loss.png")},
        }
        charts = {**CHARTS, **_end_charts(result.windows.relative_to)}
        said = {
            name: HOLLOW
            for name, chart in charts.items()
            if any(chart.hollow(row) and row["macro-F1"] is not None for row in chart.drawn(rows.get(name, ())))
        }
        captions = [
            (name, " ".join(filter(None, (text, shown.remarks.get(name), said.get(name)))))
            for name, text in CAPTIONS.items()
        ]
        seen = {
            **SEEN,
            "confusion.png": _seen_confusion(result),
            "lead_time.png": _seen_line(result.name, [(row.middle_s, row.macro_f1) for row in result.by_lead_time]),
            "window_end.png": _seen_line(
                result.name, [(row.end_s, row.macro_f1) for row in result.by_window_end or []], "after"
            ),
        }
        return [Part("figures", figures=captions, seen=seen, figure_rows=rows, charts=charts, on_terminal=False)]


def _end_charts(relative_to: str) -> dict[str, Chart]:
    """Return how the scores by the end of the window are drawn. relative_to: onset or commit."""
    against = Chart(
        f"end after {relative_to} s",
        ("macro-F1",),
        x_title=f"end of window after {relative_to}, s",
        guide=(0.0, relative_to),
        whole=(OVER, len(KNOWN)),
    )
    return {"window_end.png": against, "unknown_window_end.png": replace(against, panels=UNKNOWN, whole=None)}


def _lead_rows(result: EvaluationResult) -> list[Row]:
    """Return the scores of every run by lead time."""
    return [
        {
            "predictor": run.name,
            "lead s": row.middle_s,
            "lead from s": row.from_s,
            "lead to s": row.to_s,
            "windows": row.n,
            "macro-F1": row.macro_f1,
            OVER: None if row.macro_f1_over is None else len(row.macro_f1_over),
            UNKNOWN[0]: row.auroc_unknown,
            UNKNOWN[1]: row.fpr_at_95_recall,
        }
        for run in result.runs
        for row in run.by_lead_time
    ]


def _end_rows(result: EvaluationResult) -> list[Row]:
    """Return the scores of every run by the end of the window."""
    return [
        {
            "predictor": run.name,
            f"end after {result.windows.relative_to} s": row.end_s,
            "macro-F1": row.macro_f1,
            OVER: None if row.macro_f1_over is None else len(row.macro_f1_over),
            UNKNOWN[0]: row.auroc_unknown,
            UNKNOWN[1]: row.fpr_at_95_recall,
        }
        for run in result.runs
        for row in run.by_window_end or []
    ]


def _confusion_rows(result: EvaluationResult) -> list[Row]:
    return [
        {"true": true, "predicted": predicted, "windows": count}
        for true, counts in zip(result.classes, result.confusion, strict=True)
        for predicted, count in zip(result.classes, counts, strict=True)
    ]


def _seen_confusion(result: EvaluationResult) -> str:
    """Return what there is to be seen in the confusion matrix: how much is right, and the most frequent error."""
    cells = [
        (count, result.classes[i], result.classes[j])
        for i, counts in enumerate(result.confusion)
        for j, count in enumerate(counts)
        if i != j
    ]
    right = sum(counts[i] for i, counts in enumerate(result.confusion))
    said = f"{right} of {counted(result.n, 'window')} lie on the diagonal"
    worst = max(cells, default=(0, "", ""))
    return f"{said}." if not worst[0] else (
        f"{said}; the most frequent error takes {spoken(worst[1])} for {spoken(worst[2])}, "
        f"in {counted(worst[0], 'window')}."
    )  # fmt: skip


def _seen_line(name: str, points: Sequence[tuple[float, float | None]], side: str = "before the commit") -> str:
    """Return what there is to be seen in a line of macro-F1: its first, highest and last point."""
    known = [(at, score) for at, score in points if score is not None]
    if not known:
        return f"No score of {name} is defined."
    top = max(known, key=lambda point: point[1])
    ends = ", ".join(f"{score:.2f} at {at:g} s" for at, score in (known[0], known[-1]))
    where = "lead time" if side == "before the commit" else "end of the window"
    return f"Macro-F1 of {name} by {where}: {ends}; the highest is {top[1]:.2f} at {top[0]:g} s."
