"""The figures of an evaluation in traffic, as PNG files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.closed_loop.results import ClosedLoopResult
from isac_cosim.evaluation.closed_loop.scoring import REFERENCE
from isac_cosim.evaluation.in_traffic.measurement.measuring import MeasuredAlarms
from isac_cosim.evaluation.in_traffic.measurement.summary import TrafficEvaluation
from isac_cosim.evaluation.in_traffic.scores.scoring import AlarmOutcome
from isac_cosim.evaluation.report.figures import BESIDE, BLUE, BY_PREDICTOR, CYCLE, GREY, figure
from isac_cosim.evaluation.report.live_parts import FROZEN, LEAD, RATE, RECALL
from isac_cosim.evaluation.report.parts import Row, write_table
from isac_cosim.evaluation.statistics import Interval
from isac_cosim.labeling.intentions import KNOWN, spoken

METHODS = {"reject": "unknown score", "background": 'with the answer "none"', "hazard": "log-odds"}
"""How figures name the kinds of alarm, where a predictor has several."""
MOST_VEHICLES = 24
"""Vehicles of a time line: those with the most events and alarms."""


def draw_live_figures(evaluation: TrafficEvaluation, folder: Path) -> None:
    """Draw the figures of an evaluation in traffic into a folder."""
    several = len(evaluation.methods) > 1
    shown = {METHODS[name] if several else evaluation.result.name: of for name, of in evaluation.methods.items()}
    if evaluation.true_motion is not None:
        shown["on true motion"] = evaluation.true_motion
    shown |= {measured.result.name: measured for measured in evaluation.baselines.values()}
    recall_against_false_alarms(shown, folder / "recall_against_false_alarms.png")
    write_table([*_recall_rows(shown)], folder / "recall_against_false_alarms.csv")
    first = next(iter(evaluation.methods.values()), None)
    if first is not None and any(outcome.alarmed.any() for outcome in first.outcomes):
        lead_times(first.outcomes, folder / "lead_times.png")
        write_table([*_lead_rows(first.outcomes)], folder / "lead_times.csv")
    if first is not None and evaluation.truths:
        time_line(evaluation, first, folder / "time_line.png")
        write_table([*_time_rows(evaluation, first)], folder / "time_line.csv")


def recall_against_false_alarms(shown: Mapping[str, MeasuredAlarms], path: Path) -> None:
    """Draw recall against false alarms an hour, a curve for each predictor, a dot where its frozen alarms lie."""
    with figure(path, 8, 4.4) as drawn:
        axes = drawn.subplots()
        axes.set_prop_cycle(BY_PREDICTOR)
        for name, measured in shown.items():
            scores = measured.result.over_all
            if measured.sweep is not None and len(measured.sweep.thresholds):
                rate, recall = _staircase(measured.sweep.rates(), measured.sweep.recalls())
                (line,) = axes.plot(rate, recall, drawstyle="steps-post", label=name)
                colour = line.get_color()
            else:
                colour = GREY
                axes.plot([], [], "o", color=colour, label=name)
            if scores.false_alarms_per_vehicle_hour and scores.recall is not None:
                axes.plot(scores.false_alarms_per_vehicle_hour, scores.recall, "o", color=colour, mec="white", ms=8)
        axes.set(xscale="log", xlim=(0.03, 100), ylim=(0, 1.02))
        axes.set(xlabel=RATE, ylabel=f"{RECALL}: share of events predicted by their commit")
        axes.set_title("Recall against false alarms; dots: frozen alarms")
        axes.legend(**BESIDE)


def _recall_rows(shown: Mapping[str, MeasuredAlarms]) -> Iterator[Row]:
    """Yield the corners of each predictor's curve, and where its frozen alarms lie."""
    for name, measured in shown.items():
        if measured.sweep is not None and len(measured.sweep.thresholds):
            rate, recall = _staircase(measured.sweep.rates(), measured.sweep.recalls())
            corner = np.diff(recall, prepend=-1.0) > 0
            corner[-1] = True
            for at, share in zip(rate[corner].tolist(), recall[corner].tolist(), strict=True):
                yield {"predictor": name, "alarms": "any", RATE: at, RECALL: share}
        scores = measured.result.over_all
        if scores.false_alarms_per_vehicle_hour is not None and scores.recall is not None:
            frozen = {RATE: scores.false_alarms_per_vehicle_hour, RECALL: scores.recall}
            yield {"predictor": name, "alarms": FROZEN, **frozen}


