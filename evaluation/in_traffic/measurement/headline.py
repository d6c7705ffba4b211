"""What an operator asks: which maneuvers are predicted, and which sudden ones are recognised in time.

Changes of lane and swerves take seconds from the first motion to the commit, so that they can be predicted by then.
Hard brakes and accelerations commit some 0.4 s after their onset, before anybody could act: for them the question is
whether they are recognised by half a second after the commit. Each question has alarms of its own, chosen on the
development seeds, and a budget of false alarms of its own. So has each intention, in a third answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from isac_cosim.evaluation.in_traffic.alarms.background import NOT_KEPT, KeptTrees
from isac_cosim.evaluation.in_traffic.measurement.measuring import MeasuredAlarms, Prepared
from isac_cosim.evaluation.in_traffic.scores.results import (
    BudgetScores,
    HeadlineResult,
    Headlines,
    HeadlineScores,
    NearMisses,
    RateScores,
)
from isac_cosim.evaluation.in_traffic.scores.scoring import (
    AlarmOutcome,
    Truth,
    event_scores,
    median_lead,
    rate_interval,
)
from isac_cosim.evaluation.in_traffic.settings import LiveSettings, Method
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.labeling.streams.events import NEAR_MISS

PREDICTED: Final = (Intention.LEFT_LANE_CHANGE, Intention.RIGHT_LANE_CHANGE, Intention.EVASIVE_SWERVE)
"""The intentions that are to be predicted by their commit; an overtake is the lane change that it begins with."""
RECOGNISED: Final = (Intention.HARD_BRAKE, Intention.HARD_ACCEL)
"""The intentions that are to be recognised by RECOGNISED_WITHIN_S after their commit."""
RECOGNISED_WITHIN_S = 0.5
LEADS_S = (0.5, 1.0)
"""Lead times at which recall is told, s."""
OWN_RATES = (1.0, 3.0, 5.0)
"""False alarms per vehicle-hour for which the alarms of a single intention are chosen."""
KEEPS_WITHIN = 1.5
"""Alarms keep to a rate of false alarms if they raise at most so many times as many, and no fewer than its inverse."""


def headlines(
    development: Sequence[Truth],
    measured: Sequence[Truth],
    predictor: str,
    live: LiveSettings,
    method: Method,
    kept: KeptTrees = NOT_KEPT,
) -> Headlines:
    """Return what a predictor answers to both questions; None for one for which no alarm can be chosen.

    development, measured: with five intentions. predictor: its name in the episodes. method: kind of alarm. kept: where
    the trees of this evaluation are kept.
    """
    prepared = Prepared.of(development, measured, predictor, live, method, kept)
    if prepared is None:
        return Headlines(prediction=None, recognition=None)
    return Headlines(
        prediction=_headline(prepared, live, PREDICTED, 0.0),
        recognition=_headline(prepared, live, RECOGNISED, RECOGNISED_WITHIN_S),
    )


def keeps_to_rate(measured: float | None, asked: float) -> bool | None:
    """Return whether a measured rate of false alarms is near the one that was asked for; None without any hour."""
    return None if measured is None else asked / KEEPS_WITHIN <= measured <= asked * KEEPS_WITHIN


def _headline(
    prepared: Prepared, live: LiveSettings, intentions: Sequence[Intention], after_commit_s: float
) -> HeadlineResult | None:
    numbers = [KNOWN.index(intention) for intention in intentions]
    of_run = prepared.asking(numbers, after_commit_s).measure(live)
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
        false_alarms_interval=rate_interval(of_run.outcomes, live.scoring),
        keeps_to_rate=keeps_to_rate(rate, asked),
        lead_s=_median_lead(of_run, after_commit_s),
        by_intention={
            intention.text: HeadlineScores(
                events=result.by_intention[intention.text].events,
                recall=result.by_intention[intention.text].recall,
                lead_s=_median_lead(of_run, after_commit_s, number),
                false_alarms_per_vehicle_hour=result.by_intention[intention.text].false_alarms_per_vehicle_hour,
                own_budget=_own_budget(prepared.asking([number], after_commit_s), live, after_commit_s),
            )
            for intention, number in zip(intentions, numbers, strict=True)
        },
        recall_at_lead=_recall_at_lead(of_run.outcomes, after_commit_s),
        near_misses=NearMisses(
            events=sum(
                event.left_out == NEAR_MISS and event.intention in [intention.text for intention in intentions]
                for truth in prepared.streams.truths
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


def _own_budget(alone: Prepared, live: LiveSettings, after_commit_s: float) -> list[BudgetScores]:
    """Return the scores of alarms for a single intention, chosen for each of OWN_RATES."""
    options, scores = alone.options(live), []
    for rate in OWN_RATES:
        chosen = options.choose(rate, "shared")
        if chosen is None:
            continue
        outcomes = alone.streams.outcomes(alone.streams.alarms(chosen.alarms))
        of_rate = event_scores(outcomes, live.scoring)
        scores.append(
            BudgetScores(
                chosen_for=rate,
                recall=of_rate.recall,
                recall_interval=of_rate.recall_interval,
                false_alarms_per_vehicle_hour=of_rate.false_alarms_per_vehicle_hour,
                keeps_to_rate=keeps_to_rate(of_rate.false_alarms_per_vehicle_hour, rate),
                recall_at_lead=_recall_at_lead(outcomes, after_commit_s),
            )
        )
    return scores


def _recall_at_lead(outcomes: Sequence[AlarmOutcome], after_commit_s: float) -> dict[str, float | None]:
    """Return the share of events whose alarm came so long before the commit, by the lead."""
    leads = np.concatenate([np.empty(0), *(outcome.to_commit for outcome in outcomes)]) - after_commit_s
    return {f"{lead_s:g}": float((leads >= lead_s - 1e-9).mean()) if len(leads) else None for lead_s in LEADS_S}


def _median_lead(measured: MeasuredAlarms, after_commit_s: float, number: int | None = None) -> float | None:
    """Return the median time from alarm to commit of the events that were named in time, s; None without any."""
    outcomes = [outcome.of(number) for outcome in measured.outcomes]
    return median_lead([outcome.to_commit[outcome.predicted] - after_commit_s for outcome in outcomes])
