"""What an operator asks, answered by everything that was compared in traffic, and with a budget for each intention."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from isac_cosim.evaluation.in_traffic.scores.results import HeadlineResult, Headlines, TrafficResult
from isac_cosim.evaluation.report.figures import spoken
from isac_cosim.evaluation.report.parts import NO_VALUE, Cell, Part, Row, Shown

RULE = "rule"
SHOWN = {RULE: "rule of the road", "situation": "trees on the situation"}
"""How people call baselines."""


class LiveCompared:
    """The two questions, asked of the run and of everything that it was compared with, in both worlds."""

    result_class = TrafficResult

    def parts(self, shown: Shown) -> list[Part]:
        result: TrafficResult = shown.result
        parts = []
        for world, answers in worlds(result).items():
            if len(answers) > 1:
                title = f"{world}: everything compared, at the rates of false alarms that alarms were chosen for"
                text = "The share of events named in time, and the false alarms per vehicle-hour that were measured."
                parts.append(Part(f"live-compared-{world}", title, text, list(_compared(answers)), folded=True))
            text = (
                "Alarms for one intention alone, chosen for so many false alarms per vehicle-hour of their own: the "
                "share named in time, at how many false alarms; in brackets, 0.5 and 1 s before."
            )
            if budgets := list(_budgets(answers)):
                title = f"{world}: a budget for each intention"
                parts.append(Part(f"live-own-budgets-{world}", title, text, budgets, folded=True, on_terminal=False))
        return parts


def worlds(result: TrafficResult) -> dict[str, dict[str, Headlines]]:
    """Return the answers of the run, which comes first, and of everything compared, by world and predictor."""
    own = Headlines(prediction=result.prediction, recognition=result.recognition)
    world = (result.made_by.study.dataset.world or "former").partition("-")[0]
    found = {world: _named(result.name, own, result.compared)}
    if result.stress is not None:
        own = Headlines(prediction=result.stress.prediction, recognition=result.stress.recognition)
        found["stimulated"] = _named(result.name, own, result.stress.compared)
    return found


def _named(name: str, own: Headlines, compared: Mapping[str, Headlines]) -> dict[str, Headlines]:
    return {name: own} | {SHOWN.get(other, other): answers for other, answers in compared.items()}


def _compared(answers: Mapping[str, Headlines]) -> Iterator[Row]:
    for name, headlines in answers.items():
        row: dict[str, Cell] = {"predictor": name}
        for word, asked in (("predicted", headlines.prediction), ("recognised", headlines.recognition)):
            for point in asked.at if asked is not None else ():
                if point.chosen_for >= 1:
                    measured = at_rate(point.recall, point.false_alarms_per_vehicle_hour)
                    row[f"{word}, {point.chosen_for:g} an hour"] = measured
        yield row


def _budgets(answers: Mapping[str, Headlines]) -> Iterator[Row]:
    for name, headlines in answers.items():
        for asked in (headlines.prediction, headlines.recognition):
            yield from _own_budgets(name, asked)


def _own_budgets(name: str, asked: HeadlineResult | None) -> Iterator[Row]:
    for intention, scores in asked.by_intention.items() if asked is not None else ():
        row: dict[str, Cell] = {"predictor": name, "intention": spoken(intention), "events": scores.events}
        for budget in scores.own_budget:
            leads = ", ".join(_number(share) for share in budget.recall_at_lead.values())
            measured = at_rate(budget.recall, budget.false_alarms_per_vehicle_hour)
            row[f"{budget.chosen_for:g} an hour"] = f"{measured} ({leads})"
        if scores.own_budget:
            yield row


def at_rate(recall: float | None, false_alarms: float | None) -> str:
    """Return a recall with the rate of false alarms at which it was measured."""
    return f"{_number(recall)} at {_number(false_alarms)}"


def _number(value: float | None) -> str:
    return NO_VALUE if value is None else f"{value:.2f}"
