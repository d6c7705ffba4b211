"""What all motion sources share that read files of trajectories: blocks as seeds, sites, and one reading a process."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
from pydantic import Field

from isac_cosim.base.arrays import IntArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.files import digests_of
from isac_cosim.base.settings import Settings
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.naming import check_name
from isac_cosim.isacsim.scenarios.scenario import Scenario, Site, read_sites
from isac_cosim.isacsim.scenarios.site_placement import PlacementSettings, place
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource
from isac_cosim.isacsim.traffic.trajectory_files import blocks, checks, conditioning
from isac_cosim.isacsim.traffic.trajectory_files.conditioning import Sampling
from isac_cosim.isacsim.traffic.trajectory_files.jumps import check_jumps, jumps
from isac_cosim.isacsim.traffic.trajectory_files.lane_places import LanePlaces, runs
from isac_cosim.isacsim.traffic.trajectory_files.observed import FileStates
from isac_cosim.isacsim.traffic.trajectory_files.tracks import pieces, tracks

SAMPLED = 50_000
"""So many states show whether a network is the one that was driven on."""
MOST_JUMPS = 0.5
"""Where a larger share of lane changes are jumps, vehicles do not move sideways."""
USUAL_BLOCKS = 2
"""About how many blocks a recording has: those of roads last 15 to 20 minutes."""
ROW_CPU_S = 6e-6
"""About how much processor time a state costs, read and labelled, s."""


class FileSettings(Settings):
    """How a file of trajectories becomes episodes, and where the sites are."""

    block_min: float = Field(10.0, gt=0.0, le=1440.0, description="length of a block, an episode of its own, minutes")
    gap_s: float = Field(30.0, ge=0.0, le=3600.0, description="time between two blocks that is left out, s")
    noise_m: float | None = Field(
        None,
        ge=0.0,
        le=2.0,
        description="standard deviation of the noise of positions, m; by default, that of their rounding",
    )
    least_s: float = Field(6.6, gt=0.0, le=3600.0, description="a file must show a vehicle for so long, s")
    sites: str | None = Field(
        None, min_length=1, description="additional file with sites; by default the scenario's, or sites along the road"
    )
    placement: PlacementSettings = PlacementSettings()


@dataclass(frozen=True)
class Opened:
    """A file that was read.

    scenario: its `demand` is that file. inputs: all files that were read. remarks: what is to be said of it, a
    line each. noise_m: standard deviation of the positions, m. jumps: the rows after which positions jump,
    ascending.
    """

    scenario: Scenario
    observed: FileStates
    inputs: tuple[Path, ...]
    noise_m: float
    remarks: tuple[str, ...] = ()
    places: LanePlaces = field(init=False)
    jumps: IntArray = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "places", LanePlaces(self.scenario.lanes))
        object.__setattr__(self, "jumps", jumps(self.observed, self.noise_m))

    @property
    def sampling(self) -> Sampling:
        """How its states become motion."""
        return Sampling.of(self.observed.period_s, self.noise_m)


class FileSource(MotionSource):
    """A source that reads files of trajectories. A subclass says how they are opened."""

    default_seeds = (1, 10_000)

    @property
    def settings(self) -> FileSettings:
        """The settings of the source: its only section."""
        (section,) = self.sections
        settings: FileSettings = getattr(self, section)
        return settings

    def file_at(self, where: Path) -> Path:
        """Return the file that holds the trajectories of what the user named, a file or a folder. Raises InputError."""
        return where

    def files_beside(self, where: Path) -> tuple[Path, ...]:
        """Return the files that are read together with a file of trajectories."""
        return ()

    @abstractmethod
    def open(self, where: Path) -> Opened:
        """Read a file of trajectories. Raises InputError where it is missing, cannot be read, or cannot be right."""

    def load(self, where: str) -> Scenario:
        """Return the road, the sites, and the file as the scenario's demand."""
        path = Path(where)
        if not path.exists():
            raise InputError(f"there is no file {where}: give a file of trajectories, or leave out --source")
        return opened(self, self.file_at(path)).scenario

    def inputs(self, scenario: Scenario) -> Mapping[str, str]:
        return digests_of(opened(self, scenario.demand[0]).inputs)

    def seeds(self, scenario: Scenario) -> Sequence[int]:
        return range(1, len(self._blocks(opened(self, scenario.demand[0]).observed)) + 1)

    def remarks(self, scenario: Scenario) -> Sequence[str]:
        """Return how the file is cut and conditioned, what it does not say, and what of it is left out."""
        read = opened(self, scenario.demand[0])
        cut, sampling, observed = self._blocks(read.observed), read.sampling, read.observed
        minutes = (cut[0].last - cut[0].first + 1) * observed.period_s / 60.0
        left = conditioning.acceleration_noise(read.noise_m, 1.0 / observed.period_s, sampling.total_width_s)
        return [
            f"{scenario.demand[0].name}: {len(observed.vehicles)} vehicles, {len(observed)} states every "
            f"{observed.period_s:g} s, in {len(cut)} block(s) of {minutes:.1f} minutes; positions with a noise of "
            f"{read.noise_m:.3g} m are smoothed with {sampling.total_width_s:.2f} s, which leaves {left:.2g} m/s2",
            *read.remarks,
            *check_jumps(observed, read.jumps, scenario.demand[0]),
        ]

    def record(self, scenario: Scenario, seed: int) -> Recording:
        """Return one block. A vehicle that an earlier block has is a bystander in it."""
        read = opened(self, scenario.demand[0])
        cut = self._blocks(read.observed)
        if not 1 <= seed <= len(cut):
            raise InputError(f"{scenario.name}: has blocks 1 to {len(cut)}, and none with the number {seed}")
        before, block = blocks.seen_before(read.observed, cut, seed - 1), cut[seed - 1]
        found: dict[str, Track] = {}
        changes = at_once = 0
        starts = read.observed.step[read.observed.starts[:-1]]
        ends = read.observed.step[read.observed.starts[1:] - 1]
        for number in np.flatnonzero((starts <= block.last) & (ends >= block.first)).tolist():
            parts, changed, jumped = pieces(read.observed, number, read.places, read.jumps)
            changes, at_once = changes + changed, at_once + jumped
            for track in tracks(parts, block, read.sampling, read.places, bool(before[number])):
                found[track.vehicle] = track
        if at_once > MOST_JUMPS * max(changes, 1):
            raise InputError(
                f"{scenario.demand[0]}: {at_once} of {changes} lane changes take no time, so that there is no lateral "
                "motion to see; simulate with --lateral-resolution 5, or --lanechange.duration 4"
            )
        return Recording(scenario.name, seed, read.sampling.step_s, scenario.lanes, found, lefthand=scenario.lefthand)

    def expected_episodes(self, seeds: int) -> int:
        return min(seeds, USUAL_BLOCKS)

    def expected_cpu_s(self) -> float:
        return self.settings.block_min * 60.0 * 25.0 * 50.0 * ROW_CPU_S

    def _blocks(self, observed: FileStates) -> list[blocks.Block]:
        return blocks.blocks(observed, self.settings.block_min * 60.0, self.settings.gap_s)


