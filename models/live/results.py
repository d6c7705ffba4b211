"""What an evaluation in traffic measured, typed: the content of `metrics.json`.

A score is None (`null` in the file) where it is undefined, such as the recall of an intention without an event. All
times are in s. An event is predicted if its alarm came by its commit, detected if it came later, by its end.
"""

from __future__ import annotations

from pydantic import Field, JsonValue

from isacsim.settings import Settings
from models.live.settings import AlarmSettings, LiveStudy, Sharing
from models.run import RunCard

METRICS_FILE = "metrics.json"
COMMIT_IS = {
    "hard_brake": "threshold reached",
    "left_lane_change": "marking crossed",
    "right_lane_change": "marking crossed",
    "overtake": "marking crossed, pulling out",
    "hard_accel": "threshold reached",
    "evasive_swerve": "lateral peak",
}
"""What the commit is of each intention."""


class LeadTimes(Settings):
    """Median and quartiles of lead times, s; positive is an alarm before the instant. n: number of alarms."""

    n: int
    lower_quartile: float | None
    median: float | None
    upper_quartile: float | None


class Interval(Settings):
    """A t interval of the delete-one jackknife over seeds.

    seeds: their number; None in results of earlier versions, whose intervals are percentiles of a bootstrap.
    """

    low: float
    high: float
    seeds: int | None = None


class EventScores(Settings):
    """How the alarms for some events did.

    events: that count. predicted, detected: how many had their alarm by the commit, or later by their end. missed: the
    rest. false_alarms: alarms that belong to no event; a second alarm for an event is one of them. vehicle_hours: time
    for which vehicles were predicted.
    precision, recall, f1: of prediction; detections count as misses, and not as false alarms. recall_with_detection:
    the share of events that had an alarm at all. precision_with_detection: the share of alarms that belong to an event.
    recall_interval: None with a single seed. false_alarms_per_vehicle_hour_upper: 95 % confident bound (Poisson).
    lead_time_s: from alarm to commit, detections included. lead_to_onset_s: from alarm to onset.
    commit_is: what the commit is.
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
    """The share of events that had their alarm at least this long before the commit, s."""

    time_to_commit_s: float
    recall: float | None


class GroupScores(Settings):
    """Scores over all six intentions and by intention."""

    over_all: EventScores
    by_intention: dict[str, EventScores]


class AlarmResult(Settings):
    """What one predictor with one kind of alarm measured.

    name: of the predictor. alarms: chosen on the development seeds, and frozen. alarms_keep_to_rate: whether they keep
    to the wanted rate of false alarms there; if no threshold does, they have the highest F1. over_all: over the six
    intentions.
    natural, reaction, commanded: events of that origin, and the time and false alarms of vehicles that drove naturally,
    reacted to a cause, or were commanded then. recall_at: the curve read on the measured seeds themselves, at rates.
    frozen_at: alarms chosen on the development seeds for each of these rates, with a threshold that all intentions
    share, and with one for each. duty_cycle: share of the time in which a vehicle's answers reach a threshold.
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
    duty_cycle: float | None


class Coverage(Settings):
    """How much of the driving was predicted.

    share: of the time that vehicles drove. uncovered: shares without prediction, by reason. vehicle_hours, km: with
    prediction. driving_hours: in all. What a predictor of the TV alone adds is in `AloneResult`.
    """

    share: float | None
    uncovered: dict[str, float]
    vehicle_hours: float
    driving_hours: float
    km: float


class Latency(Settings):
    """How far results look ahead, s.

    conditioning_reach_s: motion is conditioned by a symmetric kernel that reaches so far; open loop, world, labels and
    echoes all come of that motion. closed_loop_s: how far a closed loop would trail the simulation if the kernel were
    cut off there, at a weight of 6e-5. report_delay_s: age of the newest report of the UV.
    """

    conditioning_reach_s: float
    closed_loop_s: float
    report_delay_s: float


class LiveMadeBy(Settings):
    """What made a result: study, seeds, scenario, run and versions."""

    study: LiveStudy
    scenario: JsonValue
    development: list[str]
    seeds: list[str]
    run: RunCard
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
    """The run on the true motion of the same TVs at the same instants, with alarms chosen for it.

    methods: both kinds of alarm. method: the kind that `lost` compares, the better one of the run on sensed motion.
    """

    methods: dict[str, AlarmResult]
    method: str | None
    lost: list[RecallLost]


class AloneResult(AlarmResult):
    """A run that looks at the TV alone, where a TV has no UV.

    model: of that run. share: of all driving that it predicts, beside `Coverage.share`. vehicle_hours: with its
    predictions. events_left_out, methods, baselines: as in `TrafficResult`. run: its card.
    """

    model: str
    share: float | None
    vehicle_hours: float
    events_left_out: dict[str, int]
    methods: dict[str, AlarmResult]
    baselines: dict[str, AlarmResult]
    run: RunCard


class TrafficResult(AlarmResult):
    """The content of `metrics.json`: the better of the run's two kinds of alarm, by the development seeds.

    model, scenario: of the run, and of the traffic. vehicle_hours: with prediction. events_left_out: neutral events, by
    reason. methods: both kinds of alarm. baselines: other predictors on the same streams, and random alarms. truth: the
    run on true motion, if that was asked for. alone: another run where TVs have no UV, if one was given.
    """

    model: str
    scenario: str
    vehicle_hours: float
    coverage: Coverage
    latency: Latency
    events_left_out: dict[str, int]
    methods: dict[str, AlarmResult]
    baselines: dict[str, AlarmResult]
    truth: TruthResult | None = None
    alone: AloneResult | None = None
    made_by: LiveMadeBy
