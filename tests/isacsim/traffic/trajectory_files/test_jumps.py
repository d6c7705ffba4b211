"""Positions that jump: a single wrong value, a vehicle taken for another one, and what is no jump."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.traffic.sources.protocol import recorded
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.isacsim.traffic.trajectory_files import jumps as module
from isac_cosim.isacsim.traffic.trajectory_files.jumps import check_jumps, jumps
from isac_cosim.isacsim.traffic.trajectory_files.observed import FileStates, FileVehicle
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.generation.settings import DatasetStudy
from isac_cosim.labeling.intentions import Event
from tests.support.sumo_recording import SCENARIO, motorway_recording
from tests.support.trajectory_writers import states, write_fcd

PERIODS_S = (0.04, 0.1, 0.5, 1.0)


def driven(period_s: float, vehicles: int = 2, count: int = 100) -> FileStates:
    """Vehicles at 30 m/s that brake with 9 m/s2, stand, and go on, in lane 0."""
    time_s = np.arange(count) * period_s
    speed = np.clip(30.0 - 9.0 * np.maximum(time_s - 10 * period_s, 0.0), 0.0, None)
    speed = np.maximum(speed, np.clip(4.0 * (time_s - 60 * period_s), 0.0, 30.0))
    x = np.cumsum(speed) * period_s
    starts = np.arange(vehicles + 1) * count
    step = np.tile(np.arange(count), vehicles)
    lane = np.zeros(len(step), np.int32)
    named = tuple(FileVehicle(str(k), "passenger", 4.5, 1.8) for k in range(vehicles))
    return FileStates(period_s, named, starts, step, np.tile(x, vehicles), np.zeros(len(step)), lane, None,
                    np.arange(len(step)) + 2)  # fmt: skip


@settings(deadline=None)
@given(st.sampled_from(PERIODS_S), st.integers(0, 99), st.sampled_from((-1.0, 1.0)), st.booleans())
def test_a_state_elsewhere_is_cut_out(period_s: float, row: int, sign: float, along: bool) -> None:
    seen = driven(period_s)
    column = seen.x if along else seen.y
    column[row] += sign * (3.0 + 40.0 * period_s**2)
    found = {*jumps(seen, 0.0).tolist()}
    assert {row - 1, row} & {*range(99)} <= found
    assert found <= {row - 1, row, 0, 98}  # the first and last interval of a vehicle have one neighbour only


@pytest.mark.parametrize("period_s", PERIODS_S)
def test_a_vehicle_that_is_elsewhere_from_now_on_is_cut_once(period_s: float) -> None:
    seen = driven(period_s)
    seen.y[130:] += 3.0 + 40.0 * period_s**2
    assert jumps(seen, 0.0).tolist() == [129]


@pytest.mark.parametrize("period_s", PERIODS_S)
def test_what_vehicles_do_is_no_jump(period_s: float) -> None:
    """They brake as hard as they can; noise, gaps, and the next vehicle's place are no jumps either."""
    seen = driven(period_s)
    seen.x[100:] += 5000.0
    assert not len(jumps(seen, 0.0))
    noisy = replace(seen, y=np.random.default_rng(7).normal(0.0, 0.4, 200))
    assert not len(jumps(noisy, 0.4))
    gap = np.r_[0:40, 41:100, 100:140, 180:200]
    part = replace(
        seen, starts=np.array([0, 99, 159]), **{name: getattr(seen, name)[gap] for name in ("step", "x", "y", "lane")}
    )
    assert not len(jumps(part, 0.0))


def test_files_are_compared_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = driven(0.1, vehicles=5)
    seen.x[::17] += 20.0
    whole = jumps(seen, 0.0)
    assert len(whole) > 40
    for size in (1, 2, 7, 100):
        monkeypatch.setattr(module, "AT_ONCE", size)
        assert jumps(seen, 0.0).tolist() == whole.tolist()


def test_where_most_vehicles_jump_the_file_is_refused() -> None:
    seen = driven(0.1, vehicles=4)
    seen.y[[50, 150]] = 9.0
    (remark,) = check_jumps(seen, jumps(seen, 0.0), "file")
    assert (
        remark == "2 vehicle(s) jump as none moves, such as 0 by 9 m after 4.9 s (row 52): their tracks are cut there"
    )
    seen.y[250] = 9.0
    with pytest.raises(InputError, match=r"^file: 3 of 4 vehicles jump .* after 4.9 s \(row 52\); fix"):
        check_jumps(seen, jumps(seen, 0.0), "file")
    seen.lane[[50, 150, 250]] = 1  # as in simulations in which a change of lane takes no time, which are told later
    assert check_jumps(seen, jumps(seen, 0.0), "file")


def test_a_wrong_position_makes_no_maneuver(tmp_path: Path) -> None:
    """One position of a vehicle that drives straight on is wrong by 8 m along, another by 2.5 m across."""
    true = motorway_recording()
    content = {"source": "fcd", "fcd": {"network": SCENARIO, "block_min": 60.0}}

    def events(x_m: float, y_m: float) -> tuple[set[tuple[str, str]], list[str]]:
        seen = states(true, every=4)
        for time_s, wrong in ((times[len(times) // 3], (x_m, 0.0)), (times[len(times) // 2], (0.0, y_m))):
            seen[time_s] = [
                replace(one, x=one.x + wrong[0], y=one.y + wrong[1]) if one.vehicle == name else one
                for one in seen[time_s]
            ]
        file = write_fcd(tmp_path / "drive.parquet", seen)
        study = DatasetStudy.model_validate({**content, "scenarios": [str(file)]})
        source = motion_source(study)
        place = source.load(str(file))
        found = label(recorded(source, place, 1), study.labels).events
        return {told(event) for event in found}, [*source.remarks(place)]

    def told(event: Event) -> tuple[str, str]:
        return event.vehicle.partition("#")[0], event.intention.name

    name = max(
        {*true.tracks} - {event.vehicle for event in label(true, DatasetStudy.model_validate({}).labels).events},
        key=lambda each: len(true.tracks[each]),
    )
    times = [time for time, present in states(true, every=4).items() if any(one.vehicle == name for one in present)]
    sound, remarks = events(0.0, 0.0)
    assert not any("jump" in remark for remark in remarks)
    again, remarks = events(8.0, 2.5)
    assert again == sound
    assert any(f"1 vehicle(s) jump as none moves, such as {name} by " in remark for remark in remarks)
