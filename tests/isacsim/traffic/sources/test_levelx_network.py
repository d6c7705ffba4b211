"""Recordings that name centres and headings of boxes, as exiD and inD do, on a road network that the user names."""

from __future__ import annotations

import shutil
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios import scenario as scenarios
from isac_cosim.isacsim.traffic.sources.protocol import recorded
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.generation.settings import DatasetStudy
from tests.support.event_match import found_events
from tests.support.exid_writer import write_exid
from tests.support.highd_writer import straight_recording
from tests.support.lanelet_writer import UTM, LaneletMap, write_lanelets
from tests.support.reading import read
from tests.support.sumo_recording import SCENARIO, motorway_recording


def study_of(where: Path, network: str | None = SCENARIO, **levelx: object) -> DatasetStudy:
    content = {
        "source": "levelx", "scenarios": [str(where)], "levelx": {"network": network, "block_min": 60.0, **levelx}
    }  # fmt: skip
    return DatasetStudy.model_validate(content)


@pytest.fixture(scope="module")
def exid(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    folder = tmp_path_factory.mktemp("exid")
    return folder, write_exid(folder, motorway_recording())


def test_positions_and_lanes_come_back(exid: tuple[Path, dict[str, str]]) -> None:
    folder, names = exid
    again, true = read(study_of(folder)), motorway_recording()
    states = other_lanes = 0
    for name, track in true.tracks.items():
        mine = again.tracks.get(names.get(name, ""))
        if mine is None:
            assert len(track) < 16
            continue
        rows = (mine.first_step + np.arange(len(mine))) * 4 - track.first_step
        assert np.abs(mine.x - track.x[rows]).max() <= 0.001
        assert np.abs(mine.y - track.y[rows]).max() <= 0.001
        states += len(mine)
        other_lanes += int((mine.lane != track.lane[rows]).sum())
    assert states > 20_000
    assert other_lanes <= 0.002 * states


def test_events_come_back(exid: tuple[Path, dict[str, str]]) -> None:
    folder, names = exid
    study = study_of(folder)
    true = motorway_recording()
    tracks = {names[name]: replace(track, vehicle=names[name]) for name, track in true.tracks.items() if name in names}
    found = found_events(label(replace(true, tracks=tracks), study.labels), label(read(study), study.labels))
    events = sum(of.events for of in found.values())
    assert events > 20
    assert sum(of.matched for of in found.values()) >= 0.99 * events
    assert sum(of.surplus for of in found.values()) <= 0.01 * events
    assert all(max(of.medians_s) <= 0.1 for of in found.values())


def test_a_lanelet2_map_beside_the_recording_gives_the_lanes(exid: tuple[Path, dict[str, str]], tmp_path: Path) -> None:
    folder, true = tmp_path / "mapped", motorway_recording()
    names = write_exid(folder, true, utm=UTM)
    write_lanelets(folder / "place.osm", true.lanes)
    source = motion_source(study_of(folder, None))
    place = source.load(str(folder))
    assert "place.osm" in source.inputs(place)
    again, on_network = recorded(source, place, 1), read(study_of(exid[0]))
    assert again.tracks.keys() == on_network.tracks.keys()
    assert set(names.values()) >= again.tracks.keys()
    states = alike = 0
    for name, track in on_network.tracks.items():
        mine = again.tracks[name]
        assert len(mine) == len(track)
        states += len(track)
        same_index = (
            np.array([lane.index for lane in again.lanes])[mine.lane]
            == np.array([lane.index for lane in on_network.lanes])[track.lane]
        )
        alike += int((same_index & (np.abs(mine.lane_lat - track.lane_lat) < 0.05)).sum())
    assert states > 20_000
    assert alike >= 0.99 * states
    labels = study_of(folder).labels
    found = found_events(label(on_network, labels), label(again, labels))
    assert sum(of.events for of in found.values()) > 20
    assert sum(of.matched for of in found.values()) >= 0.99 * sum(of.events for of in found.values())
    assert sum(of.surplus for of in found.values()) <= 0.01 * sum(of.events for of in found.values())


def test_lanes_whose_widths_vary_give_the_same_events(tmp_path: Path) -> None:
    """As people draw them: the inner borders of a straight road sway by a third of a metre."""
    true = straight_recording(1)
    names = write_exid(tmp_path, true, utm=UTM, walkers=0)
    drawn = LaneletMap()
    along = np.arange(-850.0, 2100.0, 10.0)
    sway = [0.0, *(0.33 * np.sin(along / 40.0 + k) for k in range(3)), 0.0]
    ways = [drawn.way(np.column_stack([along, -7.2 + 3.6 * k + sway[k] + 0.0 * along])) for k in range(5)]
    for right, left in pairwise(ways):
        drawn.lanelet(left, right)
    drawn.write(tmp_path / "place.osm")
    study = study_of(tmp_path, None)
    labels = label(read(study), study.labels)
    tracks = {names[name]: replace(track, vehicle=names[name]) for name, track in true.tracks.items() if name in names}
    found = found_events(label(replace(true, tracks=tracks), study.labels), labels)
    assert {name for name, of in found.items() if "change" in name and of.events} == {
        "left_lane_change",
        "right_lane_change",
    }
    assert sum(of.matched for of in found.values()) >= 0.99 * sum(of.events for of in found.values())
    assert sum(of.surplus for of in found.values()) <= 2  # who drives near a marking is now and then beyond it
    assert not any(labels.jumps.values())


def test_a_lanelet2_map_may_be_named_and_must_be_there(exid: tuple[Path, dict[str, str]], tmp_path: Path) -> None:
    true = motorway_recording()
    write_exid(tmp_path / "data", true, utm=UTM)
    named = write_lanelets(tmp_path / "elsewhere" / "place.osm", true.lanes)
    assert read(study_of(tmp_path / "data", str(named))).tracks
    with pytest.raises(InputError, match=r"there is no file .*gone.osm: give the Lanelet2 map of that place"):
        read(study_of(tmp_path / "data", str(tmp_path / "gone.osm")))
    with pytest.raises(InputError, match=r"lanelet \d+: is more than 20 km from the recording; give the map of its"):
        read(study_of(exid[0], str(named)))


def test_persons_are_left_out(exid: tuple[Path, dict[str, str]]) -> None:
    source = motion_source(study_of(exid[0]))
    place = source.load(str(exid[0]))
    assert "1 persons are left out" in source.remarks(place)
    assert "9000" not in recorded(source, place, 1).tracks


def test_coordinates_from_an_origin_in_utm_are_told_by_the_bounds_of_the_network(tmp_path: Path) -> None:
    network = scenarios.load(SCENARIO).network
    moved = tmp_path / "moved.net.xml"
    moved.write_text(network.read_text().replace('netOffset="0.000,0.000"', 'netOffset="-428333.55,-5539109.82"', 1))
    true = motorway_recording()
    # 4000 m east and north of where the network has its own origin.
    tracks = {name: replace(track, x=track.x - 9000.0, y=track.y - 7000.0) for name, track in true.tracks.items()}
    utm = (428333.55 + 9000.0, 5539109.82 + 7000.0)
    names = write_exid(tmp_path / "utm", replace(true, tracks=tracks), utm=utm)
    again = read(study_of(tmp_path / "utm", str(moved)))
    for name, number in names.items():
        if number in again.tracks:
            mine, track = again.tracks[number], true.tracks[name]
            rows = (mine.first_step + np.arange(len(mine))) * 4 - track.first_step
            assert np.abs(mine.x - track.x[rows]).max() <= 0.001


def test_a_road_elsewhere_is_refused(exid: tuple[Path, dict[str, str]], tmp_path: Path) -> None:
    folder, _ = exid
    with pytest.raises(
        InputError, match=r"does not say where lanes are; name a Lanelet2 map or a network of that place by --network"
    ):
        read(study_of(folder, None))
    with pytest.raises(InputError, match=r"\d+% of its positions are on no lane of .*such as row \d+; give the road"):
        read(study_of(folder, "straight_road"))
    shutil.copytree(folder, tmp_path / "far")
    file = tmp_path / "far" / "03_tracks.csv"
    header, *rows = file.read_text().splitlines()
    at = header.split(",").index("xCenter")
    far = [",".join([*row[:at], "90000.0", *row[at + 1 :]]) for row in (line.split(",") for line in rows)]
    file.write_text("\n".join([header, *far]) + "\n")
    with pytest.raises(InputError, match=r"most of its positions, such as 9000\d.*are outside .*name a network"):
        read(study_of(tmp_path / "far"))


def test_a_car_without_size_is_refused(exid: tuple[Path, dict[str, str]], tmp_path: Path) -> None:
    shutil.copytree(exid[0], tmp_path / "sizes")
    meta = tmp_path / "sizes" / "03_tracksMeta.csv"
    meta.write_text(meta.read_text().replace(",0.0,0.0,pedestrian", ",0.0,0.0,car"))
    with pytest.raises(InputError, match=r"vehicle 9000 is 0 m x 0 m; give more than 0"):
        read(study_of(tmp_path / "sizes"))
