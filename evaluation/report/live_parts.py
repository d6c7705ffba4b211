"""What is shown of an evaluation in traffic; `loop_parts` has what is shown of a closed loop."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from statistics import median

from isac_cosim.evaluation.in_traffic.measurement.summary import BASELINE_NAMES
from isac_cosim.evaluation.in_traffic.scores.results import (
    EventScores,
    HeadlineResult,
    Headlines,
    HeadlineScores,
    TrafficResult,
)
from isac_cosim.evaluation.report.html.charts import Chart
from isac_cosim.evaluation.report.parts import (
    NO_VALUE,
    Cell,
    Part,
    Row,
    Shown,
    counted,
    interval_text,
    read_table,
    text_of,
)
from isac_cosim.evaluation.statistics import Interval
from isac_cosim.labeling.intentions import spoken

CAPTIONS = (
    ("recall_against_false_alarms.png", "Recall against false alarms per vehicle-hour; dots are the frozen alarms."),
    ("lead_times.png", "How early alarms come before the commit, by intention: every alarm, median and quartiles."),
    ("time_line.png", "The first measured episode: events as bars, alarms as marks, false ones as crosses."),
)
RATE, RECALL, FROZEN = "false alarms per vehicle-hour", "recall", "frozen"
"""Columns of the curve's table, and its entry for the alarms that were chosen beforehand."""
LEAD = "from the alarm to the commit s"
"""Column of the table of lead times."""
CHARTS = {
    CAPTIONS[0][0]: Chart(
        RATE,
        (RECALL,),
        y_title="recall: share of events predicted by their commit",
        ranges=((0.03, 100.0), (0.0, 1.02)),
        log=True,
        stairs=True,
        single=("alarms", FROZEN),
    )
}
"""Curves that the page draws itself."""
LEAST_FOR_SENTENCE = 20
"""Events, below which a table shows the score and no sentence says it."""


class LiveFirst:
    """What was measured, in a sentence, and the numbers that sum it up."""

    result_class = TrafficResult

    def parts(self, shown: Shown) -> list[Part]:
        result: TrafficResult = shown.result
        text = (
            f"How well a network that senses the vehicles of {result.scenario} knows what their drivers are about to "
            f"do: {result.name}, {result.vehicle_hours:.1f} vehicle-hours with predictions."
        )
        return [Part("live-first", text=text, numbers=_first_numbers(result), on_terminal=False)]


class LiveHeadline:
    """What an operator asks: what is predicted and what is recognised, in natural traffic and under stress."""

    result_class = TrafficResult

    def parts(self, shown: Shown) -> list[Part]:
        result: TrafficResult = shown.result
        asked = [("predicted by the commit", result.prediction), ("recognised by commit + 0.5 s", result.recognition)]
        if result.stress is not None:
            asked += [
                ("stimulated: predicted by the commit", result.stress.prediction),
                ("stimulated: recognised by commit + 0.5 s", result.stress.recognition),
            ]
        answered = [(title, headline) for title, headline in asked if headline is not None]
        lines = [line for title, headline in answered for line in _rate_sentence(title, headline)]
        return [
            *(Part(f"live-headline-{k}", title, rows=_headline(of)) for k, (title, of) in enumerate(answered)),
            Part("live-headline-in-words", lines=lines),
        ]


def _first_numbers(result: TrafficResult) -> list[tuple[str, str]]:
    """Return the scores that sum up an evaluation in traffic, with their names; none that is undefined."""
    numbers = []
    asked = ("predicted by their commit", result.prediction), ("recognised by 0.5 s after it", result.recognition)
    for title, headline in asked:
        if headline is not None and headline.recall is not None:
            interval = headline.recall_interval
            whole = interval is None or (interval.low <= 0 and interval.high >= 1)
            bounds = "" if whole else between(interval, 2, "")
            numbers.append((f"{headline.recall:.2f}{bounds}", f"of {counted(headline.events, 'event')} {title}"))
    if result.prediction is not None and result.prediction.false_alarms_per_vehicle_hour is not None:
        rate = result.prediction.false_alarms_per_vehicle_hour
        bounds = between(result.prediction.false_alarms_interval, 2, "")
        numbers.append((f"{rate:.2f}{bounds}", "false alarms per vehicle-hour, of those that predict"))
    return numbers


