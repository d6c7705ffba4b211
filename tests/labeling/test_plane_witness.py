"""Datasets of kinked, left-hand and signalled networks against the centre lines in their network files.

The witness (tests/support/plane_witness.py) reads what is stored, works in the plane, and shares no code with labels.
"""

from __future__ import annotations

import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.isacsim.scenarios.scenario import Scenario, bundled, load
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource
from isac_cosim.isacsim.traffic.sources.simulated import SumoSource
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.road.surroundings import Surroundings
from tests.support.plane_witness import Network, Verdict, across, judge
from tests.support.scripted import InlineEngine

CHANGES = ("left_lane_change", "right_lane_change", "overtake")
BRIEF = {
    "seeds": {"first": 1, "last": 1},
    "traffic": {"run_in_s": 30.0, "duration_s": 90.0},
    "maneuvers": {"left_change_per_vehicle_hour": 90.0, "right_change_per_vehicle_hour": 90.0},
    "pairs": {"fall_back": True},
    "selection": {"per_class": 40},
}
TAIL_S = 0.1
LONG = {"seeds": {"first": 1, "last": 4}}


@dataclass(frozen=True)
class KeepingSource(MotionSource):
    """SUMO's traffic; its recordings are kept for a look at what a dataset does not hold."""

    source: SumoSource
    recordings: list[Recording] = field(default_factory=list, hash=False, compare=False)

    def load(self, where: str) -> Scenario:
        return self.source.load(where)

    def inputs(self, scenario: Scenario) -> Mapping[str, str]:
        return self.source.inputs(scenario)

    def record(self, scenario: Scenario, seed: int) -> Recording:
        self.recordings.append(self.source.record(scenario, seed))
        return self.recordings[-1]

    def expected_cpu_s(self) -> float:
        return self.source.expected_cpu_s()


@dataclass(frozen=True)
class Witnessed:
    """A dataset with its network, and the verdict on each of its lane changes and overtakes, by row.

    A change that commits within the last `TAIL_S` of its record has no verdict: the record does not show where it ends.
    """

    dataset: Dataset
    network: Network
    verdicts: dict[int, Verdict]
    recordings: list[Recording]

    @property
    def intentions(self) -> list[str]:
        return [str(name) for name in self.dataset.frame()["intention"]]


def true_states(dataset: Dataset) -> np.ndarray:
    """Return the true states of all TVs in the plane, (N, 6, S)."""
    points = dataset.frame(["x0", "y0"])
    states = dataset.arrays("tv_truth")["tv_truth"].astype(float)
    states[:, :2] += points.to_numpy()[:, :, None]
    return states


def witnessed(where: str, settings: dict[str, object], out: Path, engine: InlineEngine | LocalEngine) -> Witnessed:
    """Generate a dataset of one scenario and judge it. Recordings are kept where the engine works in this process."""
    scenario, study = load(where), DatasetStudy.model_validate({"scenarios": [where], **settings})
    source = KeepingSource(SumoSource(**study.source_settings()))
    dataset = generate(study, out, engine, source=source)
    network = Network.read(scenario.network, scenario.origin)
    frame, truth = dataset.frame(), true_states(dataset)
    rate_hz = dataset.meta.tv_rate_hz
    duration_s = truth.shape[2] / rate_hz
    verdicts = {
        row: judge(network, truth[row], round((sample.t_commit - sample.t_start) * rate_hz), rate_hz)
        for row, sample in enumerate(frame.itertuples())
        if sample.intention in CHANGES and sample.t_commit - sample.t_start < duration_s - TAIL_S
    }
    return Witnessed(dataset, network, verdicts, source.recordings)


@pytest.fixture(scope="module")
def city(tmp_path_factory: pytest.TempPathFactory) -> Witnessed:
    """A short dataset of the bundled city: kinked, left-hand, signalled, with parked vehicles."""
    return witnessed("city", BRIEF, tmp_path_factory.mktemp("city") / "data", InlineEngine())


def check_sides(result: Witnessed, least: int) -> None:
    """Each change goes to the side that its intention names, and commits at the marking."""
    overtaking = "right" if result.network.lefthand else "left"
    sides = {"left_lane_change": "left", "right_lane_change": "right", "overtake": overtaking}
    clear = {row: verdict for row, verdict in result.verdicts.items() if verdict.side is not None}
    assert len(clear) >= least
    assert len(clear) >= 0.9 * len(result.verdicts)
    wrong = [row for row, verdict in clear.items() if verdict.side != sides[result.intentions[row]]]
    assert wrong == []
    off = np.array([verdict.off_marking_m for verdict in clear.values()])
    # Rounding moves a vehicle off the polygon, by up to a metre.
    assert np.percentile(off, 90) < 0.5
    assert off.max() < 1.6


