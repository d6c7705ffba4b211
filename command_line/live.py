"""`evaluate --traffic`: from its arguments to a result on the console."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.console import Console
from rich.table import Table

from command_line import options, output
from command_line.progress import print_line
from isacsim.errors import InputError
from isacsim.parsing import number_range

if TYPE_CHECKING:
    from models.live.results import EventScores, TrafficResult


@dataclass(frozen=True)
class LiveArguments:
    """The arguments of `evaluate` that apply to running traffic; None where not given."""

    seeds: str | None
    development: str | None
    duration: float | None
    jobs: int | None


def source_of(data: Path | None, traffic: str | None, live: LiveArguments) -> Literal["data", "traffic"]:
    """Return what a run is evaluated on. Raises InputError unless it is exactly one of both."""
    if (data is None) == (traffic is None):
        raise InputError("evaluate on a dataset (--data DATASET) or in traffic (--traffic SCENARIO): give one of them")
    if traffic is not None:
        return "traffic"
    for name, value in asdict(live).items():
        if value is not None:
            raise InputError(f"--{name} applies to an evaluation in traffic: give --traffic SCENARIO")
    return "data"


def evaluate_and_show(
    run: Path, scenario: str, arguments: LiveArguments, out: Path | None, against: Sequence[Path], console: Console
) -> dict[str, Any]:
    """Evaluate a run in running traffic, draw its figures and show its scores. Returns what `--json` prints."""
    from labeling.generation.engine import LocalEngine
    from models.live.evaluation import evaluate_traffic, study_of
    from models.report.live_figures import draw_live_figures
    from models.run import load_run

    loaded = load_run(run)
    seeds, development = (
        None if text is None else number_range(text, f"--{name}", int, "1001:1004")
        for name, text in (("seeds", arguments.seeds), ("development", arguments.development))
    )
    study = study_of(loaded.card, scenario, seeds, development, arguments.duration)
    folder = out or run / f"traffic-{Path(scenario).name}"
    evaluation = evaluate_traffic(
        loaded,
        study,
        folder,
        LocalEngine(arguments.jobs or options.cores()),
        output.feedback_of(console),
        [load_run(path) for path in against],
    )
    draw_live_figures(evaluation, folder)
    console.print(table(evaluation.result))
    for line in verdict(evaluation.result):
        print_line(console, line)
    print_line(console, f"figures and metrics.json: {folder}")
    result = evaluation.result.model_dump(mode="json")
    return {"report": str(folder), **result, "real_time_factor": evaluation.real_time_factor}


def table(result: TrafficResult) -> Table:
    """Return the scores by intention for the terminal."""
    title = f"{result.name} in {result.scenario}: {result.vehicle_hours:.2f} vehicle-hours"
    drawn = Table(title=title, title_justify="left")
    drawn.add_column("intention", no_wrap=True)
    for name in ("events", "predicted", "detected", "recall", "precision", "lead s", "false/h"):
        drawn.add_column(name, justify="right")
    for intention, scores in result.by_intention.items():
        drawn.add_row(intention.replace("_", " "), *_cells(scores))
    drawn.add_section()
    drawn.add_row("all", *_cells(result.over_all))
    for baseline in result.baselines.values():
        drawn.add_row(baseline.name, *_cells(baseline.over_all))
    return drawn


def verdict(result: TrafficResult) -> list[str]:
    """Return what the result says, a line each."""
    lines = []
    for point in result.recall_at:
        if point.false_alarms_per_vehicle_hour == 1.0 and point.recall is not None:
            interval = point.recall_interval
            between = f" ({interval.low:.2f} to {interval.high:.2f})" if interval else ""
            lines.append(f"recall at 1 false alarm per vehicle-hour: {point.recall:.2f}{between}")
    if result.coverage.share is not None:
        rest = [f"{name.replace('_', ' ')} {100 * share:.0f} %" for name, share in result.coverage.uncovered.items()]
        lines.append(f"predicted: {100 * result.coverage.share:.0f} % of the driving (not: {', '.join(rest)})")
    lines.append(
        f"world, labels and echoes come from motion that is conditioned {result.latency.conditioning_reach_s:g} s ahead"
    )
    return lines


def _cells(scores: EventScores) -> list[str]:
    """Return a row of the table."""
    numbers = (scores.recall, scores.precision, scores.lead_time_s.median, scores.false_alarms_per_vehicle_hour)
    return [
        *(str(count) for count in (scores.events, scores.predicted, scores.detected)),
        *("-" if number is None else f"{number:.2f}" for number in numbers),
    ]
