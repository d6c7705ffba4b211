"""Which events become samples: the pair, the place of the record, and what is left out and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from pydantic import Field, model_validator

from isacsim.seeding import stream
from isacsim.settings import Settings
from isacsim.traffic.recording import Recording
from labeling.detectors.overtake import Overtake
from labeling.events import Labels, Origin, origin
from labeling.intentions import PULLING_OUT, Event, Intention
from labeling.road.surroundings import Relation, Surroundings
from labeling.samples.uv_choice import PairSettings, choose_uv, may_be_tv


class RecordSettings(Settings):
    """The piece of a TV-UV pair around an event that is stored."""

    duration_s: float = Field(5.0, gt=0.0, le=60.0, description="length of a record, s")
    before_onset_s: float = Field(2.6, ge=0.0, le=60.0, description="of it before onset, s")
    tv_rate_hz: float = Field(400.0, gt=0.0, le=10_000.0, description="sensing rate of the TV, Hz")
    uv_rate_hz: float = Field(100.0, gt=0.0, le=10_000.0, description="reporting rate of the UV, Hz")
    jitter_s: float = Field(0.2, ge=0.0, le=10.0, description="the record is shifted by up to this, either way, s")
    margin_s: float = Field(
        0.8, ge=0.0, le=5.0, description="both tracks reach beyond the record by this, s: conditioning looks around"
    )
    alone_before_s: float = Field(
        0.5, ge=0.0, le=30.0, description="no other event of the TV from this before onset, s"
    )
    alone_after_s: float = Field(2.4, ge=0.0, le=30.0, description="to this after it, s")

    @model_validator(mode="after")
    def _holds_onset(self) -> Self:
        if self.before_onset_s - self.jitter_s < 0 or self.before_onset_s + self.jitter_s > self.duration_s:
            raise ValueError(
                f"onset, {self.before_onset_s:g} s into the record, jittered by {self.jitter_s:g} s, can fall outside"
                f" its {self.duration_s:g} s; lower jitter_s"
            )
        return self


@dataclass(frozen=True)
class Candidate:
    """A sample before it is sensed: the pair, its label, and when the record starts, s of simulation time.

    relation: where the UV was, seen from the TV, when it was chosen.
    """

    tv: str
    uv: str
    intention: Intention
    origin: Origin
    t_start: float
    t_onset: float
    t_commit: float
    t_end: float
    relation: Relation


@dataclass(frozen=True)
class Candidates:
    """The samples that a recording offers, by onset, and how many events were left out, by reason.

    Reasons: `tv_kind`, `no_uv`, `ambiguous`, `passed_did_not_return`, `unresolved`, `tv_outside_track`,
    `uv_outside_track`, `jump` (a lateral step within the record that is no motion of a vehicle).
    """

    samples: tuple[Candidate, ...]
    left_out: dict[str, int]


def candidates(
    recording: Recording,
    labels: Labels,
    pairs: PairSettings,
    record: RecordSettings,
    around: Surroundings | None = None,
) -> Candidates:
    """The samples of a recording. around: its surroundings, where the caller has them already."""
    around = Surroundings(recording) if around is None else around
    of_vehicle: dict[str, list[Event]] = {}
    for event in labels.events:
        of_vehicle.setdefault(event.vehicle, []).append(event)
    samples: list[Candidate] = []
    left_out: Counter[str] = Counter()
    for event in labels.events:
        found = _candidate(around, labels, event, of_vehicle[event.vehicle], pairs, record)
        if isinstance(found, Candidate):
            samples.append(found)
        else:
            left_out[found] += 1
    return Candidates(tuple(samples), dict(sorted(left_out.items())))


def _candidate(
    around: Surroundings,
    labels: Labels,
    event: Event,
    own_events: Sequence[Event],
    pairs: PairSettings,
    record: RecordSettings,
) -> Candidate | str:
    """The sample of an event, or why there is none."""
    recording = around.recording
    if not may_be_tv(recording.tracks[event.vehicle], pairs):
        return "tv_kind"
    if ambiguous(event, own_events, record):
        return "ambiguous"
    start = record_start(recording, event, record)
    span = (start - record.margin_s, start + record.duration_s + record.margin_s)
    if not around.has(event.vehicle, *span):
        return "tv_outside_track"
    pair = choose_uv(around, event.vehicle, event.onset, pairs)
    if pair is None:
        return "no_uv"
    if not around.has(pair.uv, *span):
        return "uv_outside_track"
    if any(span[0] <= t <= span[1] for vehicle in (event.vehicle, pair.uv) for t in labels.jumps.get(vehicle, ())):
        return "jump"
    if event.intention in PULLING_OUT:
        event = _for_pair(around, labels, event, pair.uv)
        if event.mark is not None:
            return event.mark
    return Candidate(
        tv=event.vehicle,
        uv=pair.uv,
        intention=event.intention,
        origin=origin(recording, event),
        t_start=start,
        t_onset=event.onset,
        t_commit=event.commit,
        t_end=start + record.duration_s if event.intention is Intention.FOLLOWING else event.end,
        relation=pair.relation,
    )


def _for_pair(around: Surroundings, labels: Labels, event: Event, uv: str) -> Event:
    """A left change as what it was for this UV."""
    changes = labels.changes[event.vehicle]
    change = next(c for c in changes if c.commit == event.commit)
    overtake = Overtake(labels.settings.overtake)
    return overtake.judged(change, uv, overtake.outcome(around, changes, change, uv))


def ambiguous(event: Event, own_events: Sequence[Event], record: RecordSettings) -> bool:
    """Whether another event of the same vehicle is under way between shortly before onset and the record's end.

    Under way is from an event's onset to the end of its motion; an overtake's only while it pulls out.
    """
    start, end = event.onset - record.alone_before_s, event.onset + record.alone_after_s
    return any(other is not event and other.onset <= end and other.busy_until >= start for other in own_events)


def record_start(recording: Recording, event: Event, record: RecordSettings) -> float:
    """When the record of an event starts, s, a whole millisecond. The jitter does not depend on the class."""
    draw = stream("jitter", recording.scenario, recording.seed, event.vehicle, round(event.onset * 1000)).uniform(-1, 1)
    return round(event.onset - record.before_onset_s + record.jitter_s * float(draw), 3)
