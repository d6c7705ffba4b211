"""How often vehicles that leave the middle of their lane come back, and how often they stop meanwhile.

    python -m isac_cosim.benchmarks.findings.driving.abandoned_changes [SCENARIO] [--seed N] [--duration S]
        [--sublanes WIDTH ...]

Simulates drivers that are left alone, without sway and wandering speed, once for each width of a sublane, m. Prints a
table in Markdown.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from isac_cosim.evaluation.report.parts import markdown
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.drivers.settings import LEFT_ALONE, ManeuverSettings
from isac_cosim.isacsim.traffic.drivers.speed_wander import SpeedWanderSettings
from isac_cosim.isacsim.traffic.drivers.sway import MARKING_STEP_M, SwaySettings
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record

ASIDE_M = 0.5
"""A vehicle this far from the middle of its lane has left it."""
STOPPED_MPS = 0.05
"""Lateral speed below which a vehicle has stopped on its way across."""
LONG_S = 1.0


@dataclass(frozen=True)
class AbandonedChange:
    """A stretch of time that a vehicle spends away from the middle of a lane.

    crosses: whether it crosses a marking. lasts_s: its length. stopped_s: how long the vehicle does not move across.
    """

    crosses: bool
    lasts_s: float
    stopped_s: float


def excursions(track: Track, step_s: float) -> Iterator[AbandonedChange]:
    """Yield the excursions of one vehicle."""
    steps = np.diff(track.lane_lat)
    marking = np.abs(steps) > MARKING_STEP_M
    across = np.gradient(np.concatenate([[0.0], np.cumsum(np.where(marking, 0.0, steps))]), step_s)
    aside = np.concatenate([[0], np.abs(track.lane_lat) > ASIDE_M, [0]]).astype(np.int64)
    for first, after in np.flatnonzero(np.diff(aside)).reshape(-1, 2):
        crosses = bool(marking[max(first - 1, 0) : after].any())
        stopped = np.abs(across[first:after]) < STOPPED_MPS
        yield AbandonedChange(crosses, (after - first) * step_s, float(stopped.sum() * step_s))


def traffic_left_alone(scenario: str, seed: int, duration_s: float, sublane_m: float) -> Recording:
    """Return a recording of drivers that do nothing but what SUMO lets them do."""
    traffic = TrafficSettings(
        duration_s=duration_s,
        lateral_resolution_m=sublane_m,
        sway=SwaySettings(sd_m=(0.0, 0.0)),
        speed_wander=SpeedWanderSettings(sd_share=(0.0, 0.0)),
    )
    return record(load(scenario), seed, traffic, ManeuverSettings(**LEFT_ALONE))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("scenario", nargs="?", default="motorway")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--duration", type=float, default=120.0)
    parser.add_argument("--sublanes", type=float, nargs="+", default=[0.8, TrafficSettings().lateral_resolution_m])
    chosen = parser.parse_args(arguments)
    rows = []
    for sublane_m in chosen.sublanes:
        recording = traffic_left_alone(chosen.scenario, chosen.seed, chosen.duration, sublane_m)
        seen = [excursion for track in recording.tracks.values() for excursion in excursions(track, recording.step_s)]
        across = [excursion for excursion in seen if excursion.crosses]
        back = [excursion for excursion in seen if not excursion.crosses]
        median_s = f"{np.median([excursion.lasts_s for excursion in back]):.1f}" if back else ""
        stopping = [sum(excursion.stopped_s > LONG_S for excursion in some) for some in (across, back)]
        rows.append([f"{sublane_m:g}", f"{len(across)}", f"{stopping[0]}", f"{len(back)}", f"{stopping[1]}", median_s])
    head = ["sublanes, m", "into the next lane", "stopping on the way", "and back", "stopping", "median length, s"]
    print(markdown(head, rows))


if __name__ == "__main__":
    main()
