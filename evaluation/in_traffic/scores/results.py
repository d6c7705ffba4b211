"""The result of an evaluation in traffic: the content of `metrics.json`.

An undefined score, such as the recall of an intention without events, is None (`null` in the file). All times are in s.
An event is predicted if its alarm came by its commit, and detected if it came later, by its end.
"""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field, JsonValue

from isac_cosim.base.settings import Settings, WithOptionalParts
from isac_cosim.evaluation.in_traffic.settings import AlarmSettings, LiveStudy, Sharing
from isac_cosim.evaluation.statistics import Interval
from isac_cosim.models.runs.run import RunCard

METRICS_FILE = "metrics.json"
COMMIT_IS = {
    "hard_brake": "threshold reached",
    "left_lane_change": "marking crossed",
    "right_lane_change": "marking crossed",
    "overtake": "marking crossed, pulling out",
    "hard_accel": "threshold reached",
    "evasive_swerve": "lateral peak",
}
"""The instant that is the commit, by intention."""


class LeadTimes(Settings):
    """Median and quartiles of lead times, s; positive if the alarm comes before the instant. n: number of alarms."""

    n: int
    lower_quartile: float | None
    median: float | None
    upper_quartile: float | None


class EventScores(Settings):
    """The scores of alarms for some events.

    events: number that count. predicted, detected: number whose alarm came by the commit, or later by the end. missed:
    number without an alarm. false_alarms: alarms that belong to no event, second alarms for an event included.
    vehicle_hours: time with predictions, of all vehicles.
    precision, recall, f1: of prediction; a detection counts as a miss, but not as a false alarm. recall_with_detection:
    share of events that had an alarm by their end. precision_with_detection: share of alarms that belong to an event.
    recall_interval: None with a single seed. false_alarms_per_vehicle_hour_upper: upper 95 % bound of the rate, if
    false alarms are a Poisson process. lead_time_s: from alarm to commit, detections included. lead_to_onset_s: from
    alarm to onset. commit_is: the instant that is the commit.
    """

    events: int
    predicted: int
    detected: int
    missed: int
    false_alarms: int
    vehicle_hours: float
    precision: float | None
    recall: float | None
    f1: float | None
    recall_with_detection: float | None
    precision_with_detection: float | None
    recall_interval: Interval | None
    false_alarms_per_vehicle_hour: float | None
    false_alarms_per_vehicle_hour_upper: float | None
    lead_time_s: LeadTimes
    lead_to_onset_s: LeadTimes
    commit_is: str | None = None


class CurvePoint(Settings):
    """The recall at a rate of false alarms, read from the curve of the measured seeds.

    false_alarms_per_vehicle_hour: the rate. measured: that of the thresholds with the highest recall at no more than
    this rate. threshold: those thresholds, as in `AlarmSettings`. by_intention: recall of each intention.
    """

    false_alarms_per_vehicle_hour: float
    measured: float | None
    threshold: float | dict[str, float] | None
    recall: float | None
    recall_interval: Interval | None
    recall_with_detection: float | None
    median_lead_s: float | None
    by_intention: dict[str, float | None]


class FrozenPoint(Settings):
    """The recall of alarms that were chosen on the development seeds for a rate of false alarms, and frozen.

    false_alarms_per_vehicle_hour: the rate. alarms: chosen for it. keeps_to_rate: whether they keep to it on the
    development seeds. measured: false alarms per vehicle-hour on the measured seeds. by_intention: recall of each
    intention. The interval does not cover what other development seeds would change.
    """

    false_alarms_per_vehicle_hour: float
    alarms: AlarmSettings
    keeps_to_rate: bool
    measured: float | None
    recall: float | None
    recall_interval: Interval | None
    recall_with_detection: float | None
    median_lead_s: float | None
    by_intention: dict[str, float | None]


class TimeToCommit(Settings):
    """Recall, if an alarm has to come at least this long before the commit, s."""

    time_to_commit_s: float
    recall: float | None


class GroupScores(Settings):
    """Scores of all six intentions together, and of each."""

    over_all: EventScores
    by_intention: dict[str, EventScores]


