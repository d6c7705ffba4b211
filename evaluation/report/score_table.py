"""The scores of an evaluation on windows, as parts: prediction first, then recognition."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from isac_cosim.evaluation.on_windows.results import EvaluationResult, RunResult
from isac_cosim.evaluation.on_windows.score_results import BeforeCommit, ClassifiedWindows, Difference, PairedDifference
from isac_cosim.evaluation.report.parts import Part, counted, interval_text
from isac_cosim.evaluation.report.verdict import difference_text, seeds_text
from isac_cosim.labeling.intentions import over_text, spoken
from isac_cosim.models.scores import open_set

PAPER_MSP_AUROC = 0.6994
"""AUROC of following by the maximum softmax probability in the ASI-BIP paper, of its own motion model."""


def head(result: EvaluationResult) -> list[str]:
    """Return the headings of the columns."""
    names = [run.name for run in result.runs]
    return ["", *names, *(f"{result.name} - {name} (95 %)" for name in names[1:])]


def sections(result: EvaluationResult) -> list[Part]:
    """Return prediction, its dependence on lead time, recognition, all windows, and the unknown class."""
    early = [run.before_commit for run in result.runs if run.before_commit is not None]
    parts = []
    if len(early) == len(result.runs):
        parts = [_before_commit(result, early), _by_lead(result, early), _after_commit(result)]
    return [part for part in (*parts, _all_windows(result), *_unknown(result)) if part.rows]


def _section(
    result: EvaluationResult, name: str, title: str, rows: Sequence[Sequence[str]], strong: Sequence[int] = ()
) -> Part:
    """Return rows under a title: a label, a cell for each run, and a cell for each difference to a compared run."""
    top = head(result)
    return Part(name, title, rows=[dict(zip(top, row, strict=True)) for row in rows], strong=strong, folded=True)


def by_lead_table(before: BeforeCommit, classes: Sequence[str]) -> tuple[list[str], list[list[str]]]:
    """Return head and rows of one run's scores by lead time: F1, recall and number of windows of each intention.

    The last rows have the macro-F1, of all maneuvers and by origin.
    """
    rows = []
    for name in classes:
        cells = [at_lead.per_class[name] for at_lead in before.by_lead]
        texts = [f"{cell(c.f1)}, {cell(c.recall)} ({c.n})" if c.n else "-" for c in cells]
        rows.append([_class_label(before, name), *texts])
    rows.append(["macro-F1", *(_macro_text(at_lead, classes) for at_lead in before.by_lead)])
    for origin in sorted({origin for at_lead in before.by_lead for origin in at_lead.by_origin}):
        parts = [at_lead.by_origin.get(origin) for at_lead in before.by_lead]
        rows.append([f"macro-F1, {origin}", *("-" if part is None else _macro_text(part, classes) for part in parts)])
    return ["F1, recall (windows)", *(f"{at_lead.lead_s:g} s" for at_lead in before.by_lead)], rows


def cell(value: float | None) -> str:
    """Return a score as text."""
    return "-" if value is None else f"{value:.3f}"


def with_interval(scores: ClassifiedWindows | RunResult) -> str:
    """Return a macro-F1 with its interval over scenario seeds."""
    return f"{cell(scores.macro_f1)}{interval_text(scores.macro_f1_low, scores.macro_f1_high)}"


def _before_commit(result: EvaluationResult, early: Sequence[BeforeCommit]) -> Part:
    """Return F1 of each intention, macro-F1 and accuracy of the windows before the commit."""
    first = early[0]
    pairs = [other.paired_difference_before_commit for other in result.compared]
    rows = [
        [
            f"{_class_label(first, name)}: {counted(first.per_class[name].n, 'window')}",
            *(cell(scores.per_class[name].f1) for scores in early),
            *_differences(pairs, _of_class(name)),
        ]
        for name in result.classes
    ]
    rows.append(
        [
            f"macro-F1{over_text(first.macro_f1_over, result.classes)}{_left_out(first, result.classes)}",
            *map(with_interval, early),
            *_differences(pairs, lambda paired: paired.macro_f1),
        ]
    )
    rows.append(["accuracy", *(cell(scores.accuracy) for scores in early), *("" for _ in pairs)])
    title = f"Prediction: F1 of {counted(first.n, 'window')} ending before the commit, {seeds_text(first.groups)}"
    return _section(result, "before-commit", title, rows, (len(rows) - 2, len(rows) - 1))


def _by_lead(result: EvaluationResult, early: Sequence[BeforeCommit]) -> Part:
    """Return the macro-F1 of each run at each lead time, and the difference to each compared run."""
    rows = []
    for k, at_lead in enumerate(early[0].by_lead):
        label = (
            f"{at_lead.lead_s:g} s before: {counted(at_lead.n, 'window')}, {_intentions(at_lead, result.classes)}, "
            f"{seeds_text(at_lead.groups)}"
        )
        scores = [scores.by_lead[k] for scores in early]
        pairs = [other.difference_at(at_lead.lead_s) for other in result.compared]
        differences = _differences(pairs, lambda paired: paired.macro_f1)
        rows.append([label, *(cell(score.macro_f1) for score in scores), *differences])
    return _section(result, "by-lead", "Prediction: macro-F1 of windows that end so long before the commit", rows)


def _after_commit(result: EvaluationResult) -> Part:
    """Return macro-F1 and accuracy of the windows after the commit."""
    late = [run.after_commit for run in result.runs if run.after_commit is not None]
    if len(late) < len(result.runs) or not late[0].n:
        return Part("after-commit")
    blank = ["" for _ in result.compared]
    rows = [
        [f"macro-F1{over_text(late[0].macro_f1_over, result.classes)}", *map(with_interval, late), *blank],
        ["accuracy", *(cell(scores.accuracy) for scores in late), *blank],
    ]
    title = f"Recognition: {counted(late[0].n, 'window')} ending after the commit, {seeds_text(late[0].groups)}"
    return _section(result, "after-commit", title, rows)


def _all_windows(result: EvaluationResult) -> Part:
    """Return the scores of the windows of the papers, wherever they end."""
    runs, pairs = result.runs, [other.paired_difference for other in result.compared]
    blank = ["" for _ in pairs]
    five = [run.five_classes for run in runs]
    hard_pair = [run.overtake_against_left for run in runs]
    change = spoken(hard_pair[0].intentions[0])
    of_five = "" if five[0] is None else over_text(five[0].macro_f1_over, five[0].classes)
    rows = [
        [
            f"macro-F1{over_text(result.macro_f1_over, result.classes)}",
            *(cell(run.macro_f1) for run in runs),
            *_differences(pairs, lambda paired: paired.macro_f1),
        ],
        ["accuracy", *(cell(run.accuracy) for run in runs), *blank],
        [
            f"macro-F1 of five, overtake and {change} as one{of_five}",
            *(cell(None if scores is None else scores.macro_f1) for scores in five),
            *blank,
        ],
        [
            f"overtake or {change}: accuracy (AUROC)",
            *(f"{cell(scores.accuracy)} ({cell(scores.auroc)})" for scores in hard_pair),
            *blank,
        ],
    ]
    title = f"All of {counted(result.n, 'window')}, before and after the commit, as the papers count"
    return _section(result, "all-windows", title, rows)


def _unknown(result: EvaluationResult) -> list[Part]:
    """Return the separation of `following`: by scores that never saw mere driving, then by the pre-onset detector."""
    runs, blank = result.runs, ["" for _ in result.compared]
    if not result.n_unknown:
        return []

    def row(name: str, label: str) -> list[str]:
        parts = [run.unknown_scores.get(name) for run in runs]
        return [label, *("-" if part is None else cell(part.auroc) for part in parts), *blank]

    labels = {open_set.PLAIN: f"maximum softmax probability (ASI-BIP paper: {PAPER_MSP_AUROC})"}
    names = [name for name in open_set.WITHOUT_DRIVING if name in result.unknown_scores]
    rows = [row(name, labels.get(name, spoken(name))) for name in names]
    title = f"Unknown: AUROC of {counted(result.n_unknown, 'window')} of following, by scores that saw no driving"
    sections = [_section(result, "unknown", title, rows)]
    if any(open_set.PRE_ONSET_DETECTOR in run.unknown_scores for run in runs):
        detector = row(open_set.PRE_ONSET_DETECTOR, "AUROC of following")
        title = "Detector trained on pre-onset driving: it recognises driving, not novelty"
        sections.append(_section(result, "pre-onset", title, [detector]))
    return sections


def _class_label(before: BeforeCommit, name: str) -> str:
    """Return an intention's name, with a remark where it commits too soon after its onset to be predicted."""
    delay = before.onset_to_commit[name]
    if not delay.at_once or delay.median_s is None:
        return spoken(name)
    return f"{spoken(name)} (commits {delay.median_s:.2f} s after onset)"


