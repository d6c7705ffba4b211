"""What sway within the lane does to the labels: the events of the same natural traffic with sway and without.

    python -m isac_cosim.benchmarks.findings.driving.sway_events [SCENARIO] [--seeds N] [--duration S]

Sway is added to recorded states, so the traffic itself is the same. Two events are the same where vehicle and intention
are, and they commit at most a second apart. Prints a table in Markdown: events by intention, those that only one of the
two has, events per vehicle-hour that are there through sway alone, and how far sway moves the onsets of the others.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, field

import numpy as np

from isac_cosim.evaluation.in_traffic.scores.matching import match
from isac_cosim.evaluation.report.parts import markdown
from isac_cosim.isacsim.scenarios.scenario import Scenario, load
from isac_cosim.isacsim.traffic.drivers.settings import LEFT_ALONE, ManeuverSettings
from isac_cosim.isacsim.traffic.drivers.sway import SwaySettings, add_sway
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Event, Intention

SAME_WITHIN_S = 1.0
"""One event commits with sway and without at times that differ by at most this, s."""
STILL = SwaySettings(sd_m=(0.0, 0.0))


@dataclass
class Comparison:
    """Events of one intention. still, swaying: how many there are. shifts_s: of the onset, of those that both have."""

    still: int = 0
    swaying: int = 0
    shifts_s: list[float] = field(default_factory=list)


def compare(still: Sequence[Event], swaying: Sequence[Event], comparisons: dict[Intention, Comparison]) -> None:
    """Add the events of one recording to the comparisons. still, swaying: the events without sway and with it."""
    for vehicle, intention in sorted({(event.vehicle, event.intention) for event in (*still, *swaying)}):
        before, after = (
            sorted((e.commit, e.onset) for e in events if (e.vehicle, e.intention) == (vehicle, intention))
            for events in (still, swaying)
        )
        comparison = comparisons.setdefault(intention, Comparison())
        comparison.still += len(before)
        comparison.swaying += len(after)
        commits, others = (np.array([commit for commit, _ in times]) for times in (before, after))
        latest = commits + SAME_WITHIN_S
        partners = match(others, commits - SAME_WITHIN_S, latest, latest)
        comparison.shifts_s += [
            after[partner][1] - onset for (_, onset), partner in zip(before, partners, strict=True) if partner >= 0
        ]


def recordings(scenario: Scenario, seed: int, traffic: TrafficSettings) -> tuple[Recording, Recording]:
    """Return the same natural traffic without sway and with it."""
    still = record(scenario, seed, traffic.model_copy(update={"sway": STILL}), ManeuverSettings(**LEFT_ALONE))
    swaying = deepcopy(still)
    key = (scenario.name, seed)
    add_sway(swaying.tracks.values(), scenario.lanes, traffic.step_s, traffic.sway, scenario.lefthand, *key)
    return still, swaying


HEAD = (
    "intention", "without sway", "with sway", "only without", "only with", "per hour", "onset moves, s (5 to 95 %)"
)  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("scenario", nargs="?", default="motorway")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--duration", type=float, default=240.0)
    chosen = parser.parse_args(arguments)
    hours, comparisons = 0.0, dict[Intention, Comparison]()
    for seed in range(1, chosen.seeds + 1):
        traffic = TrafficSettings(duration_s=chosen.duration)
        still, swaying = recordings(load(chosen.scenario), seed, traffic)
        hours += sum(len(track) for track in still.tracks.values()) * still.step_s / 3600.0
        compare(label(still, LabelSettings()).events, label(swaying, LabelSettings()).events, comparisons)
    print(f"{chosen.scenario}, {hours:.1f} vehicle-hours\n")
    rows = [
        [intention.text.replace("_", " "), *cells(found, hours)] for intention, found in sorted(comparisons.items())
    ]
    print(markdown(HEAD, rows))


def cells(comparison: Comparison, hours: float) -> list[str]:
    """Return the cells of an intention's row. hours: of driving, all vehicles together."""
    both = len(comparison.shifts_s)
    added = comparison.swaying - both
    shifts = np.quantile(comparison.shifts_s, [0.05, 0.5, 0.95]) if both else np.full(3, np.nan)
    return [
        str(comparison.still),
        str(comparison.swaying),
        str(comparison.still - both),
        str(added),
        f"{added / hours:.2f}",
        f"{shifts[1]:.2f} ({shifts[0]:.2f} to {shifts[2]:.2f})",
    ]


if __name__ == "__main__":
    main()
