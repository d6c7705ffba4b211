"""What became of the demand in a dataset's simulations, and what its author should know of that."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

from isac_cosim.isacsim.radio.blockage import CAR_KINDS, HIGH_KINDS
from isac_cosim.isacsim.traffic.recordings.sumo_messages import added_up
from isac_cosim.labeling.dataset.shard import Episode

KINDS_SHOWN = 8
"""So many kinds of SUMO's warnings are shown; the plain values hold all of them."""
MANY_COLLIDED = 0.05
"""A larger share of vehicles that collided is warned of."""


def traffic_summary(episodes: Iterable[Episode]) -> dict[str, Any] | None:
    """Return what became of the demand in some episodes as plain values; None where no episode says it.

    vehicles, discarded, collided, teleported: number of vehicles, the last three of the first. by_class: vehicles by
    SUMO vehicle class. warnings: SUMO's warnings by kind, with their number, that of the episodes with them, and an
    example. empty: for each scenario with episodes in which no vehicle was recorded, their number, that of all its
    episodes, the recorded span, s, and when the first vehicle departs, s.
    """
    known = [(episode, episode.traffic) for episode in episodes if episode.traffic is not None]
    if not known:
        return None
    classes: Counter[str] = Counter()
    holding: Counter[str] = Counter()
    empty: dict[str, dict[str, Any]] = {}
    episodes_of = Counter(episode.scenario for episode, _ in known)
    for episode, traffic in known:
        classes.update(traffic.by_class)
        holding.update(warning.kind for warning in traffic.warnings)
        if not traffic.recorded and not episode.collided and not episode.teleported:
            span = {"from_s": traffic.from_s, "to_s": traffic.to_s, "first_departure_s": traffic.first_departure_s}
            entry = empty.setdefault(episode.scenario, {"episodes": 0, "of": episodes_of[episode.scenario], **span})
            entry["episodes"] += 1
    return {
        "vehicles": sum(traffic.vehicles for _, traffic in known),
        "by_class": dict(sorted(classes.items())),
        "discarded": sum(traffic.discarded for _, traffic in known),
        "collided": sum(episode.collided for episode, _ in known),
        "teleported": sum(episode.teleported for episode, _ in known),
        "warnings": [
            {**warning.model_dump(), "episodes": holding[warning.kind]}
            for warning in added_up(traffic.warnings for _, traffic in known)
        ],
        "empty": empty,
    }


def share_text(values: dict[str, Any] | None, name: str, number: int) -> str:
    """Return a number of vehicles with that of all vehicles, where it is known.

    values: as from `traffic_summary`. name: key of the number there.
    """
    if values is None or values[name] != number:
        return str(number)
    return f"{number} of {values['vehicles']} vehicles"


def traffic_faults(values: dict[str, Any] | None) -> list[str]:
    """Return warnings about the traffic of a dataset, one line each. values: as from `traffic_summary`."""
    if values is None:
        return []
    vehicles = values["vehicles"]
    lines = [_empty_text(scenario, entry) for scenario, entry in values["empty"].items()]
    if values["discarded"]:
        lines.append(
            f"SUMO discarded {values['discarded']} vehicles that found no room to depart in time (`max-depart-delay`); "
            f"{vehicles} departed"
        )
    if values["collided"] > MANY_COLLIDED * vehicles:
        lines.append(
            f"{values['collided']} of {vehicles} vehicles collided and are in no sample: SUMO's warnings name places"
        )
    unknown = {name: number for name, number in values["by_class"].items() if name not in (*CAR_KINDS, *HIGH_KINDS)}
    if unknown:
        named = ", ".join(f"{name} {number}" for name, number in unknown.items())
        lines.append(
            f"{sum(unknown.values())} of {vehicles} vehicles are neither cars nor trucks ({named}): they echo and "
            "block as cars do; `pairs.tv_kinds` and `pairs.uv_kinds` leave classes out"
        )
    lines += map(_warning_text, values["warnings"][:KINDS_SHOWN])
    if others := values["warnings"][KINDS_SHOWN:]:
        lines.append(
            f"SUMO gave {sum(warning['count'] for warning in others)} more warnings of {len(others)} other kinds: "
            "`inspect --json` shows them"
        )
    return lines


def _warning_text(warning: dict[str, Any]) -> str:
    """Return the line about one kind of SUMO's warnings."""
    count, episodes = warning["count"], warning["episodes"]
    if count == 1:
        return f"SUMO warned once: {warning['example']}"
    where = "1 episode" if episodes == 1 else f"{episodes} episodes"
    return f"SUMO warned {count} times in {where}, for example: {warning['example']}"


def _empty_text(scenario: str, entry: dict[str, Any]) -> str:
    """Return the line about the episodes of a scenario in which no vehicle was recorded."""
    first_s, span = entry["first_departure_s"], (entry["from_s"], entry["to_s"])
    departs = "none of its demand departs at a known time"
    if first_s is not None:
        departs = f"the first departs at {seconds_text(first_s)} s"
    return (
        f"{scenario}: no vehicle between {' and '.join(map(seconds_text, span))} s in {entry['episodes']} of "
        f"{entry['of']} episodes; {departs}: set `begin` in its configuration, or traffic.run_in_s and "
        "traffic.duration_s"
    )


def seconds_text(seconds: float) -> str:
    """Return a time with all its digits down to milliseconds, in which SUMO counts: `25,205` or `1,732,518,000.5`."""
    text = f"{seconds:,.3f}"
    return text.rstrip("0").rstrip(".")