def opened(source: FileSource, where: Path) -> Opened:
    """Return what is read of a file; it is read once a process and as long as it does not change."""
    states = [path.stat() for path in (where, *source.files_beside(where)) if path.exists()]
    marks = tuple((state.st_ino, state.st_size, state.st_mtime_ns) for state in states)
    return _opened(source, where, marks)


@lru_cache(maxsize=2)
def _opened(source: FileSource, where: Path, marks: object) -> Opened:
    read = source.open(where)
    check_jumps(read.observed, read.jumps, where)
    return read


def scenario_name(where: Path, endings: Iterable[str]) -> str:
    """Return the scenario's name for a file: its own, without its ending."""
    name = next((where.name[: -len(end)] for end in endings if where.name.endswith(end)), where.name)
    check_name(name, where)
    return name


def sites_for(
    settings: FileSettings, given: Sequence[Site], lanes: Sequence[Lane], observed: FileStates,
    origin: tuple[float, float], lefthand: bool,
) -> tuple[Site, ...]:  # fmt: skip
    """Return the sites: those of the file that the settings name, those that are given, or new ones along the road.

    Raises InputError where there are none.
    """
    if settings.sites is not None:
        file = Path(settings.sites)
        if not file.is_file():
            raise InputError(f"there is no file {file} with sites; give an additional file, or leave it out")
        given = tuple(read_sites([file], origin))
        if not given:
            raise InputError(f"{file}: has no site; `cosim network sites` writes such files")
    if given:
        return tuple(given)
    driven = {lanes[k].edge for k in np.unique(observed.lane).tolist() if k >= 0}
    placed = tuple(place(lanes, {edge for edge in driven if not edge.startswith(":")}, settings.placement, lefthand))
    if not placed:
        raise InputError("no site fits beside the road: give a smaller placement.set_back_m, or a file with sites")
    return placed


def check_observed(settings: FileSettings, observed: FileStates, places: LanePlaces, where: object) -> list[str]:
    """Return what is to be said of a file's content, a line each. Raises InputError where it cannot be right."""
    checks.check_lengths(observed, where)
    remarks = checks.check_speeds(observed, where)
    checks.check_durations(observed, settings.least_s, where)
    rows = np.arange(0, len(observed), max(1, len(observed) // SAMPLED))
    rows = rows[observed.lane[rows] >= 0]
    rows = rows[np.argsort(observed.lane[rows], kind="stable")]
    off = 0
    for start, stop in runs(observed.lane[rows].astype(np.int64)):
        part = rows[start:stop]
        lane = int(observed.lane[part[0]])
        found = places.places(lane, observed.x[part] + 1j * observed.y[part])
        limit = places.lanes[lane].width_m / 2.0 + checks.OFF_ROAD_M
        off += int(((np.abs(found.left) > limit) | (np.abs(found.beyond) > limit)).sum())
    if off > checks.MOST_OFF_ROAD * len(rows):
        raise InputError(
            f"{where}: {off / len(rows):.0%} of its positions are off their lanes; give the network that was driven on"
        )
    return remarks
