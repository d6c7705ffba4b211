"""Scores the arms of a closed loop against each other, on the same seeds.

From the first advisory on, the traffic of two arms differs, and with it their alarms. What is scored is therefore fixed
by the arm `placebo`, in which nothing is sent: the vehicles near the TV at each of its alarms, for some time after it.
The same vehicles at the same times are scored in every arm.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray
from isac_cosim.evaluation.closed_loop.results import ArmDifference, ArmResult
from isac_cosim.evaluation.closed_loop.safety import Encroachments, Totals, figures
from isac_cosim.evaluation.closed_loop.settings import Arm, ClosedLoopSettings, what
from isac_cosim.evaluation.closed_loop.store import ArmEpisode, ArmFacts
from isac_cosim.evaluation.statistics import Interval, jackknife_half_width
from isac_cosim.isacsim.sensing.sensors import DEFAULT

REFERENCE: Arm = "none"
"""The arm that the others are compared with."""
ALARMING: Arm = "placebo"
"""The arm whose alarms say what is scored."""
Spans = Mapping[str, Sequence[tuple[float, float]]]
"""Times that are scored, by vehicle: from and to, s."""


def spans_of(placebo: ArmEpisode, settings: ClosedLoopSettings) -> Spans:
    """Return the vehicles near the TV at the alarms of an episode, each with the times after them."""
    driving, spans = placebo.driving, defaultdict(list)
    for alarm in placebo.facts.alarms:
        then = np.abs(driving.time_s - alarm.time_s) < driving.every_s / 2 + 1e-9
        near = then & (np.hypot(driving.x - alarm.x, driving.y - alarm.y) <= settings.near_m)
        for vehicle in np.unique(driving.vehicle[near]).tolist():
            spans[driving.names[vehicle]].append((alarm.raised_s, alarm.raised_s + settings.after_s))
    return dict(spans)


def rows_within(episode: ArmEpisode, spans: Spans) -> BoolArray:
    """Return which rows of an arm's driving are within the spans, (n,)."""
    driving, rows = episode.driving, np.zeros(len(episode.driving.time_s), dtype=bool)
    first = np.searchsorted(driving.vehicle, np.arange(len(driving.names) + 1))
    for number, name in enumerate(driving.names):
        part = slice(first[number], first[number + 1])
        rows[part] = _inside(driving.time_s[part], spans.get(name, ()))
    return rows


def encroachments_within(encroachments: Encroachments, spans: Spans) -> BoolArray:
    """Return which encroachments are within the spans of either vehicle, (m,)."""
    rows = zip(encroachments.entering, encroachments.behind, encroachments.time_s, strict=True)
    return np.array(
        [bool(_inside(np.array([t]), (*spans.get(a, ()), *spans.get(b, ())))[0]) for a, b, t in rows], dtype=bool
    )


def _inside(times: Array, spans: Sequence[tuple[float, float]]) -> BoolArray:
    inside = np.zeros(len(times), dtype=bool)
    for begin, end in spans:
        inside |= (times > begin + 1e-9) & (times <= end + 1e-9)
    return inside


def totals_of(episode: ArmEpisode, spans: Spans | None) -> Totals:
    """Return the totals of an arm of one seed. spans: what is scored; None: everything."""
    encroachments = episode.encroachments
    if spans is None:
        everything = np.ones(len(episode.driving.time_s), dtype=bool)
        return Totals.of(episode.driving, encroachments, everything, np.ones(len(encroachments.pet_s), dtype=bool))
    chosen = encroachments_within(encroachments, spans)
    return Totals.of(episode.driving, encroachments, rows_within(episode, spans), chosen)


