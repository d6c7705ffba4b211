"""How people drive, beside how they drive here: lane changes, lateral speed, headways, jerk, brake peaks, sway.

    python -m isac_cosim.benchmarks.findings.driving_distributions [SCENARIO] [--seeds N] [--duration S]

Prints a table in Markdown, one row a quantity, by origin where it is one of events, with published values beside it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import ManeuverSettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.detectors.events import Labels, label, provenance
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Intention
from isac_cosim.labeling.road.lane_graph import LaneGraph
from isac_cosim.labeling.road.road_motion import RoadMotion, road_motion, slope

PUBLISHED = {
    "lane change, duration, s": "6.28, sd 2.0 (Lee, Olsen and Wierwille 2004); 4.0, sd 2.3 (NGSIM)",
    "lane change, largest lateral speed, m/s": "",
    "time gap of followers within 3 s, s": "many below 1 s (Vogel 2003)",
    "sway outside events, standard deviation, m": "about 0.2 (Verster and Roth 2011)",
    "jerk along outside events, rms, m/s³": "",
    "hard brake, peak, m/s²": "0.50 g, sd 0.27 g, of drivers hit from behind (Belkadi and Campbell 2017)",
    "hard brake, time from onset to 4 m/s², s": "",
    "hard brake, deceleration 1 s after onset, m/s²": "",
    "hard brake, deceleration 2.2 s after onset, m/s²": "",
    "evasive swerve, peak across, m/s²": "0.3 to 0.7 g in driving experiments",
    "evasive swerve, time to collision at the start, s": "",
}
"""The quantities, in the order of the table, and what is published about them."""
CALM_S = 3.0
"""Sway and jerk are measured this far from any event, s."""
BRAKING_AFTER_S = (1.0, 2.2)
"""Where the course of a hard brake is measured, after its onset, s."""
HEADWAY_EVERY_S = 5.0
FOLLOWER_S = 3.0
"""A vehicle closer than this, in time, follows the one ahead, s."""


def measured(recording: Recording, labels: Labels) -> Iterator[tuple[str, str, float]]:
    """Yield quantity, origin and value of every measurement in a recording; an empty origin where it has none."""
    graph = LaneGraph(recording.lanes)
    motions = {
        name: road_motion(recording, track, graph, labels.settings.width_s)
        for name, track in recording.tracks.items()
        if len(track) * recording.step_s > 10.0
    }
    for event in labels.events:
        reason = provenance(recording, event)
        if event.intention is Intention.HARD_BRAKE:
            yield "hard brake, peak, m/s²", reason.origin, -event.peak
            yield "hard brake, time from onset to 4 m/s², s", reason.origin, event.commit - event.onset
            braking = motions.get(event.vehicle)
            if braking is not None:
                for after_s in BRAKING_AFTER_S:
                    deceleration = -float(np.interp(event.onset + after_s, braking.times, braking.a))
                    yield f"hard brake, deceleration {after_s:g} s after onset, m/s²", reason.origin, deceleration
        elif event.intention is Intention.EVASIVE_SWERVE:
            yield "evasive swerve, peak across, m/s²", reason.origin, abs(event.peak)
            if np.isfinite(reason.cause_ttc_s):
                yield "evasive swerve, time to collision at the start, s", reason.origin, reason.cause_ttc_s
    for changes in labels.changes.values():
        for change in changes:
            reason = provenance(recording, change)
            yield "lane change, duration, s", reason.origin, change.end - change.onset
            motion = motions.get(change.vehicle)
            if motion is not None:
                during = (motion.times >= change.onset) & (motion.times <= change.end)
                yield "lane change, largest lateral speed, m/s", reason.origin, float(np.abs(motion.vq[during]).max())
    for motion in motions.values():
        calm = _calm(motion, labels)
        if calm.sum() * (motion.times[1] - motion.times[0]) > 10.0:
            yield "sway outside events, standard deviation, m", "", float((motion.q - _middle(motion))[calm].std())
            jerk = slope(motion.a, float(motion.times[1] - motion.times[0]))
            yield "jerk along outside events, rms, m/s³", "", float(np.sqrt((jerk[calm] ** 2).mean()))
    for gap_s in time_gaps(recording):
        if gap_s < FOLLOWER_S:
            yield "time gap of followers within 3 s, s", "", gap_s


def _calm(motion: RoadMotion, labels: Labels) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Rows that are far from all events of a vehicle but following."""
    calm = np.ones(len(motion.times), np.bool_)
    events = [e for e in labels.events if e.vehicle == motion.vehicle and e.intention is not Intention.FOLLOWING]
    for event in (*events, *labels.changes.get(motion.vehicle, ())):
        calm &= (motion.times < event.onset - CALM_S) | (motion.times > event.end + CALM_S)
    return calm


def _middle(motion: RoadMotion) -> Array:
    """Lateral position of the middle of the lane that the vehicle is in, roughly: the mean between two crossings."""
    middle = np.zeros(len(motion.times))
    cuts = [-np.inf, *(crossing.time for crossing in motion.crossings), np.inf]
    for start, end in pairwise(cuts):
        rows = (motion.times >= start) & (motion.times < end)
        if rows.any():
            middle[rows] = np.median(motion.q[rows])
    return middle


def time_gaps(recording: Recording) -> Iterator[float]:
    """Yield the time gaps between vehicles in one lane, every few seconds, s."""
    every = round(HEADWAY_EVERY_S / recording.step_s)
    by_step: dict[int, list[tuple[int, float, float, float]]] = {}
    for track in recording.tracks.values():
        for row in range(-track.first_step % every, len(track), every):
            state = (int(track.lane[row]), float(track.lane_pos[row]), float(track.speed[row]), track.length_m)
            by_step.setdefault(track.first_step + row, []).append(state)
    for states in by_step.values():
        states.sort()
        for (lane, place, speed, _), (lane_ahead, place_ahead, _, length) in pairwise(states):
            if lane == lane_ahead and speed > 5.0:
                yield (place_ahead - length - place) / speed


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("scenario", nargs="?", default="motorway")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--duration", type=float, default=240.0)
    chosen = parser.parse_args(arguments)
    values: dict[tuple[str, str], list[float]] = {}
    for seed in range(1, chosen.seeds + 1):
        traffic = TrafficSettings(duration_s=chosen.duration)
        recording = record(load(chosen.scenario), seed, traffic, ManeuverSettings())
        for quantity, origin, value in measured(recording, label(recording, LabelSettings())):
            values.setdefault((quantity, origin), []).append(value)
    quantiles = (0.05, 0.25, 0.5, 0.75, 0.95)
    columns = ["quantity", "origin", "n", "mean", "sd", *(f"{100 * share:.0f} %" for share in quantiles), "published"]
    for cells in (columns, ["---"] * len(columns)):
        print(f"| {' | '.join(cells)} |")
    for quantity, published in PUBLISHED.items():
        for origin in ("", "natural", "reaction", "commanded"):
            if (quantity, origin) in values:
                x = np.array(values[quantity, origin])
                numbers = " | ".join(f"{number:.2f}" for number in (x.mean(), x.std(), *np.quantile(x, quantiles)))
                print(f"| {quantity} | {origin} | {len(x)} | {numbers} | {published} |")


if __name__ == "__main__":
    main()