def _lead_rows(outcomes: Sequence[AlarmOutcome]) -> Iterator[Row]:
    for row, intention in enumerate(KNOWN):
        for outcome in outcomes:
            for lead in outcome.of(row).to_commit.tolist():
                if np.isfinite(lead):
                    yield {"intention": spoken(intention.text), LEAD: lead}


def _staircase(rates: Array, recalls: Array) -> tuple[Array, Array]:
    """Return the highest recall at no more than each rate."""
    order = np.argsort(rates, kind="stable")
    return rates[order], np.maximum.accumulate(recalls[order])


def lead_times(outcomes: Sequence[AlarmOutcome], path: Path) -> None:
    """Draw the distribution of lead times to the commit, an intention a row: every alarm, median and quartiles."""
    with figure(path, 8, 4.2) as drawn:
        axes = drawn.subplots()
        for row in range(len(KNOWN)):
            leads = np.concatenate([outcome.of(row).to_commit for outcome in outcomes])
            kept = leads[np.isfinite(leads)]
            if not len(kept):
                continue
            scatter = np.linspace(-0.25, 0.25, len(kept))
            axes.plot(kept, row + scatter, ".", color=CYCLE[row], alpha=0.45, ms=5)
            low, middle, high = np.quantile(kept, [0.25, 0.5, 0.75])
            axes.plot([low, high], [row, row], color="black", lw=2)
            axes.plot(middle, row, "D", color="black", ms=5)
        axes.axvline(0, color=GREY, lw=1, ls="--")
        axes.set_yticks(range(len(KNOWN)), [spoken(intention.text) for intention in KNOWN])
        axes.set(xlabel="from the alarm to the commit, s; left of the line: before it", ylim=(len(KNOWN) - 0.4, -0.6))
        axes.invert_xaxis()
        axes.set_title("How early alarms come; diamonds: medians, bars: quartiles")


def time_line(evaluation: TrafficEvaluation, measured: MeasuredAlarms, path: Path) -> None:
    """Draw the first measured episode: a row for each vehicle, events as bars, alarms as marks."""
    truth, alarms = evaluation.truths[0], measured.alarms[0]
    episode, false = truth.episode, set(truth.table.match(alarms).false.tolist())
    number = {name: k for k, name in enumerate(episode.names)}
    colour = {intention.text: CYCLE[k] for k, intention in enumerate(KNOWN)}
    count = np.bincount(alarms.vehicle, minlength=len(episode.names))
    for event in episode.facts.events:
        if event.vehicle in number:
            count[number[event.vehicle]] += 1
    vehicles = [k for k in np.argsort(-count, kind="stable")[:MOST_VEHICLES].tolist() if count[k]]
    row = {vehicle: place for place, vehicle in enumerate(vehicles)}
    with figure(path, 10, 1.5 + 0.24 * max(len(vehicles), 4)) as drawn:
        axes = drawn.subplots()
        for vehicle, place in row.items():
            times = episode.time_s[episode.vehicle == vehicle]
            axes.plot(times, np.full(len(times), place), ".", color="#e5e7eb", ms=3)
        for event in episode.facts.events:
            if (place := row.get(number.get(event.vehicle, -1), -1)) >= 0:
                faint = 0.25 if event.left_out else 0.8
                axes.barh(
                    place, event.end - event.onset, left=event.onset, height=0.6, color=colour[event.intention],
                    alpha=faint, lw=0,
                )  # fmt: skip
        for k in range(len(alarms)):
            if (place := row.get(int(alarms.vehicle[k]), -1)) >= 0:
                shade = CYCLE[int(alarms.intention[k])]
                axes.plot(alarms.time_s[k], place, "x" if k in false else "v", color=shade, mec="black", ms=7)
        axes.set_yticks(range(len(vehicles)), [episode.names[k] for k in vehicles], fontsize=7)
        axes.set(xlabel="simulation time, s", ylim=(max(len(vehicles), 1) - 0.4, -0.6))
        axes.set_title(
            f"{episode.facts.scenario}, seed {episode.facts.seed}: events (bars), alarms (triangles, false: x)"
        )
        _legend(axes, colour)


