"""What an operator asks: which maneuvers are predicted, and which sudden ones are recognised in time.

Changes of lane and swerves take seconds from the first motion to the commit, so that they can be predicted by then.
Hard brakes and accelerations commit some 0.4 s after their onset, before anybody could act: for them the question is
whether they are recognised by half a second after the commit. Each question has alarms of its own, chosen on the
development seeds, and a budget of false alarms of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from isac_cosim.evaluation.in_traffic.alarms.background import KeptTrees
from isac_cosim.evaluation.in_traffic.measurement import measuring
from isac_cosim.evaluation.in_traffic.measurement.measuring import MeasuredAlarms
from isac_cosim.evaluation.in_traffic.scores.results import HeadlineResult, HeadlineScores, NearMisses, RateScores
from isac_cosim.evaluation.in_traffic.scores.scoring import Truth, median_lead
from isac_cosim.evaluation.in_traffic.settings import LiveSettings, Method
from isac_cosim.evaluation.in_traffic.streams.store import RUN
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.labeling.streams.events import NEAR_MISS

PREDICTED: Final = (Intention.LEFT_LANE_CHANGE, Intention.RIGHT_LANE_CHANGE, Intention.EVASIVE_SWERVE)
"""The intentions that are to be predicted by their commit; an overtake is the lane change that it begins with."""
RECOGNISED: Final = (Intention.HARD_BRAKE, Intention.HARD_ACCEL)
"""The intentions that are to be recognised by RECOGNISED_WITHIN_S after their commit."""
RECOGNISED_WITHIN_S = 0.5
LEADS_S = (0.5, 1.0)
"""Lead times at which recall is told, s."""
KEEPS_WITHIN = 1.5
"""Alarms keep to a rate of false alarms if they raise at most so many times as many, and no fewer than its inverse."""


def prediction(
    development: Sequence[Truth], measured: Sequence[Truth], live: LiveSettings, method: Method, kept: KeptTrees
) -> HeadlineResult | None:
    """Return how well changes of lane and swerves are predicted; None if no alarm can be chosen.

    development, measured: with five intentions. method: kind of alarm.
    """
    return _headline(development, measured, live, method, kept, PREDICTED, 0.0)


def recognition(
    development: Sequence[Truth], measured: Sequence[Truth], live: LiveSettings, method: Method, kept: KeptTrees
) -> HeadlineResult | None:
    """Return how well hard brakes and accelerations are recognised, as `prediction`."""
    return _headline(development, measured, live, method, kept, RECOGNISED, RECOGNISED_WITHIN_S)


def keeps_to_rate(measured: float | None, asked: float) -> bool | None:
    """Return whether a measured rate of false alarms is near the one that was asked for; None without any hour."""
    return None if measured is None else asked / KEEPS_WITHIN <= measured <= asked * KEEPS_WITHIN


def _headline(
    development: Sequence[Truth],
    measured: Sequence[Truth],
    live: LiveSettings,
    method: Method,
    kept: KeptTrees,
    intentions: Sequence[Intention],
    after_commit_s: float,
) -> HeadlineResult | None:
    numbers = [KNOWN.index(intention) for intention in intentions]
    chosen_on, asked_of = (
        [truth.asking(numbers, after_commit_s) for truth in truths] for truths in (development, measured)
    )
    of_run = measuring.measure_methods(chosen_on, asked_of, RUN, live, "", [method], kept).get(method)
    if of_run is None or of_run.result.alarms is None:
        return None
    result, asked = of_run.result, live.choice.false_alarms_per_vehicle_hour
    rate = result.over_all.false_alarms_per_vehicle_hour
    return HeadlineResult(
        by_commit_plus_s=after_commit_s,
        chosen_for=asked,
        alarms=result.alarms,
        events=result.over_all.events,
        recall=result.over_all.recall,
        recall_interval=result.over_all.recall_interval,
        false_alarms_per_vehicle_hour=rate,
        keeps_to_rate=keeps_to_rate(rate, asked),
        lead_s=_median_lead(of_run, after_commit_s),
        by_intention={
            intention.text: HeadlineScores(
                events=result.by_intention[intention.text].events,
                recall=result.by_intention[intention.text].recall,
                lead_s=_median_lead(of_run, after_commit_s, number),
                false_alarms_per_vehicle_hour=result.by_intention[intention.text].false_alarms_per_vehicle_hour,
            )
            for intention, number in zip(intentions, numbers, strict=True)
        },
        recall_at_lead={f"{lead_s:g}": _recall_at(of_run, lead_s + after_commit_s) for lead_s in LEADS_S},
        near_misses=NearMisses(
            events=sum(
                event.left_out == NEAR_MISS and event.intention in [intention.text for intention in intentions]
                for truth in measured
                for event in truth.episode.facts.events
            ),
            alarms=sum(len(outcome.near_intention) for outcome in of_run.outcomes),
        ),
        at=[
            RateScores(
                chosen_for=point.false_alarms_per_vehicle_hour,
                recall=point.recall,
                false_alarms_per_vehicle_hour=point.measured,
                keeps_to_rate=keeps_to_rate(point.measured, point.false_alarms_per_vehicle_hour),
            )
            for point in result.frozen_at[live.choice.threshold]
        ],
    )


def _recall_at(measured: MeasuredAlarms, before_deadline_s: float) -> float | None:
    """Return the share of events whose alarm came so long before they had to be named."""
    leads = np.concatenate([np.empty(0), *(outcome.to_commit for outcome in measured.outcomes)])
    return float((leads >= before_deadline_s - 1e-9).mean()) if len(leads) else None


def _median_lead(measured: MeasuredAlarms, after_commit_s: float, number: int | None = None) -> float | None:
    """Return the median time from alarm to commit of the events that were named in time, s; None without any."""
    outcomes = [outcome.of(number) for outcome in measured.outcomes]
    return median_lead([outcome.to_commit[outcome.predicted] - after_commit_s for outcome in outcomes])
