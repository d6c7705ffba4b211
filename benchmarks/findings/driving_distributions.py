"""How people drive, beside how they drive here: lane changes, lateral speed, headways, jerk, brake peaks, sway.

    python -m isac_cosim.benchmarks.findings.driving_distributions [SCENARIO] [--seeds N] [--duration S]

Prints a table in Markdown, one row a quantity, by origin where it is one of events, with published values beside it.

    python -m isac_cosim.benchmarks.findings.driving_distributions [SCENARIO ...] --rates [--seeds N] [--duration S]

Prints another one: how often maneuvers happen, per km and per hour, how closely vehicles follow and how fast they are,
in natural and in stimulated traffic of each scenario, on its whole network. Each value is a mean over seeds, with the
standard deviation over seeds.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.evaluation.report.parts import markdown
from isac_cosim.isacsim.scenarios.scenario import Scenario, load
from isac_cosim.isacsim.scenarios.xml_files import elements
from isac_cosim.isacsim.traffic.drivers.settings import LEFT_ALONE, ManeuverSettings
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
EVERY_S = 5.0
"""Interval at which headways and speeds are taken, s."""
MOVING_MPS = 5.0
"""Slower vehicles have no headway, m/s."""
FOLLOWER_S = 3.0
"""A vehicle closer than this, in time, follows the one ahead, s."""
CLOSE_S, CLOSE_MPS = 2.0, 1.5
"""A vehicle follows closely where the time gap and the difference of speeds are below these, s and m/s."""
FREE_S = 5.0
"""A vehicle with a larger time gap is free, s."""
NATURAL, STIMULATED = "natural", "stimulated"

RATES = {
    "lane changes": "0.12 (highD: Krajewski et al. 2018, 5,600 complete changes in 45,000 km of six German motorways); "
    "0.225 (Olsen, Lee, Wierwille and Goodman 2002, 8,667 changes of 16 commuters in 38,542 km); 0.5 (Knoop et al. "
    "2012, two dense freeway sites)",
    "left lane changes": "",
    "right lane changes": "",
    "overtakes": "",
    "hard brakes": "",
    "hard accelerations": "",
    "evasive swerves": "",
}
"""The maneuvers of the table of rates, and how often they happen per km, as published."""
STYLE = {
    "time gaps below 1 s, % of followers within 3 s": "",
    "time gaps below 2 s, % of all": "25 of cars and vans (Department for Transport, Great Britain, 2019, free flow)",
    "time gap of followers within 3 s, median, s": "",
    "time gap of close followers, mean, s": "1.1 (Al-Obaedi 2019, 250,000 pairs of close followers, M25 and M42)",
    "time gap of close followers, sd, s": "0.42 (the same)",
    "speed of cars, mean, km/h": "117 (Heidemann: all German motorways in 1987; 15 % above 145)",
    "speed of cars, sd, km/h": "",
    "speed of cars, 85th percentile, km/h": "",
    "free cars above the limit, %": "45 on motorways, 50 where the limit is 48 km/h (Department for Transport, 2022)",
    "free cars 14 % above the limit, %": "8 on motorways (the same: 10 mph above 70 mph)",
}
"""The other quantities of the table of rates, and what is published about them."""
TOTALS = ("vehicle-km", "vehicle-hours", "collided", "teleported")
"""What is added up over the seeds."""


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


class MovingInLane(NamedTuple):
    """A vehicle that moves in a lane, at one moment.

    kind: its class in SUMO. speed: m/s. lane: its id. gap_s: time gap to the vehicle ahead in the lane, s. closing_mps:
    by how much it is faster than that, m/s. Without a vehicle ahead, the gap is infinite.
    """

    kind: str
    speed: float
    lane: str
    gap_s: float
    closing_mps: float


def moving(recording: Recording) -> Iterator[MovingInLane]:
    """Yield the vehicles that move, every few seconds."""
    every = round(EVERY_S / recording.step_s)
    by_step: dict[int, list[tuple[int, float, float, float, str]]] = {}
    for track in recording.tracks.values():
        for row in range(-track.first_step % every, len(track), every):
            step = track.first_step + row
            if not recording.is_parked(track.vehicle, step, step):
                place, speed = float(track.lane_pos[row]), float(track.speed[row])
                state = (int(track.lane[row]), place, speed, track.length_m, track.kind)
                by_step.setdefault(step, []).append(state)
    for states in by_step.values():
        states.sort()
        for (lane, place, speed, _, kind), ahead in zip(states, [*states[1:], None], strict=True):
            if speed > MOVING_MPS:
                gap_s, closing_mps = np.inf, 0.0
                if ahead is not None and ahead[0] == lane:
                    gap_s, closing_mps = (ahead[1] - ahead[3] - place) / speed, speed - ahead[2]
                yield MovingInLane(kind, speed, recording.lanes[lane].id, gap_s, closing_mps)


def time_gaps(recording: Recording) -> Iterator[float]:
    """Yield the time gaps between vehicles in one lane, every few seconds, s."""
    yield from (vehicle.gap_s for vehicle in moving(recording) if np.isfinite(vehicle.gap_s))


def rates(recording: Recording, labels: Labels, limits: Mapping[str, float]) -> dict[str, float]:
    """Return every quantity of the table of rates, by its name; NaN where there is nothing to measure.

    limits: the speed limit of each lane, m/s.
    """
    seconds = km = 0.0
    for track in recording.tracks.values():
        parked = sum(after - first for first, after in recording.parked.get(track.vehicle, ()))
        seconds += (len(track) - parked) * recording.step_s
        km += float(track.speed.sum()) * recording.step_s / 1000.0
    changes = [change.intention for of_vehicle in labels.changes.values() for change in of_vehicle]
    counts = {
        "lane changes": len(changes),
        "left lane changes": changes.count(Intention.LEFT_LANE_CHANGE),
        "right lane changes": changes.count(Intention.RIGHT_LANE_CHANGE),
        "overtakes": len(labels.of(Intention.OVERTAKE)),
        "hard brakes": len(labels.of(Intention.HARD_BRAKE)),
        "hard accelerations": len(labels.of(Intention.HARD_ACCEL)),
        "evasive swerves": len(labels.of(Intention.EVASIVE_SWERVE)),
    }
    values = {f"{name}, per km": count / km for name, count in counts.items()}
    values |= {f"{name}, per hour": 3600.0 * count / seconds for name, count in counts.items()}
    vehicles = list(moving(recording))
    gaps = np.array([vehicle.gap_s for vehicle in vehicles])
    close = np.array([v.gap_s < CLOSE_S and abs(v.closing_mps) < CLOSE_MPS for v in vehicles], np.bool_)
    cars = np.array([vehicle.kind == "passenger" for vehicle in vehicles], np.bool_)
    speeds = np.array([3.6 * vehicle.speed for vehicle in vehicles])
    over = np.array([vehicle.speed / limits[vehicle.lane] for vehicle in vehicles])[cars & (gaps > FREE_S)]
    following = gaps[gaps < FOLLOWER_S]
    measures = (
        100.0 * _of(np.mean, following < 1.0), 100.0 * _of(np.mean, gaps < 2.0), _of(np.median, following),
        _of(np.mean, gaps[close]), _of(np.std, gaps[close]),
        _of(np.mean, speeds[cars]), _of(np.std, speeds[cars]), _of(lambda x: np.quantile(x, 0.85), speeds[cars]),
        100.0 * _of(np.mean, over > 1.0), 100.0 * _of(np.mean, over > 8.0 / 7.0),
    )  # fmt: skip
    values |= dict(zip(STYLE, measures, strict=True))
    incidents = recording.incidents
    totals = (km, seconds / 3600.0, len(incidents.collided), len(incidents.teleported))
    return values | dict(zip(TOTALS, totals, strict=True))


def _of(measure: Callable[[Any], Any], values: np.ndarray[Any, Any]) -> float:
    """Return a measure of values, NaN where there are none."""
    return float(measure(values)) if len(values) else np.nan


def speed_limits(scenario: Scenario) -> dict[str, float]:
    """Return the speed limit of each lane of a scenario, m/s."""
    return {
        attributes["id"]: float(attributes["speed"])
        for _, name, attributes in elements(scenario.network)
        if name == "lane" and "speed" in attributes
    }


def print_rates(scenarios: Sequence[str], seeds: Sequence[int], traffic: TrafficSettings) -> None:
    """Print a table of rates for each world."""
    worlds = {NATURAL: ManeuverSettings(**LEFT_ALONE), STIMULATED: ManeuverSettings()}
    columns: dict[str, list[dict[str, float]]] = {}
    for where in scenarios:
        scenario = load(where)
        limits = speed_limits(scenario)
        for world, maneuvers in worlds.items():
            for seed in seeds:
                recording = record(scenario, seed, traffic, maneuvers)
                measured_here = rates(recording, label(recording, LabelSettings()), limits)
                columns.setdefault(f"{where}, {world}", []).append(measured_here)
    published = {f"{name}, per km": text for name, text in RATES.items()} | STYLE
    quantities = [*(f"{name}, per {unit}" for unit in ("km", "hour") for name in RATES), *STYLE]
    for world in worlds:
        of_world = [columns[f"{where}, {world}"] for where in scenarios]
        rows = []
        for name in quantities:
            values = [np.array([seed[name] for seed in seeds_of]) for seeds_of in of_world]
            cells = [f"{x.mean():.{_digits(name)}f} ± {x.std(ddof=1):.{_digits(name)}f}" for x in values]
            rows.append([name, *cells])
        for name in TOTALS:
            sums = [sum(seed[name] for seed in seeds_of) for seeds_of in of_world]
            rows.append([f"{name}, all seeds", *(f"{total:.0f}" for total in sums)])
        head = [f"{world} traffic", *scenarios]
        if world == NATURAL:
            head, rows = [*head, "published"], [[*row, published.get(row[0], "")] for row in rows]
        print(markdown(head, rows), end="\n\n")


def _digits(quantity: str) -> int:
    """Return how many decimals a quantity is printed with."""
    if quantity.endswith("per km"):
        return 3
    return 2 if quantity.endswith(", s") else 1


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("scenarios", nargs="*", default=["motorway"], metavar="SCENARIO")
    parser.add_argument("--rates", action="store_true", help="how often, how closely and how fast")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--duration", type=float, default=240.0)
    chosen = parser.parse_args(arguments)
    seeds = range(chosen.first, chosen.first + chosen.seeds)
    if chosen.rates:
        # Events are the same when the states between two decisions are rebuilt, in nearly all cases.
        print_rates(chosen.scenarios, seeds, TrafficSettings(duration_s=chosen.duration, sample_s=0.1))
        return
    values: dict[tuple[str, str], list[float]] = {}
    for where, seed in product(chosen.scenarios, seeds):
        traffic = TrafficSettings(duration_s=chosen.duration)
        recording = record(load(where), seed, traffic, ManeuverSettings())
        for quantity, origin, value in measured(recording, label(recording, LabelSettings())):
            values.setdefault((quantity, origin), []).append(value)
    quantiles = (0.05, 0.25, 0.5, 0.75, 0.95)
    columns = ["quantity", "origin", "n", "mean", "sd", *(f"{100 * share:.0f} %" for share in quantiles), "published"]
    rows = []
    for quantity, published in PUBLISHED.items():
        for origin in ("", "natural", "reaction", "commanded"):
            if (quantity, origin) in values:
                x = np.array(values[quantity, origin])
                numbers = (f"{number:.2f}" for number in (x.mean(), x.std(), *np.quantile(x, quantiles)))
                rows.append([quantity, origin, str(len(x)), *numbers, published])
    print(markdown(columns, rows))


if __name__ == "__main__":
    main()
