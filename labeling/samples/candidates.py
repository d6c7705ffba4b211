"""Which events become samples: the pair, the placement of the record, and what is left out for which reason."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from isac_cosim.base.seeding import stream
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.traffic.motion import Excess, MotionSettings, excess
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.detectors.events import Labels, Provenance, provenance
from isac_cosim.labeling.detectors.overtake import OvertakeDetector
from isac_cosim.labeling.intentions import Event, Intention, outward
from isac_cosim.labeling.road.surroundings import Relation, Surroundings
from isac_cosim.labeling.samples.pull_outs import PullOut, pull_out_of
from isac_cosim.labeling.samples.uv_choice import PairSettings, choose_uv, may_be_tv


class RecordSettings(Settings):
    """The piece of a TV-UV pair around an event that is stored."""

    duration_s: float = Field(5.0, gt=0.0, le=60.0, description="length of a record, s")
    before_onset_s: float = Field(2.6, ge=0.0, le=60.0, description="part of the record before onset, s")
    tv_rate_hz: float = Field(400.0, gt=0.0, le=10_000.0, description="sensing rate of the TV, Hz")
    uv_rate_hz: float = Field(100.0, gt=0.0, le=10_000.0, description="reporting rate of the UV, Hz")
    jitter_s: float = Field(0.2, ge=0.0, le=10.0, description="maximum random shift of the record, either way, s")
    margin_s: float = Field(
        0.8,
        ge=0.0,
        le=5.0,
        description="both tracks extend beyond the record by this, for the conditioning kernel, s",
    )
    alone_before_s: float = Field(
        0.5, ge=0.0, le=30.0, description="no other event of the TV from this long before onset, s"
    )
    alone_after_s: float = Field(
        2.4,
        ge=0.0,
        le=30.0,
        description="no other event of the TV until this long after, s, or until the record ends if that is later",
    )
    across_mps2: float | None = Field(
        4.0,
        gt=0.0,
        le=12.0,
        description="most that the TV or the UV accelerates across its direction of travel outside a swerve, m/s2; "
        "null: no limit",
    )
    along_mps2: float | None = Field(
        0.5,
        gt=0.0,
        le=9.0,
        description="most that the acceleration of the TV or the UV along the road, in the plane, differs from that of "
        "the recorded speed, which the labels are about, m/s2; null: no limit",
    )

    @model_validator(mode="after")
    def _holds_onset(self) -> Self:
        if self.before_onset_s - self.jitter_s < 0 or self.before_onset_s + self.jitter_s > self.duration_s:
            raise ValueError(
                f"the onset, {self.before_onset_s:g} s into a record of {self.duration_s:g} s, can fall outside it with"
                f" a shift of {self.jitter_s:g} s; lower jitter_s"
            )
        return self


@dataclass(frozen=True)
class Candidate:
    """A sample before it is sensed: the pair, the label, and the times of the event, s of simulation time.

    t_start: start of the record. relation: where the UV was, seen from the TV, when it was chosen. pull_out: whether
    and when the TV passes the UV, if it pulls out behind it.
    """

    tv: str
    uv: str
    intention: Intention
    provenance: Provenance
    t_start: float
    t_onset: float
    t_commit: float
    t_end: float
    relation: Relation
    pull_out: PullOut | None = None


@dataclass(frozen=True)
class Candidates:
    """The samples that a recording offers, by onset, and the number of events that were left out, by reason.

    Reasons: `tv_kind`, `in_another_block` (the vehicle is a bystander), `no_uv`, `ambiguous`,
    `commit_outside_record` (the record ends before the maneuver is decided),
    `tv_outside_track`, `uv_outside_track`, `jump` (a lateral step within the record that is not motion of a vehicle),
    `beyond_car` (the TV or the UV accelerates in the plane as no car can), `beyond_driver` (one of them accelerates
    across its direction of travel by more than `RecordSettings.across_mps2` outside a swerve: the road is too sharp for
    its speed), `along` (one of them accelerates along the road, in the plane, otherwise than its recorded speed does,
    by more than `RecordSettings.along_mps2`), and the marks of events, such as `passed_did_not_return` and
    `unresolved`.

    dropped_pull_outs: pull-outs that are in no class, but answer whether the TV passes the UV; they are among those
    that are left out. Their intention is that of the lane change.
    """

    samples: tuple[Candidate, ...]
    left_out: dict[str, int]
    dropped_pull_outs: tuple[Candidate, ...] = ()


def candidates(
    recording: Recording,
    labels: Labels,
    pairs: PairSettings,
    record: RecordSettings,
    surroundings: Surroundings | None = None,
    motion: MotionSettings | None = None,
) -> Candidates:
    """Return the candidate samples of a recording.

    surroundings: of the recording, if already at hand. motion: how the states of the records are conditioned. When
    absent, motion in the plane is not looked at, and no event is left out as `beyond_car`.
    """
    surroundings = Surroundings(recording) if surroundings is None else surroundings
    swerves = labels.of(Intention.EVASIVE_SWERVE)
    plane = None if motion is None else PlaneLimits(recording, swerves, motion, record.across_mps2, record.along_mps2)
    by_vehicle: dict[str, list[Event]] = {}
    for event in labels.events:
        by_vehicle.setdefault(event.vehicle, []).append(event)
    samples: list[Candidate] = []
    dropped: list[Candidate] = []
    left_out: Counter[str] = Counter()
    for event in labels.events:
        candidate = _candidate(surroundings, labels, event, by_vehicle[event.vehicle], pairs, record, plane)
        if not isinstance(candidate, Candidate):
            left_out[candidate] += 1
        elif candidate.pull_out is not None and candidate.pull_out.dropped:
            left_out[candidate.pull_out.outcome] += 1
            dropped.append(candidate)
        else:
            samples.append(candidate)
    return Candidates(tuple(samples), dict(sorted(left_out.items())), tuple(dropped))


SWERVE_MARGIN_S = 0.5
"""A vehicle still accelerates across this long before the onset and after the end of a swerve, s."""


class PlaneLimits:
    """When the vehicles of a recording exceed limits in the plane; worked out once for each vehicle.

    swerves: the events in which vehicles may exceed across_mps2. across_mps2, along_mps2: as in `RecordSettings`; a
    limit that is None does not apply.
    """

    def __init__(
        self,
        recording: Recording,
        swerves: Iterable[Event],
        motion: MotionSettings,
        across_mps2: float | None,
        along_mps2: float | None,
    ) -> None:
        self._recording = recording
        self._motion = motion
        self._limits = across_mps2, along_mps2
        self._swerves: dict[str, list[tuple[float, float]]] = {}
        for swerve in swerves:
            span = (swerve.onset - SWERVE_MARGIN_S, swerve.end + SWERVE_MARGIN_S)
            self._swerves.setdefault(swerve.vehicle, []).append(span)
        self._times: dict[str, Excess] = {}

    def exceeded(self, vehicle: str, start: float, end: float) -> str | None:
        """Return the reason why a vehicle's motion between two times, s, is not used; None if there is none."""
        if vehicle not in self._times:
            times = excess(self._recording, self._recording.tracks[vehicle], self._motion, *self._limits)
            swerving = np.zeros(len(times.across), bool)
            for onset, last in self._swerves.get(vehicle, ()):
                swerving |= (times.across >= onset) & (times.across <= last)
            self._times[vehicle] = replace(times, across=times.across[~swerving])
        times = self._times[vehicle]
        for reason, at in (("beyond_car", times.beyond_car), ("beyond_driver", times.across), ("along", times.along)):
            if ((at >= start) & (at <= end)).any():
                return reason
        return None