def _time_rows(evaluation: TrafficEvaluation, measured: MeasuredAlarms) -> Iterator[Row]:
    """Yield the events and the alarms of the first measured episode, times in s of simulation time."""
    truth, alarms = evaluation.truths[0], measured.alarms[0]
    false = set(truth.table.match(alarms).false.tolist())
    for event in truth.episode.facts.events:
        what = {"vehicle": event.vehicle, "what": "event", "intention": spoken(event.intention)}
        yield {**what, "from s": event.onset, "to s": event.end, "does not count": spoken(event.left_out or "")}
    for k in range(len(alarms)):
        at = float(alarms.time_s[k])
        yield {
            "vehicle": truth.episode.names[int(alarms.vehicle[k])],
            "what": "false alarm" if k in false else "alarm",
            "intention": spoken(KNOWN[int(alarms.intention[k])].text),
            "from s": at,
            "to s": at,
        }


def _legend(axes: Axes, colour: Mapping[str, str]) -> None:
    """Name the colours of the intentions."""
    for name, shade in colour.items():
        axes.plot([], [], "s", color=shade, label=spoken(name))
    axes.legend(**BESIDE)


SHOWN = {
    "ttc_below_3_s": "time to collision\nbelow 3 s",
    "ttc_below_1_5_s": "time to collision\nbelow 1.5 s",
    "drac_above_3_4_s": "DRAC\nabove 3.4 m/s²",
    "travel_s_per_km": "travel time",
}
"""The figures that are drawn in percent, and their titles. Collisions are drawn beside them, in vehicles a seed."""


def arms(result: ClosedLoopResult, path: Path) -> None:
    """Draw by how much each arm differs from `none`, percent, with the intervals over seeds; collisions in vehicles."""
    names = [arm for arm in result.arms if arm != REFERENCE]
    with figure(path, 12.5, 1.6 + 0.42 * len(names)) as drawn:
        *of_driving, of_collisions = drawn.subplots(1, len(SHOWN) + 1, sharey=True)
        for axes, (name, title) in zip(of_driving, SHOWN.items(), strict=True):
            differences = [result.arms[arm].difference[name] for arm in names]
            marks = [(difference.relative, difference.relative_interval) for difference in differences]
            _against_none(axes, title, "against none, %", marks, 100.0)
        collided = [result.arms[arm].difference_collided for arm in names]
        marks = [
            (None, None) if difference is None else (difference.value, difference.interval) for difference in collided
        ]
        _against_none(of_collisions, "vehicles\nthat collide", "against none, in a seed", marks, 1.0)
        of_collisions.set_yticks(range(len(names)), names)


def _against_none(
    axes: Axes, title: str, label: str, marks: Sequence[tuple[float | None, Interval | None]], scale: float
) -> None:
    """Draw a difference and its interval for each arm, times `scale`."""
    axes.axvline(0.0, color=GREY, lw=1, ls="--")
    for row, (value, interval) in enumerate(marks):
        if value is None:
            axes.text(0.0, row, " undefined", va="center", fontsize=8, color=GREY)
            continue
        if interval is not None:
            axes.plot([scale * interval.low, scale * interval.high], [row, row], color=BLUE, lw=2)
        axes.plot(scale * value, row, "D", color=BLUE, ms=6)
    axes.set(xlabel=label, ylim=(len(marks) - 0.5, -0.5))
    axes.set_title(title)
