"""How often each event happens in the bundled scenarios, per vehicle-hour: drivers left alone, and with the director.

    python docs/scenario_rates.py [SCENARIO ...]

Three seeds each; the director at its default rates. Overtakes count where the vehicle ahead is overtaken.
Prints a table in Markdown for each scenario, whose name is its first cell.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence

from isac_cosim.evaluation.report.parts import markdown
from isac_cosim.isacsim.scenarios.scenario import bundled, load
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import KNOWN

SEEDS = (11, 12, 13)
HEAD = (
    *(intention.text.replace("_", " ") for intention in KNOWN),
    "vehicle-hours",
    "collided",
    "beyond a car",
)


def vehicle_hours(recording: Recording) -> float:
    """Return the time on the road of all vehicles that have a track, h."""
    return sum(len(track) for track in recording.tracks.values()) * recording.step_s / 3600.0


def row(where: str, maneuvers: ManeuverSettings) -> list[str]:
    """Return the cells of one scenario, over all seeds. Beyond a car: vehicles that ever moved as no car can."""
    hours, counts = 0.0, Counter[str]()
    for seed in SEEDS:
        recording = record(load(where), seed, TrafficSettings(), maneuvers)
        labels = label(recording, LabelSettings())
        hours += vehicle_hours(recording)
        counts.update(event.intention.text for event in labels.events)
        counts.update(collided=len(recording.incidents.collided), beyond_car=labels.counts["beyond_car"])
    stimulus = "none" if maneuvers.quiet else "default"
    rates = [f"{counts[intention.text] / hours:.1f}" for intention in KNOWN]
    return [stimulus, *rates, f"{hours:.1f}", str(counts["collided"]), str(counts["beyond_car"])]


def main(scenarios: Sequence[str]) -> None:
    default = ManeuverSettings()
    rates = (name for name in ManeuverSettings.model_fields if name.endswith("_hour"))
    none = default.model_copy(update=dict.fromkeys(rates, 0.0))
    for where in scenarios or sorted(bundled()):
        print(
            markdown((where, *HEAD), [row(where, maneuvers) for maneuvers in (none, default)]), end="\n\n", flush=True
        )


if __name__ == "__main__":
    main(sys.argv[1:])
