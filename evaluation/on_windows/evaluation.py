"""Measures runs on the windows of a dataset; writes `metrics.json`, and `predictions.parquet` beside it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import softmax

from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.files import claim, write_json
from isac_cosim.base.versions import OF_RUNS, versions
from isac_cosim.base.workers.threads import limited
from isac_cosim.evaluation.on_windows import commit, metrics, repeats
from isac_cosim.evaluation.on_windows import commit as unknown
from isac_cosim.evaluation.on_windows.explained import check_explainable, explain
from isac_cosim.evaluation.on_windows.maneuvers import maneuver_scores
from isac_cosim.evaluation.on_windows.passing import Passing, PullOuts, ask, ends_of, pass_scores
from isac_cosim.evaluation.on_windows.prediction_table import write_predictions
from isac_cosim.evaluation.on_windows.predictions import Predictions, ends_at_lead, predict, unseen
from isac_cosim.evaluation.on_windows.repeats import MeasuredRun
from isac_cosim.evaluation.on_windows.results import (
    METRICS_FILE,
    ComparedResult,
    DatasetOrigin,
    EvaluationResult,
    MadeBy,
    MeasuredWindows,
    RunResult,
)
from isac_cosim.evaluation.on_windows.score_results import Calibration, ManeuverScores, WindowEndScores
from isac_cosim.evaluation.on_windows.settings import EvaluateSettings, WindowEndCurveSettings
from isac_cosim.evaluation.questions import with_answers
from isac_cosim.labeling.dataset.dependence import Dependence
from isac_cosim.models.data.sides import dependence_of_test
from isac_cosim.models.data.windows import Ends, Records, WindowSettings, draw_ends, end_bounds
from isac_cosim.models.runs.run import Run
from isac_cosim.models.scores import open_set
from isac_cosim.models.scores.calibration import calibration_error

if TYPE_CHECKING:
    from isac_cosim.labeling.dataset.dataset import Dataset


@dataclass(frozen=True)
class Evaluation:
    """An evaluation: its result, as `metrics.json` holds it, and the predictions behind it.

    measured: the evaluated run and those compared with it, in that order. passing: the windows of pull-outs; None where
    the dataset does not say when they pass.
    """

    result: EvaluationResult
    measured: tuple[MeasuredRun, ...]
    passing: Passing | None = None


@dataclass(frozen=True)
class SharedEnds:
    """Ends of the windows on which all compared runs are measured.

    drawn: those of the evaluation. at_leads: ends at a fixed time before the commit, by that time, s. dropped: records
    of pull-outs that are in no class, with the ends of their windows; None where there are none.
    """

    drawn: Ends
    at_leads: Mapping[float, Ends]
    dropped: tuple[Records, Ends] | None = None


def evaluate(
    run: Run,
    dataset: Dataset,
    out: str | Path | None,
    settings: EvaluateSettings | None = None,
    against: Sequence[Run] = (),
    explains: bool = False,
) -> Evaluation:
    """Measure a run on the seeds of a dataset that it was not trained or chosen on; write metrics.json and predictions.

    out: folder to write; with None, nothing is written. against: runs to compare with on the same windows, e.g. floors,
    each with its paired difference. Runs that differ in the training seed alone are also summed up in
    `over_training_seeds`. explains: whether what the modules of a CaSTFormer do is part of the result.
    Raises InputError where no unseen seed is left, the sampling rates differ, or `out` holds something else.
    """
    origin = {"digest": dataset.digest, "study": dataset.meta.study}
    records, card = Records.of(dataset), run.card
    twins = dependence_of_test(dataset, records, card.split, card.settings.split)
    pull_outs = PullOuts.of(dataset)
    chosen = settings or EvaluateSettings()
    return evaluate_records(run, records, origin, out, chosen, against, pull_outs, twins, explains)


@limited()
def evaluate_records(
    run: Run,
    records: Records,
    made_of: Mapping[str, object],
    out: str | Path | None,
    settings: EvaluateSettings,
    against: Sequence[Run] = (),
    pull_outs: PullOuts | None = None,
    dependence: Dependence | None = None,
    explains: bool = False,
) -> Evaluation:
    """Measure a run on records in memory; otherwise as `evaluate`.

    made_of: `digest` and `study` of the dataset that the records come from. pull_outs: of that dataset; without them,
    it is not asked whether the TV passes the UV. dependence: of the test samples on those that the run was trained on.
    """
    origin = DatasetOrigin.model_validate(made_of)
    with claim(Path(out), METRICS_FILE, "evaluation") if out is not None else nullcontext():
        evaluation = _evaluate([run, *against], records, origin, settings, pull_outs, dependence, explains)
        if out is None:
            return evaluation
        write_json(Path(out) / METRICS_FILE, evaluation.result.model_dump(mode="json"))
        write_predictions(evaluation.measured, Path(out), evaluation.passing)
    return evaluation


def _evaluate(
    runs: Sequence[Run],
    all_records: Records,
    origin: DatasetOrigin,
    settings: EvaluateSettings,
    pull_outs: PullOuts | None,
    dependence: Dependence | None,
    explains: bool,
) -> Evaluation:
    """Measure runs on the same windows; the first is the evaluated one."""
    for run in runs:
        if run.is_of_streams:
            raise InputError(f"{run.path}: was trained on streams; evaluate it in traffic: --traffic SCENARIO")
    if explains:
        check_explainable(runs[0])
    records = unseen(all_records, runs)
    windows = runs[0].card.settings.windows
    if settings.end_after_s is not None:
        windows = WindowSettings.model_validate({**windows.model_dump(), "end_after_s": settings.end_after_s})
    ends = draw_ends(records, windows, "evaluate", settings.seed, per_record=settings.ends_per_record)
    at_leads = {lead_s: ends_at_lead(records, windows, lead_s) for lead_s in settings.leads_s}
    dropped = None if pull_outs is None else _dropped_ends(pull_outs, records, windows, settings)
    shared = SharedEnds(ends, {lead_s: at_lead for lead_s, at_lead in at_leads.items() if len(at_lead)}, dropped)
    names = _distinct_names(runs)
    measured = [measure(run, name, records, shared, settings) for run, name in zip(runs, names, strict=True)]
    passing = None if pull_outs is None else ask(pull_outs, all_records, measured[0], windows, settings)
    repeated = len(repeats.grouped(measured)) < len(measured)
    result = EvaluationResult(
        **dict(measured[0].result),
        compared=[
            ComparedResult(
                **dict(other.result),
                paired_difference=repeats.difference(measured[:1], [other]),
                paired_difference_before_commit=repeats.difference_before_commit(measured[:1], [other]),
                paired_difference_by_lead=repeats.differences_by_lead(measured[:1], [other]),
            )
            for other in measured[1:]
        ],
        over_training_seeds=repeats.over_training_seeds(measured) if repeated else None,
        passing=None if passing is None else pass_scores(passing, measured),
        dependence=dependence,
        explained=explain(runs[0], records, ends, measured[0].predictions) if explains else None,
        windows=MeasuredWindows(
            **dict(windows),
            ends_per_record=settings.ends_per_record,
            leads_s=settings.leads_s,
            seed=settings.seed,
            window_end_curve=settings.window_end_curve,
        ),
        made_by=MadeBy(
            dataset=origin,
            seeds=sorted(set(records.groups)),
            runs=[run.card for run in runs],
            versions=versions(OF_RUNS),
        ),
    )
    return with_answers(Evaluation(result, tuple(measured), passing))


def _dropped_ends(
    pull_outs: PullOuts, records: Records, windows: WindowSettings, settings: EvaluateSettings
) -> tuple[Records, Ends] | None:
    """Return the dropped pull-outs of the seeds of some records, with the ends of their windows; None without any."""
    dropped = pull_outs.dropped.take(np.isin(pull_outs.dropped.groups, np.unique(records.groups.astype(str))))
    ends = ends_of(dropped, windows, settings.seed, settings.ends_per_record)
    return (dropped, ends) if len(ends) else None


def measure(run: Run, name: str, records: Records, ends: SharedEnds, settings: EvaluateSettings) -> MeasuredRun:
    """Return a run's predictions on the windows with those ends, and all its metrics.

    name: of the run in the result.
    """
    predictions = predict(run, records, ends.drawn)
    at_leads = {lead_s: predict(run, records, at_lead) for lead_s, at_lead in ends.at_leads.items()}
    dropped = None if ends.dropped is None else predict(run, *ends.dropped)
    curve = settings.window_end_curve
    at_ends = {} if curve is None else predict_at_ends(run, records, curve)
    result = run_result(run, name, predictions, at_leads)
    if curve is not None:
        result = result.model_copy(update={"by_window_end": window_end_scores(run, at_ends)})
    return MeasuredRun(run, predictions, result, at_leads, at_ends, dropped)


def run_result(run: Run, name: str, predictions: Predictions, at_leads: Mapping[float, Predictions]) -> RunResult:
    """Return all metrics of a run but the window-end curve.

    name: of the run in the result. at_leads: predictions on windows that end at a fixed time before the commit, by that
    time, s.
    """
    card, known, classes = run.card, predictions.known, run.card.classes
    values = {score_name: score(predictions.outputs) for score_name, score in open_set.of_run(run).items()}
    chosen, unknown_scores = values[card.unknown_score], unknown.following_scores(predictions, values)
    label, predicted, logits = predictions.label[known], predictions.predicted[known], predictions.outputs.logits[known]
    groups, low, high = metrics.summary_interval(label, predicted, predictions.group[known], len(classes))
    return RunResult(
        model=card.settings.model,
        name=name,
        classes=classes,
        **dict(metrics.summary(label, predicted, classes)),
        groups=groups,
        macro_f1_low=low,
        macro_f1_high=high,
        before_commit=commit.before_commit(predictions, at_leads, classes),
        after_commit=commit.after_commit(predictions, classes),
        five_classes=commit.five_classes(predictions, classes),
        maneuvers=maneuver_scores(metrics.confusion(label, predicted, len(classes))),
        maneuvers_with_background=maneuvers_with_background(run, predictions, chosen),
        overtake_against_left=commit.overtake_or_change(predictions, classes),
        n_unknown=int(predictions.unknown.sum()),
        auroc_unknown=unknown_scores[card.unknown_score].auroc,
        unknown_score=card.unknown_score,
        unknown_scores=unknown_scores,
        held_out=unknown.held_out_scores(predictions, values),
        calibration=calibration(logits, label, card.temperature),
        by_lead_time=metrics.by_lead_time(
            predictions.lead_s[known],
            label,
            predicted,
            classes,
            unknown.separation_of_rows(chosen[known], chosen[predictions.unknown]),
        ),
        by_snr=metrics.by_snr(predictions.snr_db[known], label, predicted, classes),
    )


def maneuvers_with_background(run: Run, predictions: Predictions, score: Array) -> ManeuverScores:
    """Return precision, recall and F1 over maneuvers, with windows of `following` as the background.

    Every window that the run rejects is predicted as background. score: the run's own open-set score of each
    window, (n,). Source: CaSTFormer, Eq. (13).
    """
    background = len(run.card.classes)
    rows = predictions.known | predictions.unknown
    label = np.where(predictions.known, predictions.label, background)
    rejected = np.zeros(len(label), dtype=bool)
    if run.card.unknown_threshold is not None:
        rejected = score < run.card.unknown_threshold
    predicted = np.where(rejected, background, predictions.predicted)
    return maneuver_scores(metrics.confusion(label[rows], predicted[rows], background + 1), background)


def predict_at_ends(run: Run, records: Records, settings: WindowEndCurveSettings) -> dict[float, Predictions]:
    """Return a run's predictions with every window ending at the same time, by that time in s after onset or commit.

    Only records that hold a window with that end take part; an end that no record holds is left out.
    """
    at_ends = {}
    for end_s in settings.ends_s:
        windows = WindowSettings.model_validate(
            {
                **run.card.settings.windows.model_dump(),
                "relative_to": settings.relative_to,
                "end_after_s": (end_s, end_s),
            }
        )
        first, last = end_bounds(records, windows)
        if (last >= first).any():
            at_ends[end_s] = predict(run, records, draw_ends(records, windows, "sweep"))
    return at_ends


def window_end_scores(run: Run, at_ends: Mapping[float, Predictions]) -> list[WindowEndScores]:
    """Return the points of the window-end curve; at_ends: what `predict_at_ends` returned."""
    score, points = open_set.chosen(run), []
    for end_s, predictions in at_ends.items():
        known, value = predictions.known, score(predictions.outputs)
        summary = metrics.summary(predictions.label[known], predictions.predicted[known], run.card.classes)
        separation = unknown.separation(value[known], value[predictions.unknown])
        points.append(
            WindowEndScores(
                end_s=end_s,
                **summary.model_dump(exclude={"confusion"}),
                auroc_unknown=separation.auroc,
                fpr_at_95_recall=separation.fpr_at_95_recall,
            )
        )
    return points


def calibration(logits: Array, label: IntArray, temperature: float) -> Calibration:
    """Return the expected calibration error with and without the temperature chosen in training.

    logits: (n, G). label: class numbers, (n,). temperature: what logits are divided by.
    """
    return Calibration(
        error=calibration_error(softmax(logits, axis=1), label),
        temperature=temperature,
        error_with_temperature=calibration_error(softmax(logits / temperature, axis=1), label),
    )


def _distinct_names(runs: Sequence[Run]) -> list[str]:
    """Return the runs' names, those of one predictor with the training seed, and numbered where that is the same."""
    names = [run.name for run in runs]
    for suffixes in ([f"seed {run.card.settings.seed}" for run in runs], range(1, len(runs) + 1)):
        count = Counter(names)
        names = [f"{name}, {suffix}" if count[name] > 1 else name for name, suffix in zip(names, suffixes, strict=True)]
    return names