def _candidate(
    surroundings: Surroundings,
    labels: Labels,
    event: Event,
    vehicle_events: Sequence[Event],
    pairs: PairSettings,
    record: RecordSettings,
    plane: PlaneLimits | None,
) -> Candidate | str:
    """Return the sample of an event, which may be a dropped pull-out, or the reason why there is none."""
    recording = surroundings.recording
    if recording.tracks[event.vehicle].bystander:
        return "in_another_block"
    if not may_be_tv(recording.tracks[event.vehicle], pairs):
        return "tv_kind"
    if ambiguous(event, vehicle_events, record):
        return "ambiguous"
    start = record_start(recording, event, record)
    if not start <= event.commit <= start + record.duration_s:
        return "commit_outside_record"
    span = (start - record.margin_s, start + record.duration_s + record.margin_s)
    if not surroundings.has(event.vehicle, *span):
        return "tv_outside_track"
    if event.intention is Intention.FOLLOWING and not _follows_throughout(
        surroundings, labels, event, start, pairs, record
    ):
        return "ambiguous"
    pair = choose_uv(surroundings, event.vehicle, event.onset, pairs)
    if pair is None:
        return "no_uv"
    if not surroundings.has(pair.uv, *span):
        return "uv_outside_track"
    if any(span[0] <= t <= span[1] for vehicle in (event.vehicle, pair.uv) for t in labels.jumps.get(vehicle, ())):
        return "jump"
    event = for_pair(surroundings, labels, event, pair.uv)
    pull_out = pull_out_of(surroundings, event, pair.uv)
    if event.mark is not None and pull_out is None:
        return event.mark
    for vehicle in (event.vehicle, pair.uv):
        reason = None if plane is None else plane.exceeded(vehicle, start, start + record.duration_s)
        if reason is not None:
            return event.mark or reason
    return Candidate(
        tv=event.vehicle,
        uv=pair.uv,
        intention=event.intention,
        provenance=provenance(recording, event),
        t_start=start,
        t_onset=event.onset,
        t_commit=event.commit,
        t_end=start + record.duration_s if event.intention is Intention.FOLLOWING else event.end,
        relation=pair.relation,
        pull_out=pull_out,
    )


