"""Samples whose labels come from the motion source, and how far the detectors agree with them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from isac_cosim.isacsim.traffic.motion import MotionSettings
from isac_cosim.isacsim.traffic.recordings.recording import GeneratedManeuver, LabelledRecording
from isac_cosim.labeling.detectors.events import Labels, Provenance
from isac_cosim.labeling.detectors.following import FollowingSettings
from isac_cosim.labeling.intentions import Event, Intention
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.samples.candidates import Candidate, Candidates, PlaneLimits, RecordSettings, record_start

UNDETECTED = "nothing"
"""What the detectors say where they find no event."""
SLACK_S = 0.5
"""A detected event belongs to a maneuver where the two overlap, or come this close, s."""
PREFIX = "generated"


def generated_candidates(
    recording: LabelledRecording, record: RecordSettings, motion: MotionSettings, surroundings: Surroundings
) -> Candidates:
    """Return one candidate for each generated maneuver, with the label, the pair and the times of its source.

    Left out are records that extend beyond a track (`tv_outside_track`, `uv_outside_track`), and those in which a
    vehicle moves as no car can (`beyond_car`).
    """
    limits = PlaneLimits(recording, (), motion, None, None)
    samples: list[Candidate] = []
    left_out: Counter[str] = Counter()
    for maneuver in recording.maneuvers:
        event = _event_of(maneuver)
        start = record_start(recording, event, record)
        end = start + record.duration_s
        span = (start - record.margin_s, end + record.margin_s)
        if not surroundings.has(maneuver.tv, *span):
            left_out["tv_outside_track"] += 1
        elif not surroundings.has(maneuver.uv, *span):
            left_out["uv_outside_track"] += 1
        elif any(limits.exceeded(vehicle, start, end) for vehicle in (maneuver.tv, maneuver.uv)):
            left_out["beyond_car"] += 1
        else:
            samples.append(_candidate(maneuver, event, start, end))
    return Candidates(tuple(samples), dict(sorted(left_out.items())))


def _event_of(maneuver: GeneratedManeuver) -> Event:
    intention = Intention[maneuver.intention.upper()]
    return Event(maneuver.tv, intention, maneuver.onset, maneuver.commit, maneuver.end, 0.0, maneuver.uv)


def _candidate(maneuver: GeneratedManeuver, event: Event, start: float, end: float) -> Candidate:
    """Return the sample of a maneuver. start, end: of its record, s."""
    following = event.intention is Intention.FOLLOWING
    return Candidate(
        tv=maneuver.tv,
        uv=maneuver.uv,
        intention=event.intention,
        provenance=_provenance(maneuver),
        t_start=start,
        t_onset=event.onset,
        t_commit=event.commit,
        t_end=end if following else event.end,
        relation="ahead",
    )


def _provenance(maneuver: GeneratedManeuver) -> Provenance:
    """Return a reaction for a maneuver with a cause; otherwise, following is natural and all else commanded."""
    if maneuver.cause:
        return Provenance("reaction", maneuver.cause)
    return Provenance("natural" if maneuver.intention == Intention.FOLLOWING.text else "commanded")


def detected_as(maneuver: GeneratedManeuver, events: Sequence[Event]) -> str:
    """Return what the detectors make of a generated maneuver: an intention, the mark of an event, or `nothing`.

    events: those of the TV. If several belong to the maneuver, the generated intention counts where it is among them;
    otherwise, the event whose commit is closest.
    """
    near = [event for event in events if _belongs(event, maneuver)]
    if maneuver.intention == Intention.FOLLOWING.text:
        # Following is where nothing else happens: another event during the record contradicts it.
        near = [event for event in near if event.intention is not Intention.FOLLOWING] or near
    verdicts = {event: event.intention.text if event.mark is None else event.mark for event in near}
    if maneuver.intention in verdicts.values():
        return maneuver.intention
    closest = min(near, key=lambda event: abs(event.commit - maneuver.commit), default=None)
    return UNDETECTED if closest is None else verdicts[closest]


def _belongs(event: Event, maneuver: GeneratedManeuver) -> bool:
    if event.intention is Intention.FOLLOWING or maneuver.intention == Intention.FOLLOWING.text:
        settings = FollowingSettings()
        return -settings.after_s <= event.onset - maneuver.onset <= settings.before_s
    return event.onset <= maneuver.commit + SLACK_S and event.busy_until >= maneuver.onset - SLACK_S


def agreement_counts(recording: LabelledRecording, labels: Labels) -> dict[str, int]:
    """Return how often each intention was generated and what the detectors made of it.

    Keys: `generated <intention> detected <verdict>`, as `agreement` reads them.
    """
    by_vehicle: dict[str, list[Event]] = {}
    for event in labels.events:
        by_vehicle.setdefault(event.vehicle, []).append(event)
    verdicts = ((m.intention, detected_as(m, by_vehicle.get(m.tv, []))) for m in recording.maneuvers)
    return dict(Counter(f"{PREFIX} {intention} detected {verdict}" for intention, verdict in verdicts))


def other_counts(counts: Mapping[str, int]) -> dict[str, int]:
    """Return the counts without those of `agreement_counts`."""
    return {key: number for key, number in counts.items() if not key.startswith(f"{PREFIX} ")}


def agreement(counts: Mapping[str, int]) -> dict[str, dict[str, int]]:
    """Return the counts of `agreement_counts` among others as a table: generated intention, verdict, number."""
    table: dict[str, dict[str, int]] = {}
    for intention in Intention:
        prefix = f"{PREFIX} {intention.text} detected "
        row = {key.removeprefix(prefix): number for key, number in counts.items() if key.startswith(prefix)}
        if row:
            table[intention.text] = dict(sorted(row.items(), key=lambda item: (-item[1], item[0])))
    return table