class AlarmResult(Settings):
    """The result of one predictor with one kind of alarm.

    name: of the predictor. alarms: settings chosen on the development seeds, and frozen. alarms_keep_to_rate: whether
    they keep to the desired rate of false alarms there; if no threshold does, they have the highest F1. over_all:
    scores of the six intentions together. macro_recall: mean recall of the intentions that have events.
    natural, reaction, commanded: events of that origin, with the time and the false alarms of vehicles that drove
    naturally, reacted to a cause, or were commanded at that time. recall_at: the curve of the measured seeds, at rates.
    frozen_at: alarms chosen on the development seeds for each of these rates, with a threshold that all intentions
    share, and with one for each. false_alarms_near: number of false alarms by what else happens to the vehicle:
    `event`: from 2 s before the onset of an event to its end, if the alarm is for another intention or not the first;
    `past_event`: up to 3 s after an event; `nothing`; empty in results of earlier versions. near_miss_alarms: number of
    alarms that are neutral because of a near miss; None in results of earlier versions. duty_cycle: share of the
    time in which a vehicle's answers reach a threshold.
    """

    name: str
    alarms: AlarmSettings | None
    alarms_keep_to_rate: bool | None
    over_all: EventScores
    macro_recall: float | None
    by_intention: dict[str, EventScores]
    natural: GroupScores
    reaction: GroupScores
    commanded: GroupScores
    recall_at: list[CurvePoint]
    frozen_at: dict[Sharing, list[FrozenPoint]] = Field(default_factory=dict)
    recall_by_time_to_commit: list[TimeToCommit]
    false_alarms_per_100_km: float | None
    false_alarms_near: dict[str, int] = Field(default_factory=dict)
    near_miss_alarms: int | None = None
    duty_cycle: float | None


class Coverage(Settings):
    """How much of the driving was predicted.

    share: of the driving time. uncovered: shares without predictions, by reason. vehicle_hours, km: with predictions.
    driving_hours: in total. `AloneResult` holds what a predictor of the TV alone adds.
    """

    share: float | None
    uncovered: dict[str, float]
    vehicle_hours: float
    driving_hours: float
    km: float


class Latency(Settings):
    """How far results look ahead, s.

    conditioning_reach_s: how far the symmetric kernel reaches that conditions motion; open loop, the world, the labels
    and the echoes all come from conditioned motion. closed_loop_s: by how much a closed loop trails the simulation,
    with the kernel cut off there, which drops a weight of 6e-5. report_delay_s: age of the UV's newest report.
    """

    conditioning_reach_s: float
    closed_loop_s: float
    report_delay_s: float


class LiveMadeBy(Settings):
    """The origin of a result: study, seeds, scenario, run and versions. against: the compared runs, by their names in
    the result; empty in results of earlier versions."""

    study: LiveStudy
    scenario: JsonValue
    development: list[str]
    seeds: list[str]
    run: RunCard
    against: dict[str, RunCard] = Field(default_factory=dict)
    versions: dict[str, str]


class RecallLost(Settings):
    """What sensing costs at a rate of false alarms: the recall on true motion minus that on sensed motion.

    false_alarms_per_vehicle_hour: the rate. truth, sensed: the recalls, each by the threshold of its own curve that
    has the highest recall at the rate. interval: of `lost`, which leaves the same seeds out of both; None with a single
    seed.
    """

    false_alarms_per_vehicle_hour: float
    truth: float
    sensed: float
    lost: float
    interval: Interval | None


class TruthResult(Settings):
    """The run on the true motion of the same TVs at the same instants, with alarms chosen for true motion.

    methods: both kinds of alarm. method: the kind that `lost` compares: the better one of the run on sensed motion.
    """

    methods: dict[str, AlarmResult]
    method: str | None
    lost: list[RecallLost]


class AloneResult(AlarmResult):
    """The result of a run that looks at the TV alone, for TVs without a UV.

    model: of that run. share: of all driving that it predicts, in addition to `Coverage.share`. vehicle_hours: with its
    predictions. events_left_out, methods, baselines: as in `TrafficResult`. run: its card.
    """

    model: str
    share: float | None
    vehicle_hours: float
    events_left_out: dict[str, int]
    methods: dict[str, AlarmResult]
    baselines: dict[str, AlarmResult]
    run: RunCard


class FiveClassResult(AlarmResult):
    """The scores with overtakes and the lane changes that they begin with as one intention.

    Overtakes count as left lane changes, or as right ones where traffic keeps left, in events and in alarms. The kind
    of alarm is the one that did better with six intentions; alarms are chosen anew on the development seeds.
    baselines: the rule of the road, trees on the situation, and the compared runs.
    """

    baselines: dict[str, AlarmResult]


class RateScores(Settings):
    """The scores of alarms that were chosen for a rate of false alarms; keeps_to_rate: as in `HeadlineResult`."""

    chosen_for: float
    recall: float | None
    false_alarms_per_vehicle_hour: float | None
    keeps_to_rate: bool | None


