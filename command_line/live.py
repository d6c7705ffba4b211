"""`evaluate --traffic`: from its arguments to a result on the console."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.console import Console
from rich.table import Table

from isac_cosim.base.errors import InputError
from isac_cosim.base.parsing import number_range
from isac_cosim.base.progress import print_line
from isac_cosim.command_line import options, output
from isac_cosim.isacsim.traffic.sources import DEFAULT

if TYPE_CHECKING:
    from isac_cosim.evaluation.closed_loop.results import ClosedLoopResult
    from isac_cosim.evaluation.closed_loop.settings import ClosedLoopSettings
    from isac_cosim.evaluation.in_traffic.scores.results import EventScores, Interval, TrafficResult
    from isac_cosim.evaluation.in_traffic.settings import LiveSettings


@dataclass(frozen=True)
class LiveArguments:
    """The arguments of `evaluate` that apply to running traffic; None where not given."""

    seeds: str | None
    development: str | None
    duration: float | None
    jobs: int | None
    natural: bool | None = None
    advisories: bool | None = None
    conditioning: str | None = None
    false_alarms: float | None = None
    truth: bool | None = None
    alone: Path | None = None
    cluster: str | None = None
    lanes: bool | None = None
    source: str | None = None


def source_of(data: Path | None, traffic: str | None, live: LiveArguments) -> Literal["data", "traffic"]:
    """Return what a run is evaluated on. Raises InputError unless it is exactly one of both."""
    if (data is None) == (traffic is None):
        raise InputError("evaluate on a dataset (--data DATASET) or in traffic (--traffic SCENARIO): give one of them")
    if traffic is not None:
        if live.conditioning is not None and not live.advisories:
            raise InputError("--conditioning applies to a closed loop: give --advisories")
        return "traffic"
    for name, value in asdict(live).items():
        if value:
            raise InputError(f"--{name.replace('_', '-')} applies to an evaluation in traffic: give --traffic SCENARIO")
    return "data"


def evaluate_and_show(
    run: Path, scenario: str, arguments: LiveArguments, out: Path | None, against: Sequence[Path], console: Console
) -> dict[str, Any]:
    """Evaluate a run in running traffic, draw its figures and show its scores. Returns what `--json` prints."""
    from isac_cosim.evaluation.in_traffic.measurement.evaluation import evaluate_traffic, study_of
    from isac_cosim.evaluation.report.live_figures import draw_live_figures
    from isac_cosim.models.runs.run import load_run

    loaded = load_run(run)
    seeds, development = (
        None if text is None else number_range(text, f"--{name}", int, "1001:1004")
        for name, text in (("seeds", arguments.seeds), ("development", arguments.development))
    )
    settings, natural = live_settings(arguments), bool(arguments.natural)
    source = arguments.source or DEFAULT
    study = study_of(loaded.card, scenario, seeds, development, arguments.duration, settings, natural, source)
    folder = out or run / f"traffic-{Path(scenario).name}{'-natural' if arguments.natural else ''}"
    engine, feedback = options.engine_of(arguments.jobs, arguments.cluster), output.feedback_of(console)
    others = [load_run(path) for path in against]
    alone = None if arguments.alone is None else load_run(arguments.alone)
    closed: ClosedLoopResult | None = None
    if arguments.advisories:
        from isac_cosim.evaluation.closed_loop.evaluation import evaluate_advisories
        from isac_cosim.evaluation.report.live_figures import arms

        loop_settings = closed_loop_settings(arguments)
        closed_loop = evaluate_advisories(loaded, study, loop_settings, folder, engine, feedback, others, alone=alone)
        evaluation, closed = closed_loop.open_loop, closed_loop.result
        arms(closed, folder / "arms.png")
    else:
        evaluation = evaluate_traffic(loaded, study, folder, engine, feedback, others, alone=alone)
    draw_live_figures(evaluation, folder)
    console.print(table(evaluation.result))
    for line in verdict(evaluation.result):
        print_line(console, line)
    if closed is not None:
        console.print(arm_table(closed))
        for line in arm_verdict(closed):
            print_line(console, line)
    print_line(console, f"figures and metrics.json: {folder}")
    result = (closed or evaluation.result).model_dump(mode="json")
    return {"report": str(folder), **result, "real_time_factor": evaluation.real_time_factor}


def live_settings(arguments: LiveArguments) -> LiveSettings:
    """Return the settings of watching, alarms and scores. Raises InputError where an argument is wrong."""
    from isac_cosim.base.settings import checked
    from isac_cosim.evaluation.in_traffic.settings import LiveSettings

    rate = arguments.false_alarms
    choice = {} if rate is None else {"false_alarms_per_vehicle_hour": rate}
    content = {
        "choice": choice,
        "streams": {"truth": bool(arguments.truth)},
        "background": {} if arguments.lanes is None else {"lanes": arguments.lanes},
    }
    return checked(LiveSettings, content, "arguments")


def closed_loop_settings(arguments: LiveArguments) -> ClosedLoopSettings:
    """Return the settings of a closed loop. Raises InputError where an argument is wrong."""
    from isac_cosim.base.settings import checked
    from isac_cosim.evaluation.closed_loop.settings import ClosedLoopSettings

    given = {} if arguments.conditioning is None else {"conditioning": arguments.conditioning}
    return checked(ClosedLoopSettings, given, "arguments")


def arm_table(result: ClosedLoopResult) -> Table:
    """Return the arms of a closed loop for the terminal."""
    facts = result.closed_loop
    title = f"closed loop: {facts.scored_vehicle_hours:.2f} vehicle-hours after alarms, {facts.seeds} seeds"
    drawn = Table(title=title, title_justify="left")
    drawn.add_column("arm", no_wrap=True)
    for name in ("alarms", "advisories", "TTC < 3 s", "TTC < 1.5 s", "DRAC > 3.4", "against none", "travel s/km"):
        drawn.add_column(name, justify="right")
    for arm, measured in result.arms.items():
        values = measured.after_alarms
        shown = [_number(values[name]) for name in ("ttc_below_3_s", "ttc_below_1_5_s", "drac_above_3_4_s")]
        relative = measured.difference["ttc_below_1_5_s"].relative
        change = "-" if relative is None else f"{100 * relative:+.0f} %"
        drawn.add_row(
            arm, str(measured.alarms), str(measured.advisories), *shown, change, _number(values["travel_s_per_km"])
        )
    return drawn


def arm_verdict(result: ClosedLoopResult) -> list[str]:
    """Return what the arms say, a line each."""
    latency = result.closed_loop.latency
    low, high = latency.reaction_s
    lines = [
        f"latency: sensing {latency.sensing_s:g} s, network {latency.network_s:g} s, driver {low:g} to {high:g} s; "
        "TTC and DRAC in s per vehicle-hour; `against none` is TTC < 1.5 s"
    ]
    if "isac" in result.arms:
        for name, text, unit in (
            ("ttc_below_1_5_s", "time below 1.5 s of TTC", "s per vehicle-hour"),
            ("travel_s_per_km", "travel time", "s/km"),
        ):
            difference = result.arms["isac"].difference[name]
            if difference.relative is not None and difference.value is not None:
                of_none = difference.relative_interval
                share = f" ({100 * of_none.low:+.0f} to {100 * of_none.high:+.0f} %)" if of_none else ""
                seconds = _between(difference.interval, 2)
                lines.append(
                    f"ISAC against none: {text} {100 * difference.relative:+.1f} %{share}, "
                    f"{difference.value:+.2f}{seconds} {unit}"
                )
        collided = result.arms["isac"].difference_collided
        if collided is not None and collided.value is not None:
            seeds = _between(collided.interval, 1)
            lines.append(f"ISAC against none: {collided.value:+.1f}{seeds} vehicles collide in a seed")
    return lines


def _between(interval: Interval | None, digits: int) -> str:
    return f" ({interval.low:+.{digits}f} to {interval.high:+.{digits}f})" if interval else ""


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


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
    if result.five_classes is not None:
        drawn.add_row("all, overtake and lane change as one", *_cells(result.five_classes.over_all))
    for baseline in result.baselines.values():
        drawn.add_row(baseline.name, *_cells(baseline.over_all))
    if result.alone is not None:
        drawn.add_section()
        drawn.add_row(f"{result.alone.name}, without a UV", *_cells(result.alone.over_all))
    return drawn


def verdict(result: TrafficResult) -> list[str]:
    """Return what the result says, a line each."""
    lines = []
    for point in result.recall_at:
        if point.false_alarms_per_vehicle_hour == 1.0 and point.recall is not None:
            interval = point.recall_interval
            between = f" ({interval.low:.2f} to {interval.high:.2f})" if interval else ""
            lines.append(
                f"recall on the curve, at 1 false alarm per vehicle-hour as measured: {point.recall:.2f}{between}"
            )
    for cost in result.truth.lost if result.truth else ():
        if cost.false_alarms_per_vehicle_hour == 1.0:
            between = f" ({cost.interval.low:+.3f} to {cost.interval.high:+.3f})" if cost.interval else ""
            lines.append(f"true motion would add {cost.lost:+.3f}{between} to that recall")
    if result.coverage.share is not None:
        rest = [f"{name.replace('_', ' ')} {100 * share:.0f} %" for name, share in result.coverage.uncovered.items()]
        lines.append(f"predicted: {100 * result.coverage.share:.0f} % of the driving (not: {', '.join(rest)})")
    if result.alone is not None and result.alone.share is not None:
        lines.append(f"without a UV, {result.alone.name} predicts another {100 * result.alone.share:.0f} %")
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