def check_motion(result: Witnessed) -> None:
    """No vehicle of a record without a swerve accelerates across by more than 4 m/s2; following is steady."""
    arrays = true_states(result.dataset)
    quiet = [row for row, intention in enumerate(result.intentions) if intention != "evasive_swerve"]
    peaks = np.array([np.abs(across(arrays[row])).max() for row in quiet])
    assert (peaks > 4.0).mean() < 0.01
    for row, intention in enumerate(result.intentions):
        if intention == "following":
            # Half a lane of 3.6 m: a vehicle that has stopped during a lane change stands beside the centre.
            places = [result.network.nearest(arrays[row, :2, k], arrays[row, 2:4, k]) for k in (0, 1000, -1)]
            assert all(lanes and lanes[0][0] < 1.8 for lanes in places), row
            # 2 m/s2 by definition, and the 0.5 m/s2 by which the plane may differ from it.
            assert np.abs(np.diff(np.hypot(*arrays[row, 2:4])) * 400.0).max() < 2.6, row


@pytest.mark.slow
def test_changes_in_the_city_go_to_their_side(city: Witnessed) -> None:
    assert city.network.lefthand
    assert {city.intentions[row] for row in city.verdicts} >= {"left_lane_change", "right_lane_change"}
    check_sides(city, least=10)


@pytest.mark.slow
def test_motion_in_the_city_is_that_of_drivers(city: Witnessed) -> None:
    check_motion(city)
    assert city.dataset.meta.lost == ()


@pytest.mark.slow
def test_a_mirrored_record_would_be_noticed(city: Witnessed) -> None:
    """The witness can fail: with left and right exchanged, no clear verdict agrees."""
    names = {"left_lane_change": "right", "right_lane_change": "left"}
    clear = [(row, verdict) for row, verdict in city.verdicts.items() if verdict.side is not None]
    agreeing = [row for row, verdict in clear if names.get(city.intentions[row]) == verdict.side]
    assert agreeing == []


@pytest.mark.slow
def test_nobody_follows_the_citys_parked_vehicles(city: Witnessed) -> None:
    """Cars stand parked all the time, buses stop for a while. Without the note of it, they would be leaders."""
    (recording,) = city.recordings
    whole = {name for name, stays in recording.parked.items() if sum(b - a for a, b in stays) * recording.step_s > 60.0}
    assert {f"parked_{k}" for k in range(3)} <= whole
    assert any(name.startswith("bus_") for name in recording.parked)
    leaders: dict[bool, set[str]] = {}
    for noted in (True, False):
        known = recording if noted else replace(recording, parked={})
        surroundings = Surroundings(known)
        leaders[noted] = {
            leader.vehicle
            for time_s in np.arange(32.0, 99.0, 4.0)
            for track in surroundings.present(time_s)
            if (leader := surroundings.leader(track.vehicle, time_s, 60.0)) is not None
        }
    assert not leaders[True] & whole
    assert leaders[False] & whole
    assert not {name for row in city.dataset.frame()[["tv_id", "uv_id"]].itertuples() for name in row} & whole


def test_the_city_is_as_kinked_as_networks_of_others() -> None:
    """Corners of 2 to 4 degrees in the median, some of 20 to 45, and signals."""
    root = ET.parse(load("city").network).getroot()
    turns = []
    for lane in root.iter("lane"):
        if lane.attrib["id"].startswith(":"):
            continue
        line = np.array([point.split(",") for point in lane.attrib["shape"].split()], dtype=float)
        headings = np.unwrap(np.arctan2(*np.diff(line, axis=0).T[::-1]))
        turns += np.abs(np.degrees(np.diff(headings))).tolist()
    assert 2.0 < np.median(turns) < 4.0
    assert 20.0 < np.percentile(turns, 99) < 47.0
    assert sum(junction.get("type") == "traffic_light" for junction in root.iter("junction")) == 2


def right_hand_city(folder: Path) -> Path:
    """Build the city for right-hand traffic: kinked and signalled as the bundled one."""
    (town := folder / "town").mkdir(parents=True)
    script = (bundled()["city"] / "build.py").read_text().replace('"--lefthand", ', "")
    (town / "build.py").write_text(script)
    root = Path(__file__).parents[2]
    subprocess.run([sys.executable, town / "build.py"], check=True, capture_output=True, cwd=root)
    return town


@pytest.mark.slow
@pytest.mark.parametrize("where", ["city", "kinked", "urban", "motorway"])
def test_changes_on_every_kind_of_network(where: str, tmp_path: Path) -> None:
    """Four episodes of 240 s each."""
    named = str(right_hand_city(tmp_path)) if where == "kinked" else where
    result = witnessed(named, LONG, tmp_path / "data", LocalEngine(2))
    assert result.network.lefthand == (where == "city")
    assert result.dataset.meta.lost == ()
    check_sides(result, least=60)
    check_motion(result)
    sides = [(result.intentions[row], verdict.side) for row, verdict in result.verdicts.items()]
    unclear = sum(side is None for _, side in sides)
    print(f"{where}: {len(sides)} changes, {unclear} not clear in the plane, none to the wrong side")