class BudgetScores(RateScores):
    """The scores of alarms for a single intention, which has the whole rate of false alarms for itself.

    recall_at_lead: as in `HeadlineResult`.
    """

    recall_interval: Interval | None
    recall_at_lead: dict[str, float | None]


class HeadlineScores(Settings):
    """The scores of one intention: events, the share that was named in time, and the median time from alarm to commit
    of these, s, negative after the commit. own_budget: of alarms for this intention alone, chosen for several rates;
    empty in results of earlier versions."""

    events: int
    recall: float | None
    lead_s: float | None
    false_alarms_per_vehicle_hour: float | None
    own_budget: list[BudgetScores] = Field(default_factory=list)


class NearMisses(Settings):
    """Number of motions just under a threshold, and of the alarms that are neutral because of them."""

    events: int
    alarms: int


class HeadlineResult(Settings):
    """What an operator asks of some intentions: which share is named in time, at how many false alarms.

    Overtakes and pull-outs with an open outcome are the lane changes that they begin with. Alarms are for these
    intentions alone, chosen on the development seeds, and frozen.
    by_commit_plus_s: how long after its commit an event is still named in time, s. chosen_for: false alarms per
    vehicle-hour that the alarms were chosen for. false_alarms_per_vehicle_hour: what they raise on the measured seeds.
    false_alarms_interval: of that, None with a single seed and in results of earlier versions. keeps_to_rate: whether
    that is within a factor of 1.5 of the former; None without any hour. lead_s, by_intention: as in `HeadlineScores`.
    recall_at_lead: share of events whose alarm came at least so many seconds before the commit. near_misses: of these
    intentions. at: alarms chosen for each rate.
    """

    by_commit_plus_s: float
    chosen_for: float
    alarms: AlarmSettings
    events: int
    recall: float | None
    recall_interval: Interval | None
    false_alarms_per_vehicle_hour: float | None
    false_alarms_interval: Interval | None = None
    keeps_to_rate: bool | None
    lead_s: float | None
    by_intention: dict[str, HeadlineScores]
    recall_at_lead: dict[str, float | None]
    near_misses: NearMisses
    at: list[RateScores]


class Headlines(Settings):
    """What a predictor answers to an operator's two questions, as in `TrafficResult`."""

    prediction: HeadlineResult | None
    recognition: HeadlineResult | None


class StressResult(Headlines):
    """The same questions in the stimulated world, on the same seeds: a stress test. vehicle_hours: with predictions.
    compared: as in `TrafficResult`."""

    vehicle_hours: float
    compared: dict[str, Headlines] = Field(default_factory=dict)


class TrafficResult(AlarmResult, WithOptionalParts):
    """The content of `metrics.json`, with the scores of the kind of alarm that did better on the development seeds.

    model: of the run. scenario: its name. vehicle_hours: with predictions. development_hours: of the seeds on which
    alarms were chosen; None in results of earlier versions. events_left_out: number of neutral events, by reason.
    methods: both kinds of alarm. baselines: other predictors on the same streams, and random alarms. truth:
    the run on true motion, with that setting. alone: another run for TVs without a UV, if one was given. five_classes:
    the same with five intentions; None in results of earlier versions, or if no vehicle was predicted.
    prediction: changes of lane and swerves by their commit. recognition: hard brakes and accelerations by half a second
    after it. Both are None in results of earlier versions, or if no alarm can be chosen. compared: the same questions
    asked of the baselines and, with that setting, of the run on true motion; empty in results of earlier versions.
    stress: both in the stimulated world; absent where that was not asked for.
    answers: what result parts of installed packages measured, by the part's name; absent where there are none.
    """

    optional_parts: ClassVar[frozenset[str]] = frozenset({"answers", "stress"})

    model: str
    scenario: str
    vehicle_hours: float
    development_hours: float | None = None
    coverage: Coverage
    latency: Latency
    events_left_out: dict[str, int]
    methods: dict[str, AlarmResult]
    baselines: dict[str, AlarmResult]
    truth: TruthResult | None = None
    alone: AloneResult | None = None
    five_classes: FiveClassResult | None = None
    prediction: HeadlineResult | None = None
    recognition: HeadlineResult | None = None
    compared: dict[str, Headlines] = Field(default_factory=dict)
    stress: StressResult | None = None
    answers: dict[str, JsonValue] | None = None
    made_by: LiveMadeBy
