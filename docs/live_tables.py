"""The tables of docs/live.md and docs/live/tables.md, from what `cosim evaluate RUN --traffic SCENARIO` measured.

    python docs/live_tables.py FOLDER/metrics.json

Prints them in Markdown. Intervals in brackets are 95 % intervals over the measured seeds. Of an evaluation with
`--advisories`, these are the arms of the closed loop; of one with `--natural`, the tables that differ most.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from isac_cosim.base.errors import InputError
from isac_cosim.evaluation.closed_loop.results import ArmDifference, ClosedLoopResult
from isac_cosim.evaluation.in_traffic.scores.results import (
    AlarmResult,
    AloneResult,
    EventScores,
    LeadTimes,
    RecallLost,
    TrafficResult,
)
from isac_cosim.evaluation.in_traffic.settings import Sharing
from isac_cosim.evaluation.report.figures import spoken
from isac_cosim.evaluation.report.parts import markdown
from isac_cosim.evaluation.statistics import Interval

RATES = (1.0, 3.0, 10.0)
"""False alarms per vehicle-hour at which alarms are compared."""
METHODS = {"reject": "unknown score", "background": "answer “none”", "hazard": "its log-odds"}
TRUE_MOTION = "true motion"
BASELINES = {"rule": "rule of the road", "situation": "trees on the situation"}
SAFETY = {
    "ttc_below_3_s": ("TTC < 3 s", 1),
    "ttc_below_1_5_s": ("TTC < 1.5 s", 2),
    "drac_above_3_4_s": ("DRAC > 3.4 m/s²", 2),
    "travel_s_per_km": ("travel time, s/km", 2),
}
"""Figures of the closed loop, with the digits that are shown."""


def read_result(path: Path) -> TrafficResult:
    """Read a `metrics.json`, of an open or a closed loop. Raises InputError if it is not there."""
    if not path.is_file():
        raise InputError(f"{path}: not there; name the metrics.json of an evaluation in traffic")
    content = json.loads(path.read_bytes())
    return (ClosedLoopResult if "arms" in content else TrafficResult).model_validate(content)


def tables(result: TrafficResult) -> Iterator[str]:
    """Yield each table with its heading."""
    where, predictors = result.scenario, compared(result)
    if isinstance(result, ClosedLoopResult):
        yield _arms(f"Arms of the closed loop, {where}", result)
        yield _against_none(f"Arms against none, {where}", result)
        return
    if left_alone := result.made_by.study.dataset.maneuvers.quiet:
        where += " left alone"
    yield _recalls(f"Recall at rates of false alarms, {where}", predictors, "separate")
    yield _by_intention(f"Recall by intention, {where}", list(result.by_intention), predictors)
    if not left_alone:
        sensed = {name: alarms for name, alarms in predictors.items() if TRUE_MOTION not in name}
        yield _recalls(f"One threshold for all intentions, {where}", sensed, "shared")
    if result.five_classes is not None:
        five = {_named(result): result.five_classes, **_baselines(result.five_classes.baselines)}
        yield _recalls(f"Overtakes as lane changes, {where}", five, "separate")
    if result.truth is not None:
        yield _sensing_costs(f"What sensing costs, {where}", result.truth.lost)
    yield _leads(f"Lead times of the frozen alarms, {where}", {"all": result.over_all, **result.by_intention})
    if left_alone:
        return
    yield _origins(f"Events by origin, {where}", result)
    yield _driving(f"Driving time, {where}", result)
    if result.alone is not None:
        yield _recalls(f"Driving without a UV, {where}", _alone(result.alone), "separate")


def compared(result: TrafficResult) -> dict[str, AlarmResult]:
    """Return what is compared: both kinds of alarm of the run, the baselines, and the run on true motion."""
    name = _named(result)
    of_run = {f"{name}, {METHODS[method]}": alarms for method, alarms in result.methods.items()}
    truth = result.truth.methods if result.truth is not None else {}
    of_truth = {f"{name}, {TRUE_MOTION}, {METHODS[method]}": alarms for method, alarms in truth.items()}
    return {**of_run, **_baselines(result.baselines), **of_truth}


def _named(result: TrafficResult) -> str:
    return result.made_by.run.settings.predictor_class.display_name


def _alone(alone: AloneResult) -> dict[str, AlarmResult]:
    """Return what is compared where a vehicle has no UV."""
    name = alone.run.settings.predictor_class.display_name
    of_run = {f"{name}, {METHODS[method]}": alarms for method, alarms in alone.methods.items()}
    return {**of_run, **_baselines(alone.baselines)}


def _baselines(baselines: Mapping[str, AlarmResult]) -> dict[str, AlarmResult]:
    return {BASELINES.get(name, name): alarms for name, alarms in baselines.items() if alarms.frozen_at}


def _recalls(title: str, predictors: Mapping[str, AlarmResult], way: Sharing) -> str:
    """Return the recall of alarms that were chosen for each of the rates. way: of choosing thresholds."""
    head = ("predictor", "chosen for", "false alarms", "recall", "late too", "median lead, s")
    rows = [
        (
            name,
            f"{point.false_alarms_per_vehicle_hour:g}",
            _number(point.measured, 1),
            _number(point.recall, 3) + _in(point.recall_interval),
            _number(point.recall_with_detection, 2),
            _number(point.median_lead_s, 1),
        )
        for name, alarms in predictors.items()
        for point in alarms.frozen_at.get(way, ())
        if point.false_alarms_per_vehicle_hour in RATES
    ]
    return _part(title, head, rows)


def _by_intention(title: str, intentions: Sequence[str], predictors: Mapping[str, AlarmResult]) -> str:
    """Return the recall of each intention, with a threshold for each."""
    head = ("predictor", "chosen for", *map(spoken, intentions))
    rows = [
        (
            name,
            f"{point.false_alarms_per_vehicle_hour:g}",
            *(_number(point.by_intention.get(intention), 2) for intention in intentions),
        )
        for name, alarms in predictors.items()
        for point in alarms.frozen_at.get("separate", ())
        if point.false_alarms_per_vehicle_hour in (RATES[0], RATES[-1])
    ]
    return _part(title, head, rows)


def _sensing_costs(title: str, lost: Sequence[RecallLost]) -> str:
    rows = [
        (
            f"{row.false_alarms_per_vehicle_hour:g}",
            f"{row.truth:.3f}",
            f"{row.sensed:.3f}",
            f"{row.lost:+.3f}{_in(row.interval, '+')}",
        )
        for row in lost
    ]
    return _part(title, ("false alarms", "recall on true motion", "as sensed", "lost"), rows)


def _leads(title: str, scores_by_name: Mapping[str, EventScores]) -> str:
    head = (
        "intention", "events", "predicted", "late", "false alarms", "alarm to commit, s", "alarm to onset, s", "commit",
    )  # fmt: skip
    rows = [
        (
            spoken(name),
            *map(str, (scores.events, scores.predicted, scores.detected, scores.false_alarms)),
            _quartiles(scores.lead_time_s),
            _quartiles(scores.lead_to_onset_s),
            scores.commit_is or "",
        )
        for name, scores in scores_by_name.items()
    ]
    return _part(title, head, rows)


def _origins(title: str, result: AlarmResult) -> str:
    groups = {"natural": result.natural, "reaction": result.reaction, "commanded": result.commanded}
    rows = [
        (
            name,
            f"{scores.events}",
            _number(scores.recall, 3) + _in(scores.recall_interval),
            f"{scores.false_alarms}",
            f"{scores.vehicle_hours:.1f}",
        )
        for name, scores in ((name, group.over_all) for name, group in groups.items())
    ]
    return _part(title, ("origin", "events", "recall", "false alarms", "vehicle-hours"), rows)


def _driving(title: str, result: TrafficResult) -> str:
    coverage = result.coverage
    shares = {"predicted": coverage.share or 0.0, **coverage.uncovered}
    if result.alone is not None:
        shares["of the rest, predicted from the TV alone"] = result.alone.share or 0.0
    rows = [(spoken(name), f"{100.0 * share:.1f} %") for name, share in shares.items()]
    return _part(title, (f"of {coverage.driving_hours:.1f} hours", "share"), rows)


def _arms(title: str, result: ClosedLoopResult) -> str:
    """Return what each arm did, and what the vehicles near an alarm went through."""
    head = ("arm", "alarms", "advisories", *(name for name, _ in SAFETY.values()), "collided")
    rows = [
        (
            arm,
            f"{measured.alarms}",
            f"{measured.advisories}",
            *(_number(measured.after_alarms[key], digits) for key, (_, digits) in SAFETY.items()),
            f"{measured.collided}",
        )
        for arm, measured in result.arms.items()
    ]
    return _part(title, head, rows)


def _against_none(title: str, result: ClosedLoopResult) -> str:
    """Return by how much the figures of each arm with advisories differ from those without, in percent.

    Time below 1.5 s of TTC also in seconds per vehicle-hour: where one seed has most of it, the share says little.
    """
    names = [name for name, _ in SAFETY.values()]
    head = ("arm", *names, "TTC < 1.5 s, all traffic", "TTC < 1.5 s, s", "collided, in a seed")
    rows = [
        (
            arm,
            *(_percent(measured.difference[key]) for key in SAFETY),
            _percent(measured.difference_all_traffic["ttc_below_1_5_s"]),
            _plain(measured.difference["ttc_below_1_5_s"]),
            _plain(measured.difference_collided),
        )
        for arm, measured in result.arms.items()
        if measured.advisories
    ]
    return _part(title, head, rows)


def _percent(difference: ArmDifference) -> str:
    return _change(difference.relative, difference.relative_interval, 100.0, " %")


def _plain(difference: ArmDifference | None) -> str:
    return "" if difference is None else _change(difference.value, difference.interval)


def _change(value: float | None, interval: Interval | None, scale: float = 1.0, unit: str = "") -> str:
    if value is None:
        return ""
    between = "" if interval is None else f" ({scale * interval.low:+.1f} to {scale * interval.high:+.1f}{unit})"
    return f"{scale * value:+.1f}{unit}{between}"


def _quartiles(times: LeadTimes) -> str:
    if times.median is None:
        return ""
    return f"{times.median:.1f} ({times.lower_quartile:.1f} to {times.upper_quartile:.1f})"


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _in(interval: Interval | None, sign: str = "") -> str:
    return "" if interval is None else f" ({interval.low:{sign}.3f} to {interval.high:{sign}.3f})"


def _part(title: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return f"### {title}\n\n{markdown(head, rows)}\n"


def main() -> None:
    """Print the tables of the result that the command line names."""
    for part in tables(read_result(Path(sys.argv[1]))):
        print(part)


if __name__ == "__main__":
    main()
