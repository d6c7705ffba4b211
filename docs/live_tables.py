"""The tables of measured traffic in the documents, from what `cosim evaluate RUN --traffic SCENARIO` wrote.

    python docs/live_tables.py [--apart] METRICS.json [FURTHER.json ...]

Prints them in Markdown. Predictors of further evaluations of the same traffic, where they are there, stand beside that
of the first. Of several trainings of one predictor, a cell is their mean, with the standard deviation, and the 95 %
interval over the measured seeds is that of the first. With `--apart`, each run has a row of its own, with the name of
its folder, and there are the first tables alone. Of an evaluation with `--advisories`, the tables are the arms of the
closed loop.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from isac_cosim.base.errors import InputError
from isac_cosim.evaluation.closed_loop.results import ArmDifference, ClosedLoopResult
from isac_cosim.evaluation.in_traffic.measurement.headline import OWN_RATES
from isac_cosim.evaluation.in_traffic.measurement.summary import BASELINE_NAMES
from isac_cosim.evaluation.in_traffic.scores.results import (
    AlarmResult,
    EventScores,
    HeadlineResult,
    Headlines,
    HeadlineScores,
    LeadTimes,
    RecallLost,
    TrafficResult,
)
from isac_cosim.evaluation.report.parts import NO_VALUE, markdown
from isac_cosim.evaluation.statistics import Interval
from isac_cosim.labeling.intentions import spoken

RATES = (1.0, 3.0, 10.0)
"""False alarms per vehicle-hour at which alarms are compared."""
BUDGETS = ("predictor", "intention", "events", *(f"{rate:g} an hour" for rate in OWN_RATES))
RANDOM = "random"
Of = TypeVar("Of")
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


def tables(result: TrafficResult, further: Sequence[TrafficResult] = (), apart: bool = False) -> Iterator[str]:
    """Yield each table with its heading.

    further: of the same traffic, whose predictors are compared. apart: whether each run has a row of its own, in the
    first tables alone.
    """
    if isinstance(result, ClosedLoopResult):
        yield _arms(f"Arms of the closed loop, {result.scenario}", result)
        yield _against_none(f"Arms against none, {result.scenario}", result)
        return
    world = (result.made_by.study.dataset.world or "former").partition("-")[0]
    where = f"{result.scenario}, {world}"
    if result.made_by.study.dataset.sensing.scene is not None:
        where += ", a scene"
    asked_by = {of.name: asked_of(of) for of in further}
    asked = beside(asked_of(result), result.compared, asked_by, result.name, apart)
    if apart:
        where += ", run by run"
    yield _recalls(f"All maneuvers, {where}", of_five(result, further, apart))
    if apart:
        yield _asked(f"What an operator asks, {where}", asked)
        return
    yield _recalls(f"Six intentions, {where}", beside(result, result.baselines, {of.name: of for of in further}))
    yield _asked(f"What an operator asks, {where}", asked)
    if budgets := list(_budgets(asked)):
        yield _part(f"A budget for each intention, {where}", BUDGETS, budgets)
    if result.truth is not None:
        yield _sensing_costs(f"What sensing costs, {where}", result.truth.lost)
    yield _leads(f"Lead times of the frozen alarms, {where}", {"all": result.over_all, **result.by_intention})
    if world != "natural":
        yield _origins(f"Events by origin, {where}", result)
    yield _driving(f"Driving time, {where}", result)


def of_five(
    result: TrafficResult, further: Sequence[TrafficResult] = (), apart: bool = False
) -> dict[str, list[AlarmResult]]:
    """Return the scores with five intentions, by predictor and training."""
    assert result.five_classes is not None
    others = {of.name: of.five_classes for of in further if of.five_classes is not None}
    return beside(result.five_classes, result.five_classes.baselines, others, apart=apart)


def asked_of(result: TrafficResult) -> Headlines:
    """Return what an operator asks of the run itself."""
    return Headlines(prediction=result.prediction, recognition=result.recognition)


def beside(
    own: Of, compared: Mapping[str, Of], further: Mapping[str, Of], name: str = "", apart: bool = False
) -> dict[str, list[Of]]:
    """Return a run's scores and those that it is compared with by the names of predictors, with all trainings of one.

    name: of the run; `own.name` if empty. apart: whether trainings of one predictor stay apart. Random alarms are left
    out.
    """
    shown = {name or own.name: own, **compared, **further}  # type: ignore[attr-defined]
    found: dict[str, list[Of]] = {}
    for predictor, scores in shown.items():
        if predictor != RANDOM:
            shown_name = BASELINE_NAMES.get(predictor, predictor)
            found.setdefault(shown_name if apart else shown_name.partition(", ")[0], []).append(scores)
    return found


def _recalls(title: str, predictors: Mapping[str, list[AlarmResult]]) -> str:
    """Return the recall of alarms that were chosen for each of the rates, with a threshold for each intention."""
    rows = []
    for name, trainings in predictors.items():
        points = [
            {point.false_alarms_per_vehicle_hour: point for point in alarms.frozen_at.get("separate", ())}
            for alarms in trainings
        ]
        cells = []
        for rate in RATES:
            at_rate = [of_training[rate] for of_training in points if rate in of_training]
            recall = _mean([point.recall for point in at_rate])
            interval = _in(at_rate[0].recall_interval) if at_rate else ""
            cells.append(f"{recall}{interval} at {_mean([point.measured for point in at_rate], 1, spread=False)}")
        rows.append((name, str(len(trainings)), *cells))
    return _part(title, ("predictor", "trainings", *(f"chosen for {rate:g}" for rate in RATES)), rows)


def _asked(title: str, predictors: Mapping[str, list[Headlines]]) -> str:
    """Return the two questions: recall for each rate, and how early, of alarms that were chosen for 1."""
    rows = []
    for name, trainings in predictors.items():
        for word, answers in _questions(trainings).items():
            points = [{point.chosen_for: point for point in answer.at} for answer in answers]
            cells = [
                f"{_mean([of[rate].recall for of in points if rate in of])} at "
                f"{_mean([of[rate].false_alarms_per_vehicle_hour for of in points if rate in of], 1, spread=False)}"
                for rate in RATES
            ]
            early = [_mean([answer.recall_at_lead.get(lead) for answer in answers]) for lead in ("0.5", "1")]
            lead = _mean([answer.lead_s for answer in answers], 1, spread=False)
            rows.append((name, word, str(answers[0].events), *cells, *early, lead))
    head = (
        "predictor",
        "",
        "events",
        *(f"chosen for {rate:g}" for rate in RATES),
        "0.5 s before",
        "1 s before",
        "lead, s",
    )
    return _part(title, head, rows)


def _questions(trainings: Sequence[Headlines]) -> dict[str, list[HeadlineResult]]:
    asked = {
        "predicted": [headlines.prediction for headlines in trainings],
        "recognised": [headlines.recognition for headlines in trainings],
    }
    answered = {word: [answer for answer in answers if answer is not None] for word, answers in asked.items()}
    return {word: answers for word, answers in answered.items() if answers}


def _budgets(predictors: Mapping[str, list[Headlines]]) -> Iterator[tuple[str, ...]]:
    """Yield the recall of alarms for a single intention, chosen for rates of its own; a row each."""
    for name, trainings in predictors.items():
        for answers in _questions(trainings).values():
            for intention in answers[0].by_intention:
                scores = [answer.by_intention[intention] for answer in answers]
                if scores[0].own_budget and scores[0].events:
                    yield name, spoken(intention), str(scores[0].events), *_own(scores)


def _own(trainings: Sequence[HeadlineScores]) -> Iterator[str]:
    for budgets in zip(*(scores.own_budget for scores in trainings), strict=True):
        recall = _mean([budget.recall for budget in budgets])
        rate = _mean([budget.false_alarms_per_vehicle_hour for budget in budgets], 1, spread=False)
        second = _mean([budget.recall_at_lead.get("1") for budget in budgets], spread=False)
        yield f"{recall} at {rate}; {second} by 1 s before"


def _mean(values: Sequence[float | None], digits: int = 2, spread: bool = True) -> str:
    """Return the mean of trainings, with the standard deviation where there are several."""
    known = np.array([value for value in values if value is not None])
    if not len(known):
        return ""
    deviation = f" ± {known.std(ddof=1):.{digits}f}" if spread and len(known) > 1 else ""
    return f"{known.mean():.{digits}f}{deviation}"


def _sensing_costs(title: str, lost: Sequence[RecallLost]) -> str:
    rows = [
        (
            f"{row.false_alarms_per_vehicle_hour:g}",
            f"{row.truth:.3f}",
            f"{row.sensed:.3f}",
            f"{row.lost:+.3f}{_in(row.interval, '+.3f')}",
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
            _number(scores.recall, 2) + _in(scores.recall_interval),
            f"{scores.false_alarms}",
            f"{scores.vehicle_hours:.1f}",
        )
        for name, scores in ((name, group.over_all) for name, group in groups.items())
    ]
    return _part(title, ("origin", "events", "recall", "false alarms", "vehicle-hours"), rows)


def _driving(title: str, result: TrafficResult) -> str:
    coverage = result.coverage
    shares = {"predicted": coverage.share or 0.0, **coverage.uncovered}
    rows = [(spoken(name), f"{100.0 * share:.1f} %") for name, share in shares.items()]
    return _part(title, (f"of {coverage.driving_hours:.1f} hours", "share"), rows)


def _arms(title: str, result: ClosedLoopResult) -> str:
    """Return what each arm did, and what the vehicles near an alarm went through."""
    head = ("arm", "alarms", "advisories", *(name for name, _ in SAFETY.values()), "collided", "of these advised")
    rows = [
        (
            arm,
            f"{measured.alarms}",
            f"{measured.advisories}",
            *(_number(measured.after_alarms[key], digits) for key, (_, digits) in SAFETY.items()),
            f"{measured.collided}",
            NO_VALUE if measured.collided_advised is None else f"{measured.collided_advised}",
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


def _in(interval: Interval | None, shown: str = ".2f") -> str:
    return "" if interval is None else f" ({interval.low:{shown}} to {interval.high:{shown}})"


def _part(title: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return f"### {title}\n\n{markdown(head, rows)}\n"


def main() -> None:
    """Print the tables of the results that the command line names."""
    apart, names = "--apart" in sys.argv, [argument for argument in sys.argv[1:] if argument != "--apart"]
    first, *further = map(Path, names)
    for part in tables(read_result(first), [read_result(path) for path in further if path.is_file()], apart):
        print(part)


if __name__ == "__main__":
    main()
