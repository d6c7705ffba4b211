"""Natural events of a demand with its own vehicle types, and with our drivers in their place.

    python -m isac_cosim.benchmarks.findings.driving.drivers_of_others SCENARIO [--drivers ours|theirs ...] [--seeds N]
        [--first SEED] [--duration S]

Simulates drivers that are left alone. Prints a table in Markdown: how often they brake and accelerate hard, how hard,
and how long their lane changes last, as median (5 %, 95 %) over all seeds.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

import numpy as np

from isac_cosim.base.settings import checked
from isac_cosim.evaluation.report.parts import markdown
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import LEFT_ALONE, ManeuverSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Event, Intention

AVERAGED_S = 0.21
"""Accelerations are means over this time, s."""
BRAKES, ACCELERATIONS, CHANGES = "hard brakes", "hard accelerations", "lane changes"
WORDS = {
    BRAKES: "their peak, median (5 %, 95 %), m/s²",
    ACCELERATIONS: "their peak, m/s²",
    CHANGES: "their duration, s",
}
"""What is counted, and what is measured of it."""


def peak_mps2(recording: Recording, event: Event) -> float:
    """Return the largest change of a vehicle's speed in SUMO during an event, m/s2, as a magnitude."""
    track = recording.tracks[event.vehicle]
    times = recording.times(track)
    speed = track.speed[(times >= event.onset) & (times <= event.end)]
    apart = min(round(AVERAGED_S / recording.step_s), len(speed) - 1)
    sign = -1.0 if event.intention is Intention.HARD_BRAKE else 1.0
    return float((sign * (speed[apart:] - speed[:-apart])).max() / (apart * recording.step_s))


def measured(recording: Recording) -> dict[str, list[float]]:
    """Return the values of all events of a recording, by what is counted."""
    labels = label(recording, LabelSettings())
    return {
        BRAKES: [peak_mps2(recording, event) for event in labels.of(Intention.HARD_BRAKE)],
        ACCELERATIONS: [peak_mps2(recording, event) for event in labels.of(Intention.HARD_ACCEL)],
        CHANGES: [change.end - change.onset for changes in labels.changes.values() for change in changes],
    }


def spread(values: Sequence[float], digits: int) -> str:
    """Return the median of some values with their 5 % and 95 % quantiles; a dash where there are none."""
    if not len(values):
        return "-"
    low, median, high = (f"{value:.{digits}f}" for value in np.quantile(values, (0.05, 0.5, 0.95)))
    return f"{median} ({low}, {high})"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("scenario")
    parser.add_argument("--drivers", nargs="+", choices=("theirs", "ours"), default=["theirs", "ours"])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--duration", type=float, default=180.0)
    chosen = parser.parse_args(arguments)
    scenario, columns, hours = load(chosen.scenario), dict[str, dict[str, list[float]]](), dict[str, float]()
    for drivers in chosen.drivers:
        content: dict[str, Any] = {"duration_s": chosen.duration, "drivers": drivers}
        traffic = checked(TrafficSettings, content, "--duration")
        values: dict[str, list[float]] = {name: [] for name in WORDS}
        hours[drivers] = 0.0
        for seed in range(chosen.first, chosen.first + chosen.seeds):
            recording = record(scenario, seed, traffic, ManeuverSettings(**LEFT_ALONE))
            hours[drivers] += sum(len(track) for track in recording.tracks.values()) * recording.step_s / 3600.0
            for name, found in measured(recording).items():
                values[name] += found
        columns[drivers] = values
    rows = [["vehicle-hours", *(f"{hours[drivers]:.1f}" for drivers in columns)]]
    for name, words in WORDS.items():
        digits = 1 if name == CHANGES else 2
        rows.append([name, *(str(len(of[name])) for of in columns.values())])
        rows.append([words, *(spread(of[name], digits) for of in columns.values())])
    print(markdown(["", *columns], rows))


if __name__ == "__main__":
    main()
