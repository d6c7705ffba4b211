"""No scenario makes SUMO write a file: what would is removed or refused, and where that failed, the kernel refuses it.

Each way to write is tried against both walls, and without any, so that a way that no longer works is noticed.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

import pytest

from isacsim import landlock
from isacsim.errors import InputError
from isacsim.scenarios import sumo_config, sumo_files
from isacsim.scenarios.scenario import load
from isacsim.traffic import simulation
from isacsim.traffic.director import LEFT_ALONE, ManeuverSettings
from isacsim.traffic.simulation import TrafficError, TrafficSettings, record
from tests.support.roads import straight_road, vehicle
from tests.support.ways_to_write import WAYS

BRIEF = TrafficSettings(step_s=0.1, sample_s=0.1, run_in_s=0.0, duration_s=3.0)
OPTIONS = ("a_word_after_an_option", "saving_the_configuration", "another_configuration")
NATURAL = ManeuverSettings(**LEFT_ALONE)


@pytest.fixture
def road(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = straight_road(tmp_path / "road", vehicle("a"))
    monkeypatch.setenv("EVIL", "../road/")
    monkeypatch.chdir(folder)  # where SUMO writes what a calibrator reports
    return folder


def without_first_wall(patch: pytest.MonkeyPatch) -> None:
    """Files and options reach SUMO as a scenario has them."""
    patch.setattr(sumo_files.Handover, "path_of", lambda self, file: file)
    patch.setattr(sumo_config.sumo_schemas, "fits", lambda value, kind: True)
    patch.setattr(
        simulation,
        "_arguments",
        lambda options: [word for name, value in options.items() if value for word in (f"--{name}", value)],
    )


@pytest.mark.parametrize("name", WAYS)
def test_a_way_to_write_is_closed_by_the_first_wall(road: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The scenario is refused, or it runs and what makes it write is named."""
    monkeypatch.setattr(landlock, "version", lambda: 0)
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


@pytest.mark.skipif(not landlock.version(), reason="the kernel has no Landlock")
@pytest.mark.parametrize("name", WAYS)
def test_a_way_to_write_is_closed_by_the_second_wall(road: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    without_first_wall(monkeypatch)
    written = WAYS[name](road)
    before = sorted(road.iterdir())
    with contextlib.suppress(InputError, TrafficError):
        record(load(road), 1, BRIEF, NATURAL)
    assert not written.exists()
    assert sorted(road.iterdir()) == before


@pytest.mark.parametrize("name", WAYS)
def test_without_walls_each_way_writes_and_the_folder_says_so(
    road: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_first_wall(monkeypatch)
    monkeypatch.setattr(landlock, "version", lambda: 0)
    written = WAYS[name](road)
    with pytest.raises(InputError, match=r"evil\.xml changed while SUMO simulated road: remove what"):
        record(load(road), 1, BRIEF, NATURAL)
    assert written.exists()
