"""What is shown of a closed loop: what advisories change in the traffic, and what every arm is worth."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from isac_cosim.evaluation.closed_loop.results import ArmDifference, ClosedLoopResult
from isac_cosim.evaluation.report.live_parts import between, number
from isac_cosim.evaluation.report.parts import NO_VALUE, Part, Row, Shown, counted
from isac_cosim.evaluation.statistics import Interval

ARMS_FIGURE = "arms.png"
ISAC = "isac"
"""The arm whose advisories come of what the network senses."""
DANGER, TRAVEL, COLLIDED = "ttc_below_1_5_s", "travel_s_per_km", "collided"
"""The figures that sum an arm up."""
ARM, QUANTITY, CHANGE, UNIT = "arm", "quantity", "against none", "unit"
"""Columns of the figure's table."""


class LoopFirst:
    """What was measured, in a sentence, and by how much the advisories of the network change the traffic."""

    result_class = ClosedLoopResult

    def parts(self, shown: Shown) -> list[Part]:
        result: ClosedLoopResult = shown.result
        facts = result.closed_loop
        text = (
            f"What drivers in {result.scenario} gain when connected vehicles are told of the alarms of {result.name}: "
            f"{counted(len(result.arms), 'arm')} on the same {counted(facts.seeds, 'seed')}, "
            f"{facts.scored_vehicle_hours:.1f} vehicle-hours after alarms."
        )
        return [Part("loop-first", text=text, numbers=_first_numbers(result), on_terminal=False)]


def _first_numbers(result: ClosedLoopResult) -> list[tuple[str, str]]:
    """Return the differences of the arm ISAC from no advisories, with their names; none that is undefined."""
    arm = result.arms.get(ISAC)
    if arm is None:
        return []
    asked = [
        (_percent(arm.difference[DANGER]), "time below 1.5 s of TTC near alarms, with advisories against none"),
        (_percent(arm.difference[TRAVEL]), "travel time there"),
    ]
    collided = arm.difference_collided
    if collided is not None and collided.value is not None:
        asked.append((f"{collided.value:+.1f}{between(collided.interval, 1)}", "vehicles that collide in a seed"))
    return [(figure, name) for figure, name in asked if figure]


def _percent(difference: ArmDifference) -> str:
    """Return a relative difference with its interval, unless that is a point; nothing where it is undefined."""
    if difference.relative is None:
        return ""
    changed, of_none = f"{100 * difference.relative:+.1f} %", difference.relative_interval
    if of_none is None or of_none.low == of_none.high:
        return changed
    return f"{changed} ({100 * of_none.low:+.0f} to {100 * of_none.high:+.0f} %)"


class Advisories:
    """The arms of a closed loop, and how the one with ISAC differs from that without advisories."""

    result_class = ClosedLoopResult

    def parts(self, shown: Shown) -> list[Part]:
        result: ClosedLoopResult = shown.result
        facts, changes = result.closed_loop, [*_differences(result)]
        title = f"closed loop: {facts.scored_vehicle_hours:.2f} vehicle-hours after alarms, {facts.seeds} seeds"
        caption = "By how much each arm differs from the traffic without advisories; bars: 95 % intervals."
        return [
            Part(
                "advisories",
                title,
                rows=list(_arms(result)),
                figures=[(ARMS_FIGURE, caption)],
                figure_rows={ARMS_FIGURE: changes},
                seen={ARMS_FIGURE: _seen(changes)},
            ),
            Part("advisories-in-words", lines=_arm_sentences(result)),
        ]


def _seen(changes: Sequence[Row]) -> str:
    """Return what there is to be seen in the figure: how time in danger and collisions change with each arm."""
    danger, collided = (
        "; ".join(
            f"{row[ARM]} {row[CHANGE]:+.{digits}f}{unit}"
            for row in changes
            if row[QUANTITY] == quantity and isinstance(row[CHANGE], float)
        )
        for quantity, digits, unit in ((DANGER, 0, " %"), (COLLIDED, 1, ""))
    )
    seen = f"A mark with its interval for each quantity and arm. Time below 1.5 s of TTC: {danger or 'not defined'}."
    return f"{seen} Vehicles that collide in a seed: {collided}." if collided else seen


def _arms(result: ClosedLoopResult) -> Iterable[Row]:
    for arm, measured in result.arms.items():
        values, difference = measured.after_alarms, measured.difference[DANGER]
        yield {
            "arm": arm,
            "alarms": measured.alarms,
            "advisories": measured.advisories,
            "TTC < 3 s": number(values["ttc_below_3_s"]),
            "TTC < 1.5 s": number(values["ttc_below_1_5_s"]),
            "DRAC > 3.4": number(values["drac_above_3_4_s"]),
            "against none": NO_VALUE if difference.relative is None else f"{100 * difference.relative:+.0f} %",
            "travel s/km": number(values["travel_s_per_km"]),
            "collided": measured.collided,
            "of these advised": NO_VALUE if measured.collided_advised is None else measured.collided_advised,
        }


def _differences(result: ClosedLoopResult) -> Iterator[Row]:
    """Yield by how much each arm differs from the traffic without advisories, for each quantity."""
    for arm, measured in result.arms.items():
        for name, difference in measured.difference.items():
            yield _change(arm, name, difference.relative, difference.relative_interval, 100.0, "%")
        collided = measured.difference_collided
        if collided is not None:
            yield _change(arm, COLLIDED, collided.value, collided.interval, 1.0, "vehicles in a seed")


def _change(arm: str, quantity: str, value: float | None, interval: Interval | None, scale: float, unit: str) -> Row:
    return {
        ARM: arm,
        QUANTITY: quantity,
        CHANGE: None if value is None else scale * value,
        "low": None if interval is None else scale * interval.low,
        "high": None if interval is None else scale * interval.high,
        UNIT: unit,
    }


def _arm_sentences(result: ClosedLoopResult) -> list[str]:
    """Return what the arms say, a line each."""
    latency = result.closed_loop.latency
    low, high = latency.reaction_s
    lines = [
        f"latency: sensing {latency.sensing_s:g} s, network {latency.network_s:g} s, driver {low:g} to {high:g} s; "
        "TTC and DRAC in s per vehicle-hour; `against none` is TTC < 1.5 s"
    ]
    if ISAC in result.arms:
        for name, text, unit in (
            (DANGER, "time below 1.5 s of TTC", "s per vehicle-hour"),
            (TRAVEL, "travel time", "s/km"),
        ):
            difference = result.arms[ISAC].difference[name]
            if difference.relative is not None and difference.value is not None:
                seconds = between(difference.interval, 2)
                lines.append(
                    f"ISAC against none: {text} {_percent(difference)}, {difference.value:+.2f}{seconds} {unit}"
                )
        collided = result.arms[ISAC].difference_collided
        if collided is not None and collided.value is not None:
            seeds = between(collided.interval, 1)
            lines.append(f"ISAC against none: {collided.value:+.1f}{seeds} vehicles collide in a seed")
    return lines