def _headline(asked: HeadlineResult) -> list[Row]:
    all_of_them = HeadlineScores(
        events=asked.events,
        recall=asked.recall,
        lead_s=asked.lead_s,
        false_alarms_per_vehicle_hour=asked.false_alarms_per_vehicle_hour,
    )
    return [
        {
            "five intentions": spoken(name),
            "events": scores.events,
            "recall": number(scores.recall),
            "lead s": number(scores.lead_s),
            "false/h": number(scores.false_alarms_per_vehicle_hour),
        }
        for name, scores in [*asked.by_intention.items(), ("all of these", all_of_them)]
    ]


def _rate_sentence(title: str, asked: HeadlineResult) -> list[str]:
    """Return what the alarms were chosen for, and what came of it; nothing on too few events."""
    if asked.events < LEAST_FOR_SENTENCE or asked.recall is None or asked.false_alarms_per_vehicle_hour is None:
        return []
    kept = "" if asked.keeps_to_rate else ", beyond a factor of 1.5"
    leads = ", ".join(f"{number(share)} by {lead} s before" for lead, share in asked.recall_at_lead.items())
    return [
        f"{title}: {asked.recall:.2f} of {asked.events} events ({leads}) at {asked.false_alarms_per_vehicle_hour:.2f} "
        f"false alarms per vehicle-hour, chosen for {asked.chosen_for:g}{kept}; {asked.near_misses.alarms} alarms for "
        "near misses are neutral"
    ]


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
    return {name: own} | {BASELINE_NAMES.get(other, other): answers for other, answers in compared.items()}


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
            leads = ", ".join(number(share) for share in budget.recall_at_lead.values())
            measured = at_rate(budget.recall, budget.false_alarms_per_vehicle_hour)
            row[f"{budget.chosen_for:g} an hour"] = f"{measured} ({leads})"
        if scores.own_budget:
            yield row


def at_rate(recall: float | None, false_alarms: float | None) -> str:
    """Return a recall with the rate of false alarms at which it was measured."""
    return f"{number(recall)} at {number(false_alarms)}"


class AlarmsByIntention:
    """The scores of the chosen alarms by intention, then those of the baselines."""

    result_class = TrafficResult

    def parts(self, shown: Shown) -> list[Part]:
        result: TrafficResult = shown.result
        title = f"{result.name} in {result.scenario}: {result.vehicle_hours:.2f} vehicle-hours"
        over_all = [("all", result.over_all)]
        if result.five_classes is not None:
            over_all.append(("all, overtake and lane change as one", result.five_classes.over_all))
        over_all += [(baseline.name, baseline.over_all) for baseline in result.baselines.values()]
        parts = [
            Part("headline", text=title, on_terminal=False),
            Part("by-intention", rows=_rows((spoken(name), scores) for name, scores in result.by_intention.items())),
            Part("over-all", rows=_rows(over_all), strong=(0,)),
        ]
        if result.alone is not None:
            parts.append(Part("alone", rows=_rows([(f"{result.alone.name}, without a UV", result.alone.over_all)])))
        return parts


class InWords:
    """What the result says in sentences."""

    result_class = TrafficResult

    def parts(self, shown: Shown) -> list[Part]:
        return [Part("in-words", lines=_sentences(shown.result))]


class LiveFigures:
    """The figures that the folder holds."""

    result_class = TrafficResult

    def parts(self, shown: Shown) -> list[Part]:
        rows = {name: read_table((shown.folder / name).with_suffix(".csv")) for name, _ in CAPTIONS}
        said = zip(CAPTIONS, (_seen_curve, _seen_leads, _seen_line), strict=True)
        seen = {name: sentence(rows[name]) for (name, _), sentence in said if rows[name]}
        return [Part("live-figures", figures=CAPTIONS, seen=seen, figure_rows=rows, charts=CHARTS, on_terminal=False)]