def _left_out(scores: ClassifiedWindows, classes: Sequence[str]) -> str:
    """Return a remark on the intentions that a macro-F1 leaves out, or nothing."""
    names = [spoken(name) for name in classes if name not in scores.macro_f1_over]
    return f", too few windows of {', '.join(names)}" if names else ""


def _macro_text(scores: ClassifiedWindows, classes: Sequence[str]) -> str:
    """Return a macro-F1 with the number of intentions and windows behind it."""
    if scores.macro_f1 is None:
        return "-"
    return f"{with_interval(scores)}, {_intentions(scores, classes)}, {counted(scores.n, 'window')}"


def _intentions(scores: ClassifiedWindows, classes: Sequence[str]) -> str:
    """Return over how many intentions a macro-F1 is taken."""
    return f"{len(scores.macro_f1_over)} of {len(classes)} intentions"


def _of_class(name: str) -> Callable[[PairedDifference], Difference]:
    """Return what chooses the difference in the F1 of an intention."""
    return lambda paired: paired.per_class_f1[name]


def _differences(
    pairs: Sequence[PairedDifference | None], choose: Callable[[PairedDifference], Difference]
) -> list[str]:
    """Return a cell for the difference to each compared run."""
    return ["-" if paired is None else difference_text(paired, choose(paired)) for paired in pairs]


def headline_scores(run: RunResult) -> dict[str, Any] | None:
    """Return the scores before the commit as plain values, for `--json`; None where they were not measured."""
    if run.before_commit is None:
        return None
    return run.before_commit.model_dump(
        mode="json", include={"n", "groups", "accuracy", "macro_f1", "macro_f1_low", "macro_f1_high", "macro_f1_over"}
    )


def headline(run: RunResult) -> list[tuple[str, str]]:
    """Return the scores that sum up a run, with their names, the most important first."""
    scores = []
    if (early := run.before_commit) is not None:
        over = over_text(early.macro_f1_over, run.classes)
        scores.append((with_interval(early), f"macro-F1 before the commit{over}, {seeds_text(early.groups)}"))
    if (late := run.after_commit) is not None and late.n:
        over = over_text(late.macro_f1_over, run.classes)
        scores.append((with_interval(late), f"macro-F1 after the commit{over}"))
    over = over_text(run.macro_f1_over, run.classes)
    scores.append((with_interval(run), f"macro-F1 of all windows{over}"))
    return scores
