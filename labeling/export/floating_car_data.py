"""A recording as floating car data (FCD), with all that SUMO needs to replay it.

Format: SUMO's documentation, Simulation/Output/FCDOutput, version 1.28. A replay (`--device.fcd-replay.files`) puts
every vehicle where the file says, to the last digit, from its second state on. At the first one SUMO inserts the
vehicle, which it does in the middle of the lane.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from sumolib.net.lane import SUMO_VEHICLE_CLASSES

from isac_cosim.base.errors import InputError, writing
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.scenarios.site_placement import sites_file
from isac_cosim.isacsim.scenarios.sumo_config import encoded
from isac_cosim.isacsim.scenarios.sumo_files import NETWORK_ENDINGS
from isac_cosim.isacsim.scenarios.sumo_schemas import in_full
from isac_cosim.isacsim.scenarios.xml_files import write_lines
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.road_coordinates import lane_headings

FCD_FILE, TYPES_FILE, SITES_FILE, CONFIG_FILE = "episode.fcd.xml", "types.add.xml", "sites.add.xml", "replay.sumocfg"
OTHER_CLASS = "passenger"
"""SUMO's vehicle class of a vehicle whose kind is none of them."""


def check_network(scenario: Scenario) -> None:
    """Raise InputError where a scenario's roads are not those of a SUMO network."""
    if not scenario.network.name.endswith(NETWORK_ENDINGS):
        raise InputError(
            f"{scenario.network}: is no SUMO network, and SUMO replays vehicles on one alone; export with --csv"
        )


def write_fcd(recording: Recording, scenario: Scenario, folder: Path, every: int) -> int:
    """Write a recording into a folder: states, vehicle types, sites, a copy of the network, and a configuration.

    every: of so many steps one is written, those whose number it divides. Returns how many states were written. Raises
    InputError where there is none, or the roads are no SUMO network, OutputError where a file cannot be written.
    """
    check_network(scenario)
    vehicles = _vehicles(recording, scenario.origin)
    first, last = _span(recording, every)
    count = 0
    with writing(folder):
        shutil.copyfile(scenario.network, folder / scenario.network.name)
        write_lines(folder / TYPES_FILE, _types_file(vehicles))
        write_lines(folder / SITES_FILE, sites_file(scenario.sites, scenario.origin))
        write_lines(folder / CONFIG_FILE, _configuration(recording, scenario, first, last, every))
        with (folder / FCD_FILE).open("w", encoding="utf-8", newline="\n") as file:
            file.write('<?xml version="1.0" encoding="UTF-8"?>\n<fcd-export>\n')
            for step in range(first, last + 1, every):
                lines = [vehicle.line(step) for vehicle in vehicles if vehicle.is_there(step)]
                count += len(lines)
                file.write("".join([f'<timestep time="{_time(recording, step)}">\n', *lines, "</timestep>\n"]))
            file.write("</fcd-export>\n")
    return count


def _span(recording: Recording, every: int) -> tuple[int, int]:
    """Return the first and the last step that are written. Raises InputError where no vehicle is there at any."""
    spans = [
        (-(-track.first_step // every) * every, (track.first_step + len(track) - 1) // every * every)
        for track in recording.tracks.values()
    ]
    whole = [(first, last) for first, last in spans if first <= last]
    if not whole:
        raise InputError(f"{recording.scenario}, seed {recording.seed}: no vehicle is there for long enough to export")
    return min(first for first, _ in whole), max(last for _, last in whole)


def _time(recording: Recording, step: int) -> str:
    return in_full(round(step * recording.step_s, 3))


@dataclass(frozen=True)
class _Vehicle:
    """A vehicle as it is written. kind: class, length and width, m. columns: x, y, angle, speed and pos."""

    start: str
    first_step: int
    kind: tuple[str, float, float]
    lanes: list[str]
    columns: list[list[float]]

    def is_there(self, step: int) -> bool:
        return 0 <= step - self.first_step < len(self.lanes)

    def line(self, step: int) -> str:
        row = step - self.first_step
        x, y, angle, speed, pos = (column[row] for column in self.columns)
        return (
            f'{self.start} x="{x!r}" y="{y!r}" angle="{angle!r}" speed="{speed!r}" pos="{pos!r}" '
            f'lane="{self.lanes[row]}"/>\n'
        )


def _vehicles(recording: Recording, origin: tuple[float, float]) -> list[_Vehicle]:
    """Return the vehicles of a recording, in its order. origin: of its plane in SUMO's coordinates, m."""
    names = [escape(lane.id, {'"': "&quot;"}) for lane in recording.lanes]
    numbers: dict[tuple[str, float, float], int] = {}
    vehicles = []
    for track in recording.tracks.values():
        kind = track.kind if track.kind in SUMO_VEHICLE_CLASSES else OTHER_CLASS, track.length_m, track.width_m
        number = numbers.setdefault(kind, len(numbers))
        # SUMO's angles are those of a compass.
        angle = np.degrees(np.pi / 2 - np.angle(lane_headings(recording.lanes, track.lane, track.lane_pos))) % 360
        columns = track.x + origin[0], track.y + origin[1], angle, track.speed, track.lane_pos
        vehicles.append(
            _Vehicle(
                f"<vehicle id={quoteattr(track.vehicle)} type={quoteattr(_type_name(kind, number))}",
                track.first_step,
                kind,
                [names[k] for k in track.lane.tolist()],
                [np.asarray(column, np.float64).tolist() for column in columns],
            )
        )
    return vehicles


def _type_name(kind: tuple[str, float, float], number: int) -> str:
    return f"{kind[0]}_{number}"


def _types_file(vehicles: Sequence[_Vehicle]) -> str:
    """Return the vehicle types: one for each class and size. What they say of drivers has no part in a replay."""
    kinds = dict.fromkeys(vehicle.kind for vehicle in vehicles)
    lines = [
        f'  <vType id={quoteattr(_type_name(kind, number))} vClass="{kind[0]}" length="{in_full(kind[1])}" '
        f'width="{in_full(kind[2])}"/>'
        for number, kind in enumerate(kinds)
    ]
    return "\n".join(["<additional>", *lines, "</additional>", ""])


def _configuration(recording: Recording, scenario: Scenario, first: int, last: int, every: int) -> str:
    """Return a configuration with which `sumo` and `sumo-gui` replay the episode."""
    options = {
        "net-file": encoded(scenario.network.name),
        "additional-files": f"{TYPES_FILE},{SITES_FILE}",
        "device.fcd-replay.files": FCD_FILE,
        "begin": _time(recording, first),
        "end": _time(recording, last + every),
        "step-length": _time(recording, every),
        # Every vehicle is where the file says, whatever SUMO thinks of that.
        "insertion-checks": "none",
        "eager-insert": "true",
        "collision.action": "none",
        "time-to-teleport": "-1",
        "no-warnings": "true",
    }
    lines = [f"  <{name} value={quoteattr(value)}/>" for name, value in options.items()]
    return "\n".join(["<configuration>", *lines, "</configuration>", ""])
