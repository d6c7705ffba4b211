"""Whether the TV passes the UV soon: the answers to a question that every pull-out answers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from isac_cosim.evaluation.on_windows.results import EvaluationResult, PassAnswer, PassScores
from isac_cosim.evaluation.report.html.charts import Chart
from isac_cosim.evaluation.report.parts import Part, Row, Shown, interval_text
from isac_cosim.evaluation.report.score_table import head
from isac_cosim.evaluation.report.verdict import seeds_text

QUESTION = "Does the TV pass the UV within a time of the window's end?"


TEXT = (
    "Every pull-out behind a UV is asked, whether it is an overtake, a lane change or in no class. A run answers with "
    "its probability of an overtake, as a share of that of an overtake or a change to the faster side; the trees learn "
    "the question itself, from the training seeds, and are calibrated on the validation seeds."
)
FIGURE = (
    ("passing.png", "How often the TV passes the UV, against the probability of trees trained on this question."),
)

PROBABILITY, SHARE = "probability of passing", "share that passes"
CHART = Chart(
    PROBABILITY, (SHARE,), "TV passes the UV", ranges=((0.0, 1.0), (0.0, 1.01)), diagonal="calibrated"
)  # fmt: skip


class PassesUv:
    """The answers of the runs and of trees that were trained on the question."""

    result_class = EvaluationResult

    def parts(self, shown: Shown) -> list[Part]:
        """Return the table of the page and that of the terminal; nothing where it was not asked."""
        result: EvaluationResult = shown.result
        if not result.passing:
            return []
        top, rows = passing_table(result.passing)
        strong = range(len(result.runs) + 1)
        page = Part(
            "passing",
            QUESTION,
            TEXT,
            _under(top, rows),
            FIGURE,
            strong=strong,
            figure_rows={FIGURE[0][0]: [*_reliability_rows(result.passing)]},
            charts={FIGURE[0][0]: CHART},
            folded=True,
            on_terminal=False,
        )
        columns = head(result)
        brief = _under(columns, passing_rows(result.passing, len(columns) - 1))
        title = f"{QUESTION} AUROC, {seeds_text(result.passing[0].groups)}"
        return [page, Part("passing-in-brief", title, rows=brief, on_page=False)]


def _under(top: Sequence[str], rows: Sequence[Sequence[str]]) -> list[Row]:
    return [dict(zip(top, row, strict=True)) for row in rows]


def _reliability_rows(passing: Sequence[PassScores]) -> Iterator[Row]:
    for part in passing:
        for row in [] if part.trained is None else part.trained.reliability:
            yield {
                CHART.line: f"within {part.within_s:g} s",
                PROBABILITY: row.mean_probability,
                SHARE: row.share_passed,
                "windows": row.n,
            }


def passing_table(passing: Sequence[PassScores]) -> tuple[list[str], list[list[str]]]:
    """Return head and rows: a column for each time, a row for each answer, then what stands behind them."""
    rows = [
        [answer.name, *(answer_text(part.answers[k]) for part in passing)]
        for k, answer in enumerate(passing[0].answers)
    ]
    rows.append(["boosted trees trained on this question", *_of(passing, _trained_text)])
    rows.append(["their Brier score (that of the base rate)", *_of(passing, _brier_text)])
    rows.append(["their calibration error", *_of(passing, _calibration_text)])
    rows.append(["base rate: share of windows after which the TV passes", *_of(passing, _base_rate_text)])
    rows.append(["windows, pull-outs, test seeds", *_of(passing, _counts_text)])
    rows.append(["pull-outs that are in no class", *_of(passing, lambda part: str(dropped_count(part)))])
    rows.append(["not asked: passed before the end, not observed for so long", *_of(passing, _not_asked_text)])
    return ["AUROC (95 %)", *(f"within {part.within_s:g} s" for part in passing)], rows


def passing_rows(passing: Sequence[PassScores], columns: int) -> list[list[str]]:
    """Return rows for the table on the terminal: one for each time with the runs' answers, and one of trained trees.

    columns: number of cells of a row after its label.
    """
    rows = []
    for part in passing:
        known = f"{part.n} windows of {sum(part.pull_outs.values())} pull-outs, base rate {_number(part.base_rate)}"
        cells = [answer_text(answer) for answer in part.answers]
        rows.append([f"within {part.within_s:g} s: {known}", *cells, *[""] * (columns - len(cells))])
        if part.trained is not None:
            rows.append([f"trees trained on this question: {answer_text(part.trained)}", *[""] * columns])
    return rows


def answer_text(answer: PassAnswer) -> str:
    """Return an AUROC with its interval over scenario seeds."""
    return f"{_number(answer.auroc)}{interval_text(answer.auroc_low, answer.auroc_high)}"


def dropped_count(part: PassScores) -> int:
    """Return how many of the pull-outs are in no class."""
    return sum(number for outcome, number in part.pull_outs.items() if outcome not in ("overtaken", "not_passed"))


def _of(passing: Sequence[PassScores], text: Callable[[PassScores], str]) -> list[str]:
    return [text(part) for part in passing]


def _trained_text(part: PassScores) -> str:
    return "-" if part.trained is None else answer_text(part.trained)


def _brier_text(part: PassScores) -> str:
    return "-" if part.trained is None else f"{_number(part.trained.brier)} ({_number(part.brier_of_base_rate)})"


def _calibration_text(part: PassScores) -> str:
    return "-" if part.trained is None else _number(part.trained.calibration_error)


def _base_rate_text(part: PassScores) -> str:
    return _number(part.base_rate)


def _counts_text(part: PassScores) -> str:
    return f"{part.n}, {sum(part.pull_outs.values())}, {seeds_text(part.groups)}"


def _not_asked_text(part: PassScores) -> str:
    return f"{part.already_passed}, {part.censored}"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
