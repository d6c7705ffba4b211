"""What tracks of 14 s and 420 m, as highD has them, cost the labels: events of a recording, and of the same cut short.

    python -m isac_cosim.benchmarks.findings.trajectories.short_tracks [--duration S]

The bundled straight road is cut into stretches of 420 m, and tracks in each of them to 14 s. An event of the whole
recording is judged again where the short one has an event of the same vehicle whose commit is at most 0.5 s away and
which is no unresolved one. Prints a table in Markdown: by intention, the events, the share that is judged again, and
the share of these that has the same intention, for each way in which pull-outs are judged.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import pairwise

import numpy as np

from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.recordings.recording import COLUMNS, Recording, Track
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.intentions import KNOWN, Event, Intention

SCENARIO = "straight_road"
STRETCH_M, LONGEST_S = 420.0, 14.0
WITHIN_S = 0.5
PRESETS = ("isac-2", "isac-2-as-seen", "isac-2-one-change")


def cut(recording: Recording) -> Recording:
    """Return a recording of which each vehicle is seen for 420 m and 14 s at a time, under a name of its own."""
    longest = round(LONGEST_S / recording.step_s)
    tracks: dict[str, Track] = {}
    for name, track in recording.tracks.items():
        stretch = np.floor_divide(track.x, STRETCH_M)
        edges = [0, *(np.flatnonzero(np.diff(stretch) != 0) + 1).tolist(), len(track)]
        starts = [k for a, b in pairwise(edges) for k in range(a, b, longest)]
        for number, (a, b) in enumerate(zip(starts, [*starts[1:], len(track)], strict=True)):
            rows = {column: getattr(track, column)[a:b] for column in COLUMNS}
            tracks[f"{name}#{number}"] = replace(
                track, vehicle=f"{name}#{number}", first_step=track.first_step + a, onward=None, **rows
            )
    return replace(recording, tracks=tracks)


def events_of(recording: Recording, preset: str) -> list[Event]:
    """Return the events that are judged."""
    labels = label(recording, LabelSettings.model_validate({"preset": preset}))
    return [event for event in labels.events if event.intention in KNOWN and event.mark is None]


def _shares(events: int, judged: int, alike: int) -> str:
    """Return a cell: the events, the share that is judged again, and the share of these with the same intention."""
    shares = [f"{part / whole:.0%}" for part, whole in ((judged, events), (alike, judged)) if whole]
    return f"{events}: {', '.join(shares)}" if shares else f"{events}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", type=float, default=240.0)
    parser.add_argument("--seeds", type=int, default=2)
    arguments = parser.parse_args()
    study = DatasetStudy.model_validate({"traffic": {"run_in_s": 60.0, "duration_s": arguments.duration}})
    recordings = [motion_source(study).record(load(SCENARIO), seed) for seed in range(1, arguments.seeds + 1)]
    print(f"| preset | {' | '.join(known.text for known in KNOWN)} |")
    print("| --- " * (len(KNOWN) + 1) + "|")
    for preset in PRESETS:
        counts: dict[Intention, list[int]] = {known: [0, 0, 0] for known in KNOWN}
        for recording in recordings:
            short = events_of(cut(recording), preset)
            for event in events_of(recording, preset):
                near = [
                    other
                    for other in short
                    if other.vehicle.partition("#")[0] == event.vehicle and abs(other.commit - event.commit) <= WITHIN_S
                ]
                counts[event.intention][0] += 1
                counts[event.intention][1] += bool(near)
                counts[event.intention][2] += any(other.intention is event.intention for other in near)
        cells = [_shares(*counted) for counted in counts.values()]
        print(f"| `{preset}` | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