def _follows_throughout(
    surroundings: Surroundings,
    labels: Labels,
    event: Event,
    start: float,
    pairs: PairSettings,
    record: RecordSettings,
) -> bool:
    """Return whether a vehicle has the same leader in all of the record of its following.

    The detector has made sure of that for a record of the usual length; only what lies beyond is looked at.
    """
    following = labels.settings.following
    end = start + record.duration_s
    beyond = [
        *np.arange(start, event.onset - following.before_s - record.jitter_s, following.check_s),
        *np.arange(end, event.onset + following.after_s + record.jitter_s, -following.check_s),
    ]
    leaders = (surroundings.leader(event.vehicle, float(time), pairs.range_m) for time in beyond)
    return all(leader is not None and leader.vehicle == event.other for leader in leaders)


def for_pair(surroundings: Surroundings, labels: Labels, event: Event, uv: str) -> Event:
    """Return an event as what it is for a UV: a change to the faster side may overtake one vehicle and not another.

    Where a selected detector replaces one of the two, its overtake of another vehicle than the UV is a lane change to
    the faster side and every other event stays what it is (see `labeling.detectors.protocol.Detector`).
    """
    change_out = outward(surroundings.recording.lefthand)
    pulling_out = (change_out, Intention.OVERTAKE)
    if event.intention not in pulling_out:
        return event
    if labels.settings.replaced.isdisjoint(pulling_out):
        changes = labels.changes[event.vehicle]
        change = next(change for change in changes if change.commit == event.commit)
        overtake = OvertakeDetector(labels.settings.overtake)
        return overtake.judged(change, uv, overtake.outcome(surroundings, changes, change, uv))
    if event.intention is Intention.OVERTAKE and event.other not in (None, uv):
        return replace(event, intention=change_out, end=event.busy_until, other=None, motion_end=None)
    return event


def ambiguous(event: Event, vehicle_events: Sequence[Event], record: RecordSettings) -> bool:
    """Return whether another event of the same vehicle is under way from shortly before onset to the record's end.

    An event is under way from its onset to the end of its motion; an overtake only while it pulls out.
    """
    after_s = max(record.alone_after_s, record.duration_s - record.before_onset_s)
    start, end = event.onset - record.alone_before_s, event.onset + after_s
    return any(other is not event and other.onset <= end and other.busy_until >= start for other in vehicle_events)


def record_start(recording: Recording, event: Event, record: RecordSettings) -> float:
    """Return when the record of an event starts, s, a whole millisecond. The shift is independent of the class."""
    draw = stream("jitter", recording.scenario, recording.seed, event.vehicle, round(event.onset * 1000)).uniform(-1, 1)
    return round(event.onset - record.before_onset_s + record.jitter_s * float(draw), 3)
