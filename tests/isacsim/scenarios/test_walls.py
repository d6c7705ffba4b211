"""No scenario makes SUMO write a file: what would is removed or refused, and where that failed, the kernel refuses it.

Each way to write is tried against both walls, and without any, so that a way that no longer works is noticed.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from isac_cosim.base import landlock
from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.sources.sumo import record
from tests.support.roads import straight_road, vehicle
from tests.support.simulate_ways import BRIEF, NATURAL
from tests.support.ways_to_write import WAYS

OPTIONS = ("a_word_after_an_option", "saving_the_configuration", "another_configuration")


@pytest.mark.parametrize("name", WAYS)
def test_a_way_to_write_is_closed_by_the_first_wall(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The scenario is refused, or it runs and what makes it write is named."""
    monkeypatch.setattr(landlock, "version", lambda: 0)
    road = straight_road(tmp_path / "road", vehicle("a"))
    monkeypatch.setenv("EVIL", "../road/")
    monkeypatch.chdir(road)  # where SUMO writes what a calibrator reports
    WAYS[name](road)
    before = sorted(road.iterdir())
    if name in OPTIONS:
        with pytest.raises(InputError, match="is not true or false: fix or remove the option"):
            load(road)
    else:
        scenario = load(road)
        assert "a" in record(scenario, 1, BRIEF, NATURAL).tracks
        assert scenario.removed
    assert sorted(road.iterdir()) == before


def outcomes(folder: Path, wall: str) -> dict[str, tuple[bool, bool, str]]:
    """By way: whether the file was written, whether the folder stayed as it was, and the error's message."""
    straight_road(folder / "road", vehicle("a"))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "EVIL": "../road/"}
    command = [sys.executable, "-m", "tests.support.simulate_ways", str(folder), wall]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("[")]
    return {name: (written, same, message) for name, written, same, message in lines}


@pytest.fixture(scope="module")
def confined(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[bool, bool, str]]:
    return outcomes(tmp_path_factory.mktemp("kernel"), "kernel")


@pytest.fixture(scope="module")
def free(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[bool, bool, str]]:
    return outcomes(tmp_path_factory.mktemp("none"), "none")


@pytest.mark.skipif(not landlock.version(), reason="the kernel has no Landlock")
@pytest.mark.parametrize("name", WAYS)
def test_a_way_to_write_is_closed_by_the_second_wall(confined: dict[str, tuple[bool, bool, str]], name: str) -> None:
    written, same, message = confined[name]
    assert not written
    assert same
    assert "\n" not in message


@pytest.mark.parametrize("name", WAYS)
def test_without_walls_each_way_writes_and_the_folder_tells(free: dict[str, tuple[bool, bool, str]], name: str) -> None:
    written, same, message = free[name]
    assert written
    assert not same
    assert "evil.xml changed while SUMO simulated road: remove what makes SUMO write" in message