def _seen_curve(rows: Sequence[Row]) -> str:
    """Return what there is to be seen in the curve: where each predictor's frozen alarms lie."""
    frozen = [row for row in rows if row.get("alarms") == FROZEN]
    said = "; ".join(f"{row['predictor']}: {text_of(row[RECALL])} at {text_of(row[RATE])}" for row in frozen)
    return f"Recall rises with the false alarms per vehicle-hour. Recall of the frozen alarms: {said or 'none'}."


def _seen_leads(rows: Sequence[Row]) -> str:
    """Return what there is to be seen in the lead times: the median of each intention."""
    leads: dict[str, list[float]] = {}
    for row in rows:
        if isinstance(lead := row.get(LEAD), float):
            leads.setdefault(str(row.get("intention")), []).append(lead)
    said = "; ".join(f"{name}: {counted(len(of), 'alarm')}, median {median(of):.2f} s" for name, of in leads.items())
    return f"Time from the alarm to the commit, a row for each intention. {said or 'No alarm was right'}."


def _seen_line(rows: Sequence[Row]) -> str:
    """Return what there is to be seen in the time line: how many events and alarms."""
    kinds = [row.get("what") for row in rows]
    events, right, false = (kinds.count(kind) for kind in ("event", "alarm", "false alarm"))
    return f"{counted(events, 'event')}, {counted(right, 'right or neutral alarm')}, {counted(false, 'false alarm')}."


def between(interval: Interval | None, digits: int, sign: str = "+") -> str:
    """Return an interval to be put after its number; nothing without one. sign: of its bounds, "" or "+"."""
    return interval_text(interval.low, interval.high, digits, sign) if interval else ""


def number(value: float | None) -> str:
    """Return a score as people read it."""
    return NO_VALUE if value is None else f"{value:.2f}"


def _sentences(result: TrafficResult) -> list[str]:
    """Return what the result says, a line each."""
    lines = []
    enough = result.over_all.events >= LEAST_FOR_SENTENCE
    for point in result.recall_at if enough else ():
        if point.false_alarms_per_vehicle_hour == 1.0 and point.recall is not None:
            bounds = between(point.recall_interval, 2, "")
            lines.append(
                f"recall on the curve, at 1 false alarm per vehicle-hour as measured: {point.recall:.2f}{bounds}"
            )
    for cost in result.truth.lost if result.truth and enough else ():
        if cost.false_alarms_per_vehicle_hour == 1.0:
            bounds = between(cost.interval, 3)
            lines.append(f"true motion would add {cost.lost:+.3f}{bounds} to that recall")
    if result.near_miss_alarms:
        lines.append(f"neutral: {result.near_miss_alarms} alarms for motion just under a threshold")
    if result.coverage.share is not None:
        rest = [f"{name.replace('_', ' ')} {100 * share:.0f} %" for name, share in result.coverage.uncovered.items()]
        lines.append(f"predicted: {100 * result.coverage.share:.0f} % of the driving (not: {', '.join(rest)})")
    if result.alone is not None and result.alone.share is not None:
        lines.append(f"without a UV, {result.alone.name} predicts another {100 * result.alone.share:.0f} %")
    lines.append(
        f"world, labels and echoes come from motion that is conditioned {result.latency.conditioning_reach_s:g} s ahead"
    )
    return lines


def _rows(scores: Iterable[tuple[str, EventScores]]) -> list[Row]:
    return [
        {
            "intention": name,
            "events": of.events,
            "predicted": of.predicted,
            "detected": of.detected,
            "recall": number(of.recall),
            "precision": number(of.precision),
            "lead s": number(of.lead_time_s.median),
            "false/h": number(of.false_alarms_per_vehicle_hour),
        }
        for name, of in scores
    ]