def arm_results(
    episodes: Mapping[Arm, Sequence[ArmEpisode]], settings: ClosedLoopSettings, sensor: str = DEFAULT
) -> tuple[dict[Arm, ArmResult], float]:
    """Return the results of the arms, and the vehicle-hours that are scored.

    episodes: by arm, seed by seed. sensor: of the open loop.
    """
    spans = [spans_of(episode, settings) for episode in episodes[ALARMING]]
    scored = {arm: [totals_of(e, s) for e, s in zip(rows, spans, strict=True)] for arm, rows in episodes.items()}
    everything = {arm: [totals_of(episode, None) for episode in rows] for arm, rows in episodes.items()}
    results = {}
    for arm, rows in episodes.items():
        fates = Counter(advisory.fate for episode in rows for advisory in episode.facts.advisories)
        first = {
            str(episode.facts.seed): min(advisory.time_s for advisory in episode.facts.advisories)
            for episode in rows
            if episode.facts.advisories
        }
        results[arm] = ArmResult(
            what=what(arm, sensor),
            alarms=sum(len(episode.facts.alarms) for episode in rows),
            advisories=sum(fates.values()),
            fates=dict(sorted(fates.items())),
            predicted_hours=sum(episode.facts.predicted_hours for episode in rows),
            collided=sum(len(episode.facts.collided) for episode in rows),
            first_advisory_s=first,
            after_alarms=_shown(figures(scored[arm])),
            all_traffic=_shown(figures(everything[arm])),
            difference=differences(scored[arm], scored[REFERENCE]),
            difference_all_traffic=differences(everything[arm], everything[REFERENCE]),
            difference_collided=collisions(rows, episodes[REFERENCE]),
            collided_advised=sum(len(collided_advised(episode.facts)) for episode in rows),
        )
    return results, sum(totals.hours for totals in scored[REFERENCE])


def differences(arm: Sequence[Totals], reference: Sequence[Totals]) -> dict[str, ArmDifference]:
    """Return by how much the figures of an arm differ from those of the reference, seed by seed the same traffic."""

    def measure(seeds: Sequence[int]) -> dict[str, tuple[float, float]]:
        return _difference([arm[seed] for seed in seeds], [reference[seed] for seed in seeds])

    return _with_intervals(measure, len(arm))


def collisions(arm: Sequence[ArmEpisode], reference: Sequence[ArmEpisode]) -> ArmDifference:
    """Return by how much the number of vehicles that collide, in the mean over seeds, differs from the reference."""
    numbers = np.array([[len(row.facts.collided) for row in rows] for rows in (arm, reference)], dtype=np.float64)

    def measure(seeds: Sequence[int]) -> dict[str, tuple[float, float]]:
        of_arm, base = numbers[:, list(seeds)].mean(axis=1).tolist() if seeds else (np.nan, np.nan)
        return {"collided": (of_arm - base, (of_arm - base) / base if base else np.nan)}

    return _with_intervals(measure, len(arm))["collided"]


def collided_advised(facts: ArmFacts) -> set[str]:
    """Return the vehicles that collided and followed an advisory, for however long, before or after it."""
    return {advisory.vehicle for advisory in facts.advisories if advisory.begun_s is not None} & {*facts.collided}


def _with_intervals(
    measure: Callable[[Sequence[int]], Mapping[str, tuple[float, float]]], seeds: int
) -> dict[str, ArmDifference]:
    """Return differences with jackknife intervals. measure: gives them, absolute and relative, on some of the seeds."""
    left_out = [measure([other for other in range(seeds) if other != seed]) for seed in range(seeds)]
    result = {}
    for name, (value, relative) in measure(range(seeds)).items():
        widths = jackknife_half_width(np.array([part[name] for part in left_out]))
        result[name] = ArmDifference(
            value=_number(value),
            interval=_interval(value, float(widths[0]), seeds),
            relative=_number(relative),
            relative_interval=_interval(relative, float(widths[1]), seeds, least=-1.0),
        )
    return result


def _difference(arm: Sequence[Totals], reference: Sequence[Totals]) -> dict[str, tuple[float, float]]:
    """Return difference and relative difference of each figure; NaN where undefined."""
    of_arm, of_reference = figures(arm), figures(reference)
    return {
        name: (of_arm[name] - base, (of_arm[name] - base) / base if base else np.nan)
        for name, base in of_reference.items()
    }


def _interval(value: float, half_width: float, seeds: int, least: float = -np.inf) -> Interval | None:
    """Return the interval about a value; None where it is undefined. least: the smallest possible value."""
    if not np.isfinite(value) or not np.isfinite(half_width):
        return None
    return Interval(low=max(value - half_width, least), high=value + half_width, seeds=seeds)


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _shown(values: Mapping[str, float]) -> dict[str, float | None]:
    return {name: _number(value) for name, value in values.items()}
