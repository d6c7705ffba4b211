"""A second test of the unknown: each known intention in turn is left out of training and is then the unknown one.

OUT/<intention>/               the run trained without it
OUT/<intention>/evaluation/    its evaluation
OUT/held_out.json              the table, by intention and score
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

from rich.table import Table

from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.files import claim, write_json
from isac_cosim.base.settings import Settings, WithOptionalParts
from isac_cosim.base.versions import OF_RUNS, versions
from isac_cosim.evaluation.on_windows.evaluation import evaluate_records
from isac_cosim.evaluation.on_windows.metrics import spread
from isac_cosim.evaluation.on_windows.results import DatasetOrigin, EvaluationResult, MeasuredWindows
from isac_cosim.evaluation.on_windows.score_results import Separation
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings
from isac_cosim.evaluation.report.figures import draw_figures
from isac_cosim.labeling.intentions import KNOWN, spoken
from isac_cosim.models.data.windows import Records
from isac_cosim.models.runs.former_names import OpenSetScore
from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.training import train_records

TABLE_FILE = "held_out.json"


class HeldOutRow(Settings):
    """How well a run trained without one intention separates it from the others.

    n: number of windows of that intention.
    n_known: number of windows of the intentions that were trained.
    macro_f1: on those.
    macro_f1_over: names of the intentions in that mean; None in files of earlier versions.
    unknown_score: the open-set score chosen on the validation seeds' `following`; the intention takes no part in that.
    unknown_scores: separation of the intention by each open-set score, by the score's name.
    """

    n: int
    n_known: int
    macro_f1: float | None
    macro_f1_over: list[str] | None = None
    unknown_score: OpenSetScore
    unknown_scores: dict[OpenSetScore, Separation]


class HeldOutMadeBy(Settings):
    """What made the table.

    dataset: where the windows come from.
    training: settings of the trainings, but for the intention held out.
    windows: the windows that were measured.
    seeds: measured scenario seeds, `<scenario>-<seed>`.
    versions: of the packages that scores depend on, by the package's name.
    """

    dataset: DatasetOrigin
    training: TrainSettings
    windows: MeasuredWindows
    seeds: list[str]
    versions: dict[str, str]


class HeldOutResult(WithOptionalParts):
    """The content of `held_out.json`.

    model: the predictor.
    held_out: a row for each known intention of the dataset, by its name.
    mean: mean over the intentions, of each open-set score that all rows have.
    made_by: dataset, settings and versions behind the table; absent until it is finished.
    """

    optional_parts: ClassVar[frozenset[str]] = frozenset({"made_by"})

    model: str
    held_out: dict[str, HeldOutRow]
    mean: dict[OpenSetScore, Separation]
    made_by: HeldOutMadeBy | None = None


def hold_out_each(
    records: Records,
    made_of: dict[str, Any],
    out: str | Path,
    settings: TrainSettings,
    evaluation: EvaluateSettings | None = None,
    feedback: Feedback = SILENT,
) -> HeldOutResult:
    """Train without each known intention of the records in turn, and measure how well it is separated.

    made_of: `digest` and `study` of the dataset that the records come from. out: folder to write.
    The same call again resumes where it stopped. Raises InputError where `out` holds something else.
    """
    with claim(Path(out), TABLE_FILE, "held-out study"):
        return _hold_out_each(records, made_of, Path(out), settings, evaluation or EvaluateSettings(), feedback)


def _hold_out_each(
    records: Records,
    made_of: dict[str, Any],
    folder: Path,
    settings: TrainSettings,
    evaluation: EvaluateSettings,
    feedback: Feedback,
) -> HeldOutResult:
    """Train and evaluate in a folder that is held."""
    _write(HeldOutResult(model=settings.model, held_out={}, mean={}), folder)
    rows: dict[str, HeldOutRow] = {}
    made_by = None
    for intention in (i for i in KNOWN if (records.label == i).any()):
        name = intention.text
        without = TrainSettings.model_validate({**settings.model_dump(), "held_out": name})
        run = train_records(records, made_of, folder / name, without, feedback)
        measured = evaluate_records(run, records, made_of, folder / name / "evaluation", evaluation)
        draw_figures(measured, folder / name / "evaluation")
        rows[name] = _row(measured.result)
        made_by = _made_by(measured.result, settings)
    result = HeldOutResult(
        model=settings.model,
        held_out=rows,
        mean=_means([row.unknown_scores for row in rows.values()]),
        made_by=made_by,
    )
    _write(result, folder)
    return result


def table(result: HeldOutResult) -> Table:
    """Return AUROC and false-positive rate at 95 % recall by intention and score, for the terminal.

    The score that the run chose is marked with a star.
    """
    title = "held out: AUROC / share taken for known (starred: the score that the run chose)"
    drawn = Table(title=title, title_justify="left")
    drawn.add_column("intention")
    for name in result.mean:
        drawn.add_column(spoken(name), justify="right")
    for intention, row in result.held_out.items():
        cells = [_cell(row.unknown_scores.get(name), name == row.unknown_score) for name in result.mean]
        drawn.add_row(spoken(intention), *cells)
    drawn.add_section()
    drawn.add_row("mean", *(_cell(separation, chosen=False) for separation in result.mean.values()))
    return drawn


def _row(result: EvaluationResult) -> HeldOutRow:
    assert result.held_out is not None
    return HeldOutRow(
        n=result.held_out.n,
        n_known=result.n,
        macro_f1=result.macro_f1,
        macro_f1_over=result.macro_f1_over,
        unknown_score=result.unknown_score,
        unknown_scores=result.held_out.unknown_scores,
    )


def _made_by(result: EvaluationResult, settings: TrainSettings) -> HeldOutMadeBy:
    return HeldOutMadeBy(
        dataset=result.made_by.dataset,
        training=settings,
        windows=result.windows,
        seeds=result.made_by.seeds,
        versions=versions(OF_RUNS),
    )


def _means(rows: Sequence[dict[str, Separation]]) -> dict[str, Separation]:
    """Return means over intentions, of the scores that all of them have."""
    shared = [name for name in rows[0] if all(name in row for row in rows)]
    return {
        name: Separation(
            auroc=spread([row[name].auroc for row in rows]).mean,
            fpr_at_95_recall=spread([row[name].fpr_at_95_recall for row in rows]).mean,
        )
        for name in shared
    }


def _cell(separation: Separation | None, chosen: bool) -> str:
    if separation is None or separation.auroc is None or separation.fpr_at_95_recall is None:
        return "-"
    return f"{separation.auroc:.3f} / {separation.fpr_at_95_recall:.2f}{' *' if chosen else ''}"


def _write(result: HeldOutResult, folder: Path) -> None:
    write_json(folder / TABLE_FILE, result.model_dump(mode="json"))
