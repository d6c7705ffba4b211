"""How the counts of each intention change when its definition does.

    python docs/label_sweep.py [RECORDING.npz ...]

Every threshold of the default preset is moved by -20 % and +20 %, one at a time. Without recordings the bundled
motorway is simulated. Prints a table in Markdown.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from isacsim.scenarios.scenario import load
from isacsim.settings import Settings
from isacsim.traffic.director import ManeuverSettings
from isacsim.traffic.recording import Recording
from isacsim.traffic.simulation import TrafficSettings, record
from labeling.detectors.settings import LabelSettings
from labeling.events import label
from labeling.intentions import Intention
from labeling.road.surroundings import Surroundings

SEEDS = (1, 2)
SHARE = 0.2
ORDER = tuple(Intention)


def counts(scenes: Sequence[tuple[Recording, Surroundings]], settings: LabelSettings) -> Counter[Intention]:
    """Events of each intention in all recordings."""
    return Counter(e.intention for recording, around in scenes for e in label(recording, settings, around).events)


def moved(settings: LabelSettings, section: str, name: str, factor: float) -> LabelSettings:
    """The settings with one value of one section multiplied; without a section, one of their own."""
    if not section:
        return settings.model_copy(update={name: getattr(settings, name) * factor})
    part: Settings = getattr(settings, section)
    return settings.model_copy(update={section: part.model_copy(update={name: getattr(part, name) * factor})})


def thresholds(settings: LabelSettings) -> Iterator[tuple[str, str, float]]:
    """Section, name and value of every number in the settings."""
    yield "", "width_s", settings.width_s
    for section in ("lane_change", "overtake", "hard_brake", "hard_accel", "evasive_swerve", "following"):
        for name, value in getattr(settings, section).model_dump().items():
            yield section, name, value


def table(recordings: Sequence[Recording]) -> str:
    """One line a threshold: the counts at -20 % and +20 %, where they differ from the default's."""
    scenes = [(recording, Surroundings(recording)) for recording in recordings]
    base = LabelSettings()
    default = counts(scenes, base)
    lines = [
        "| threshold | default | " + " | ".join(i.text for i in ORDER) + " |",
        "|" + " --- |" * (len(ORDER) + 2),
        "| (as defined) | | " + " | ".join(str(default[i]) for i in ORDER) + " |",
    ]
    for section, name, value in thresholds(base):
        low, high = (counts(scenes, moved(base, section, name, 1 + s)) for s in (-SHARE, SHARE))
        cells = [f"{low[i]} / {high[i]}" if {low[i], high[i]} != {default[i]} else "" for i in ORDER]
        lines.append(f"| {f'{section}.{name}'.lstrip('.')} | {value:g} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(paths: Sequence[str]) -> None:
    recordings = [Recording.load(Path(path)) for path in paths] or [
        record(load("motorway"), seed, TrafficSettings(), ManeuverSettings()) for seed in SEEDS
    ]
    print(table(recordings))


if __name__ == "__main__":
    main(sys.argv[1:])
