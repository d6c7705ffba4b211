"""Traffic from formulas instead of SUMO: a straight road on which followers brake hard or change lane.

Worker processes import this module to unpickle `ScriptedSource`.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import digests_of
from isac_cosim.base.seeding import stream
from isac_cosim.base.settings import checked
from isac_cosim.base.workers.engine import InlineEngine as InlineEngine
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.scenario import Scenario, Site
from isac_cosim.isacsim.traffic.recordings.recording import Incidents, Recording, Track
from isac_cosim.isacsim.traffic.recordings.sumo_messages import SumoWarning
from isac_cosim.isacsim.traffic.recordings.traffic_facts import TrafficFacts
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource
from isac_cosim.labeling.generation.settings import DatasetStudy

STEP_S, DURATION_S, LANE_M = 0.01, 50.0, 3.2
LANES = tuple(
    Lane(f"e_{k}", "e", k, LANE_M, 2000.0, np.array([[0.0, LANE_M * (k + 0.5)], [2000.0, LANE_M * (k + 0.5)]]), ())
    for k in range(2)
)
SITES = tuple(
    Site(f"s{k}", 200.0 + 150 * (k // 2), 150.0 if k % 2 else -150.0, 20.0, 180.0 * (k % 2)) for k in range(16)
)


@dataclass(frozen=True)
class ScriptedSource(MotionSource):
    """A source with two followers in every episode, one that brakes hard and one that changes lane to the left.

    empty: seeds without traffic. broken: seeds whose simulation raises an error. wrong: seeds whose scenario is at
    fault. deadly: seeds that end the worker process. frail: folder in which each seed notes that it ended its worker,
    which it does once.
    held: seeds whose simulation waits until the test opens the gate. gate: the folder for that, see `begun` and `open`.
    pause_s: additional duration of each episode, s. warnings: how often SUMO warns of the same in each episode.
    """

    folder: Path
    empty: tuple[int, ...] = ()
    broken: tuple[int, ...] = ()
    wrong: tuple[int, ...] = ()
    deadly: tuple[int, ...] = ()
    frail: Path | None = None
    held: tuple[int, ...] = ()
    gate: Path = Path()
    pause_s: float = 0.0
    warnings: int = 0

    def load(self, where: str) -> Scenario:
        network = self.folder / "road.net.xml"
        network.write_text("<net/>")
        return Scenario(Path(where).name, network, (), (), (0.0, 0.0), LANES, SITES)

    def inputs(self, scenario: Scenario) -> Mapping[str, str]:
        return digests_of([scenario.network])

    def record(self, scenario: Scenario, seed: int) -> Recording:
        time.sleep(self.pause_s)
        if seed in self.held:
            self._pass_gate(seed)
        if seed in self.wrong:
            raise InputError(f"{scenario.network}: no road for seed {seed}; draw one")
        if seed in self.broken:
            raise RuntimeError("the simulation\nbroke")
        if seed in self.deadly or self._first_time(seed):
            os._exit(1)
        tracks = [] if seed in self.empty else [track for n in range(2) for track in _pair(seed, n)]
        return Recording(
            scenario.name,
            seed,
            STEP_S,
            LANES,
            {track.vehicle: track for track in tracks},
            incidents=Incidents(("c",), ()),
            facts=_facts(tracks, self.warnings),
        )

    def expected_cpu_s(self) -> float:
        return 0.01

    def begun(self) -> set[int]:
        """Return the held seeds whose simulation has begun."""
        return {int(path.name) for path in self.gate.iterdir() if path.name.isdigit()}

    def open(self) -> None:
        """Let the held simulations go on."""
        (self.gate / "open").touch()

    def _pass_gate(self, seed: int) -> None:
        (self.gate / str(seed)).touch()
        while not (self.gate / "open").exists():
            time.sleep(0.02)

    def _first_time(self, seed: int) -> bool:
        if self.frail is None or (self.frail / str(seed)).exists():
            return False
        (self.frail / str(seed)).touch()
        return True


def _facts(tracks: list[Track], warnings: int) -> TrafficFacts:
    """What became of the demand: the vehicles of the tracks, and one that collided."""
    text = (
        SumoWarning(kind="Vehicle '...' is slow.", count=warnings, example="Vehicle 'c' is slow.") if warnings else None
    )
    return TrafficFacts(
        from_s=0.0,
        to_s=DURATION_S,
        vehicles=len(tracks) + 1,
        by_class={"passenger": len(tracks) + 1},
        recorded=len(tracks),
        warnings=() if text is None else (text,),
    )


def _pair(seed: int, number: int) -> list[Track]:
    """Return a leader at constant speed and the follower behind it."""
    t = np.arange(0, DURATION_S, STEP_S)
    rng = stream("scripted", seed, number)
    speed, onset = rng.uniform(18, 22), rng.uniform(12, 15)
    since = t - onset
    braking = 6.0 * ((since > 0) & (since < 1.2)) if number == 0 else np.zeros_like(t)
    own_speed = speed - np.cumsum(braking) * STEP_S
    aside = LANE_M * np.clip(since / 4, 0, 1) if number == 1 else np.zeros_like(t)
    start = 250.0 + 200 * number
    leader = _track(f"lead{number}", start + 40 + speed * t, np.full_like(t, speed), np.zeros_like(t))
    return [leader, _track(f"follow{number}", start + np.cumsum(own_speed) * STEP_S, own_speed, aside)]


def _track(vehicle: str, x: np.ndarray, speed: np.ndarray, aside: np.ndarray) -> Track:
    lane = (aside > LANE_M / 2).astype(np.int32)
    return Track(vehicle, "passenger", 4.5, 1.8, 0, x, LANE_M / 2 + aside, speed, lane, x.copy(), aside - LANE_M * lane)


def small_study(**content: object) -> DatasetStudy:
    """Return a study whose records are cheap to sense and store."""
    record = {"tv_rate_hz": 40.0, "uv_rate_hz": 20.0}
    return checked(DatasetStudy, {"scenarios": ["road"], "record": record, **content}, "test")
