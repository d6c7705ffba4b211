"""The report of an evaluation: one HTML page with everything in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console

from isac_cosim.base.arrays import Float32Array
from isac_cosim.base.files import json_text
from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.base.workers.threads import limited
from isac_cosim.evaluation.closed_loop.results import ClosedLoopResult
from isac_cosim.evaluation.in_traffic.scores.results import TrafficResult
from isac_cosim.evaluation.on_windows.evaluation import Evaluation
from isac_cosim.evaluation.on_windows.explained import inspect_windows
from isac_cosim.evaluation.on_windows.predictions import check_rates
from isac_cosim.evaluation.on_windows.results import EvaluationResult
from isac_cosim.evaluation.report import page, terminal
from isac_cosim.evaluation.report.explained_part import FIGURE as EXPLAINED_FIGURE
from isac_cosim.evaluation.report.explained_part import ExplainedRecord, draw_explained
from isac_cosim.evaluation.report.figures import draw_figures
from isac_cosim.evaluation.report.first_screen import confused
from isac_cosim.evaluation.report.parts import Link, Shown
from isac_cosim.evaluation.report.record_view import RecordView, choose_record, draw_record
from isac_cosim.evaluation.report.registry import parts_of
from isac_cosim.evaluation.report.replay.content import Replay
from isac_cosim.evaluation.report.replay.making import replay_of
from isac_cosim.evaluation.report.verdict import seeds_text
from isac_cosim.evaluation.report.window_parts import RECORD_FIGURE
from isac_cosim.labeling.dataset.finding import of_one, shard_of
from isac_cosim.labeling.dataset.record_point import in_plane
from isac_cosim.labeling.intentions import Intention, spoken
from isac_cosim.models.data.windows import Ends, Records, cut, fitting
from isac_cosim.models.predictors.castformer import CastformerSettings
from isac_cosim.models.runs.run import CARD_FILE, Run

if TYPE_CHECKING:
    from isac_cosim.labeling.dataset.dataset import Dataset

END_STEP_S = 0.05
"""Time between the ends of the windows that are predicted in a drawn record, s."""


@limited()
def write_report(evaluation: Evaluation, dataset: Dataset, folder: str | Path) -> Path:
    """Draw all figures of an evaluation into its folder, with that of one record, and write index.html.

    dataset: the one that was measured. Returns the page's path.
    """
    out, evaluated = Path(folder), evaluation.measured[0]
    draw_figures(evaluation, out)
    choice = choose_record(evaluated.predictions)
    sample_ids = dataset.frame(["sample_id"])["sample_id"]
    row = int(np.flatnonzero(sample_ids == choice.sample_id)[0])
    records, truth = Records.of(dataset), dataset.record("tv_truth", row)
    scenario = str(records.table["scenario"].iloc[row])
    view = record_view(evaluated.run, records, truth, row)
    draw_record(view, dataset.roads(scenario), dataset.sites(scenario), out / RECORD_FIGURE)
    if evaluation.result.explained is not None:
        draw_explained(explained_record(evaluated.run, records, row, view), out / EXPLAINED_FIGURE)
    replay = replay_of(dataset, shard_of(dataset, row)[0], LocalEngine(1), evaluated.run).beginning_with(
        choice.sample_id
    )
    cells = confused(evaluated.predictions, evaluation.result)
    return write_page(evaluation.result, out, choice.rule, replay, cells)


def draw_sample(dataset: Dataset, row: int, path: Path, run: Run | None = None) -> None:
    """Draw a sample of a dataset as a PNG, with what a run answers along it if there is one.

    row: in the order of `dataset.frame()`. Raises InputError where the run was trained on other rates.
    """
    shard, within = shard_of(dataset, row)
    alone = of_one(dataset, shard)
    records = Records.of(alone)
    if run is not None:
        check_rates(run, records)
    scenario = shard.episode.scenario
    view = record_view(run, records, alone.record("tv_truth", within), within)
    draw_record(view, dataset.roads(scenario), dataset.sites(scenario), path)


def write_page(
    result: EvaluationResult,
    folder: Path,
    record_rule: str = "",
    replay: Replay | None = None,
    cells: Mapping[tuple[int, int], Sequence[str]] | None = None,
    above: Sequence[Link] = (),
) -> Path:
    """Write index.html from a result and the figures in a folder. The page needs no other file.

    record_rule: sentence for the caption of the record's figure, saying how the record was chosen. replay: of the
    record's episode. cells: ids of the records behind each cell of the confusion matrix.
    above: links to pages that this one belongs to. Returns the page's path.
    """
    shown = Shown(result, folder, {RECORD_FIGURE: record_rule}, result.answers or {}, replay, cells or {})
    origin = json_text(result.made_by.model_dump(mode="json"), 1)
    links = [*page.pages_beside(folder, CARD_FILE), *above]
    return page.write_page(f"{result.name} on unseen traffic", parts_of(shown), origin, folder, links=links)


def show(result: EvaluationResult, folder: Path, console: Console) -> None:
    """Print the scores and what can be said of them. folder: of the page."""
    seeds = "" if result.groups is None else f", {seeds_text(result.groups)}"
    title = f"Windows of seeds that no run was trained or chosen on{seeds}"
    terminal.show(parts_of(Shown(result, folder, answers=result.answers or {})), console, title)


def show_live(result: TrafficResult, folder: Path, console: Console, replay: Replay | None = None) -> Path:
    """Write the page of an evaluation in traffic or of a closed loop, and print its scores. Returns the page's path.

    folder: holds the figures. replay: of its worst moments.
    """
    shown = Shown(result, folder, answers=result.answers or {}, replay=replay)
    parts = parts_of(shown)
    title = f"{result.name} in {result.scenario}: {result.vehicle_hours:.2f} vehicle-hours"
    terminal.show(parts, console, title)
    origin = json_text(result.made_by.model_dump(mode="json"), 1)
    links = page.pages_beside(folder, CARD_FILE)
    what = "Advisories of" if isinstance(result, ClosedLoopResult) else ""
    return page.write_page(f"{what} {result.name} in running traffic".strip(), parts, origin, folder, links=links)


def explained_record(run: Run, records: Records, row: int, view: RecordView) -> ExplainedRecord:
    """Return what the modules of a CaSTFormer do along a record.

    row: of the record. view: of the same record, with the run's predictions.
    """
    assert view.t_end is not None
    return ExplainedRecord(
        title=view.title,
        t_end=view.t_end,
        commit_s=view.commit_s,
        seen=inspect_windows(run, records, _ends_along(run, records, row)),
        frame_s=run.card.settings.of(CastformerSettings).frame_s,
    )


def _ends_along(run: Run, records: Records, row: int) -> Ends:
    """Return the ends of windows along a record, END_STEP_S apart."""
    first, last = fitting(records, run.card.settings.windows)
    steps = np.arange(first, last + 1, max(1, round(END_STEP_S * records.uv_rate_hz)))
    return Ends(np.full(len(steps), row), steps)


def record_view(run: Run | None, records: Records, truth: Float32Array, row: int) -> RecordView:
    """Return what is drawn of one record, with a run's predictions for every window in it if there is a run.

    truth: true states of the TV, as they are stored, (6, S). row: of the record.
    """
    table = records.table.iloc[row]
    onset = float(table["t_onset"] - table["t_start"])
    n_tv, n_uv = records.tv.shape[2], records.uv.shape[2]
    point = records.points[row]
    snr_db = float(table["snr_db"])
    snr_note = f", {snr_db:.1f} dB per site and antenna element" if np.isfinite(snr_db) else ""
    view = RecordView(
        title=f"{spoken(Intention(int(table['label'])).text).capitalize()}: {table['sample_id']}{snr_note}",
        tv=in_plane(records.tv[row], *point),
        truth=in_plane(truth, *point),
        uv=in_plane(records.uv[row], *point),
        t_tv=np.arange(n_tv) / records.tv_rate_hz - onset,
        t_uv=np.arange(n_uv) / records.uv_rate_hz - onset,
        commit_s=float(table["t_commit"] - table["t_onset"]),
    )
    if run is None:
        return view
    ends = _ends_along(run, records, row)
    return replace(
        view,
        classes=run.card.classes,
        t_end=ends.step / records.uv_rate_hz - onset,
        probabilities=run.answer(cut(records, ends, run.card.settings.windows)).probabilities,
    )
