"""Print how the number of events of each intention changes with its definition.

    python docs/label_sweep.py

Every threshold of the default preset is changed by -20 % and +20 %, one at a time, on two recordings of the bundled
motorway. Prints a table in Markdown.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from isac_cosim.base.settings import Settings
from isac_cosim.evaluation.report.parts import markdown
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Intention, spoken
from isac_cosim.labeling.road.surroundings import Surroundings

SEEDS = (1, 2)
SHARE = 0.2
ORDER = tuple(Intention)


def counts(scenes: Sequence[tuple[Recording, Surroundings]], settings: LabelSettings) -> Counter[Intention]:
    """Return the number of events of each intention in all recordings."""
    return Counter(
        event.intention
        for recording, surroundings in scenes
        for event in label(recording, settings, surroundings).events
    )


def changed(settings: LabelSettings, section: str, name: str, factor: float) -> LabelSettings:
    """Return the settings with one value of a section multiplied; of the settings themselves if section is empty."""
    if not section:
        return settings.model_copy(update={name: getattr(settings, name) * factor})
    values: Settings = getattr(settings, section)
    return settings.model_copy(update={section: values.model_copy(update={name: getattr(values, name) * factor})})


def thresholds(settings: LabelSettings) -> Iterator[tuple[str, str, float]]:
    """Yield section, name and value of every threshold in the settings: of all that are numbers."""
    yield "", "width_s", settings.width_s
    for section in settings.active_detectors():
        for name, value in getattr(settings, section).model_dump().items():
            if isinstance(value, float | int) and not isinstance(value, bool):
                yield section, name, value


def table(recordings: Sequence[Recording]) -> str:
    """Return one line for each threshold: the counts at -20 % and +20 %, where they differ from the default ones."""
    scenes = [(recording, Surroundings(recording)) for recording in recordings]
    base = LabelSettings()
    default = counts(scenes, base)
    rows = [["(as defined)", "", *(str(default[i]) for i in ORDER)]]
    for section, name, value in thresholds(base):
        low, high = (counts(scenes, changed(base, section, name, 1 + s)) for s in (-SHARE, SHARE))
        cells = [f"{low[i]} / {high[i]}" if {low[i], high[i]} != {default[i]} else "" for i in ORDER]
        rows.append([f"`{section}.{name}`".replace("`.", "`"), f"{value:g}", *cells])
    return markdown(["threshold", "default", *(spoken(i.text) for i in ORDER)], rows)


def main() -> None:
    print(table([record(load("motorway"), seed, TrafficSettings(), ManeuverSettings()) for seed in SEEDS]))


if __name__ == "__main__":
    main()
