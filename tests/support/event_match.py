"""Which events of one recording another has, whatever the two were recorded with."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from isac_cosim.labeling.detectors.events import Labels
from isac_cosim.labeling.intentions import Event, Intention


@dataclass
class Found:
    """Of one intention: events, those found again, others, and how far onset and commit are apart in the median, s."""

    events: int = 0
    matched: int = 0
    surplus: int = 0
    onset_s: list[float] = field(default_factory=list)
    commit_s: list[float] = field(default_factory=list)

    @property
    def medians_s(self) -> tuple[float, float]:
        """The median differences of onset and of commit, s."""
        return float(np.median(self.onset_s or [0.0])), float(np.median(self.commit_s or [0.0]))


def found_events(labels: Labels, others: Labels) -> dict[str, Found]:
    """Match events of the same vehicle and intention that overlap in time; `following` is no maneuver."""
    left: dict[tuple[str, Intention], list[Event]] = defaultdict(list)
    for event in others.events:
        left[event.vehicle, event.intention].append(event)
    found: dict[str, Found] = defaultdict(Found)
    for event in labels.events:
        if event.intention is Intention.FOLLOWING:
            continue
        of = found[event.intention.text]
        of.events += 1
        same = [
            other
            for other in left[event.vehicle, event.intention]
            if other.onset <= event.busy_until and other.busy_until >= event.onset
        ]
        if same:
            other = min(same, key=lambda candidate: abs(candidate.commit - event.commit))
            left[event.vehicle, event.intention].remove(other)
            of.matched += 1
            of.onset_s.append(abs(other.onset - event.onset))
            of.commit_s.append(abs(other.commit - event.commit))
    for (_, intention), events in left.items():
        if events and intention is not Intention.FOLLOWING:
            found[intention.text].surplus += len(events)
    return dict(found)
