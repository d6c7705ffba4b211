"""Recordings by drones, read by lxd-io: the same vehicles at the same places, and the same map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from lxd_io import Dataset
from lxd_io.recording import Recording as OtherRecording

from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.isacsim.traffic.trajectory_files.observed import FileStates
from isac_cosim.isacsim.traffic.trajectory_files.roads.lanelets import lanelet_map_beside
from isac_cosim.labeling.generation.settings import DatasetStudy
from tests.support.exid_writer import write_exid
from tests.support.highd_writer import straight_recording, write_highd
from tests.support.lanelet_writer import UTM, write_lanelets
from tests.support.sumo_recording import motorway_recording


def observed(where: Path) -> FileStates:
    """What our reader makes of a recording: front bumper centres, vehicle after vehicle."""
    source = motion_source(DatasetStudy.model_validate({"source": "levelx", "scenarios": [str(where)]}))
    source.load(str(where))
    states: FileStates = source.open(where).observed  # type: ignore[attr-defined]
    return states


def read_by_other(folder: Path, number: int, dataset: str) -> OtherRecording:
    (folder / "data" / f"{number:02d}_background.png").touch()
    recording: OtherRecording = Dataset(folder, dataset, 1, 0, 1.0).get_recording(number)
    return recording


def spans(states: FileStates) -> dict[str, slice]:
    ends = states.starts.tolist()
    return {vehicle.id: slice(ends[k], ends[k + 1]) for k, vehicle in enumerate(states.vehicles)}


def test_highd_is_read_as_by_another_reader(tmp_path: Path) -> None:
    write_highd(tmp_path / "data", straight_recording(2), straight_recording(1))
    other = read_by_other(tmp_path, 7, "highd")
    states = observed(tmp_path / "data" / "07_tracks.csv")
    ours = spans(states)
    assert ours.keys() == {str(number) for number in other.track_ids}
    for number in other.track_ids:
        track, span = other.get_track(number), ours[str(number)]
        assert track.get_data("frame").tolist() == states.step[span].tolist()
        centre = track.get_local_trajectory()
        forward = 1.0 if track.get_meta_data("drivingDirection") == 2 else -1.0
        front = centre[:, 0] + forward * track.get_meta_data("width") / 2.0
        np.testing.assert_allclose(states.x[span], front, atol=1e-9)
        np.testing.assert_allclose(states.y[span], -centre[:, 1], atol=1e-9)


@pytest.mark.parametrize("name", ["maps/lanelets/1_place/location1.osm", "maps/lanelet2/1_place.osm"])
def test_exid_is_read_as_by_another_reader_and_has_the_same_map(tmp_path: Path, name: str) -> None:
    write_exid(tmp_path / "data", motorway_recording(), utm=UTM)
    write_lanelets(tmp_path / name, motorway_recording().lanes)
    (tmp_path / name).with_name("location12.osm").write_text("<osm/>")
    other = read_by_other(tmp_path, 3, "exid")
    tracks = tmp_path / "data" / "03_tracks.csv"
    assert lanelet_map_beside(tracks, str(other.location_id)) == other.lanelet2_map_file == tmp_path / name
    states = observed(tracks)
    ours = spans(states)
    people = {number for number in other.track_ids if other.get_track(number).get_meta_data("class") == "pedestrian"}
    assert ours.keys() == {str(number) for number in other.track_ids if number not in people}
    for number in {*other.track_ids} - people:
        track, span = other.get_track(number), ours[str(number)]
        assert track.get_data("frame").tolist() == states.step[span].tolist()
        turned = np.radians(track.get_data("heading"))
        half = track.get_meta_data("length") / 2.0 * np.column_stack([np.cos(turned), np.sin(turned)])
        front = track.get_local_trajectory() + half
        np.testing.assert_allclose(np.column_stack([states.x[span], states.y[span]]), front, atol=1e-9)
