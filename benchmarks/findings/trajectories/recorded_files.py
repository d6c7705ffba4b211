"""What rate and noise of a file of trajectories cost the labels: events of a recording, and of its copies as FCD.

    python -m isac_cosim.benchmarks.findings.trajectories.recorded_files [SCENARIO] [--duration S]

An event is found where the copy has one of the same vehicle and intention whose onset and commit are at most 0.5 s
away. Prints a table in Markdown: events found by file and intention, and the median differences of onset and commit.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from isac_cosim.evaluation.report.parts import markdown
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.intentions import KNOWN, Event

WITHIN_S = 0.5
FILES = ((4, 0.0), (4, 0.05), (10, 0.0), (10, 0.1), (20, 0.0), (50, 0.0), (100, 0.0))
"""Steps of 0.01 s between two states, and standard deviation of the noise of positions, m."""


def write(recording: Recording, every: int, noise_m: float, path: Path) -> None:
    """Write a recording as FCD in Parquet, rounded to centimetres. every: of so many steps, one is written."""
    rng = np.random.default_rng(7)
    parts = []
    for name, track in recording.tracks.items():
        rows = np.arange(-track.first_step % every, len(track), every)
        x, y = (values[rows] + rng.normal(0.0, noise_m, len(rows)) for values in (track.x, track.y))
        parts.append(
            pa.table(
                {
                    "timestep_time": np.round((track.first_step + rows) * recording.step_s, 3),
                    "vehicle_id": [name] * len(rows),
                    "vehicle_x": np.round(x, 2),
                    "vehicle_y": np.round(y, 2),
                    "vehicle_lane": [recording.lanes[lane].id for lane in track.lane[rows].tolist()],
                }
            )
        )
    pq.write_table(pa.concat_tables(parts).sort_by("timestep_time"), path)


def found(events: Sequence[Event], others: Sequence[Event]) -> list[tuple[Event, Event]]:
    """Return the events that are among the others too, each with the other one."""
    left, pairs = list(others), []
    for event in events:
        for other in left:
            same = (other.vehicle, other.intention) == (event.vehicle, event.intention)
            if same and max(abs(other.onset - event.onset), abs(other.commit - event.commit)) <= WITHIN_S:
                pairs.append((event, other))
                left.remove(other)
                break
    return pairs


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="motorway")
    parser.add_argument("--duration", type=float, default=120.0)
    arguments = parser.parse_args()
    study = DatasetStudy.model_validate({"traffic": {"run_in_s": 60.0, "duration_s": arguments.duration}})
    recording = motion_source(study).record(load(arguments.scenario), 1)
    events = [event for event in label(recording, study.labels).events if event.intention in KNOWN]
    counts = [sum(event.intention is known for event in events) for known in KNOWN]
    rows = [["events", *map(str, counts), "", ""]]
    with tempfile.TemporaryDirectory() as folder:
        for every, noise_m in FILES:
            path = Path(folder) / "drive.parquet"
            write(recording, every, noise_m, path)
            fcd = {"network": arguments.scenario, "noise_m": noise_m or None, "block_min": 60.0}
            copy = DatasetStudy.model_validate({"source": "fcd", "scenarios": [str(path)], "fcd": fcd})
            source = motion_source(copy)
            again = label(source.record(source.load(str(path)), 1), copy.labels)
            pairs = found(events, again.events)
            counts = [sum(event.intention is known for event, _ in pairs) for known in KNOWN]
            medians = (
                float(np.median([abs(getattr(a, at) - getattr(b, at)) for a, b in pairs])) for at in ("onset", "commit")
            )
            file = f"{100 / every:g} Hz, {100 * noise_m or 1:g} cm{' of noise' if noise_m else ''}"
            rows.append([file, *map(str, counts), *(f"{median:.3f}" for median in medians)])
    print(markdown(["file", *(known.text for known in KNOWN), "onset s", "commit s"], rows))


if __name__ == "__main__":
    main()
