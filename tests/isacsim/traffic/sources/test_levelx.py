"""Recordings of drivers in levelXdata's formats, written from simulated traffic, give that traffic back."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.isacsim.traffic.trajectory_files.roads.marked_lanes import MarkedCarriageway
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.generation.settings import DatasetStudy
from tests.support.event_match import found_events
from tests.support.highd_writer import LOWER, UPPER, renamed, straight_recording, write_highd
from tests.support.reading import read


def study_of(where: Path, **levelx: object) -> DatasetStudy:
    content = {"source": "levelx", "scenarios": [str(where)], "levelx": {"block_min": 60.0, **levelx}}
    return DatasetStudy.model_validate(content)


@pytest.fixture(scope="module")
def highd(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, int]]:
    """A recording with a carriageway in each direction, and the numbers of its vehicles."""
    folder = tmp_path_factory.mktemp("highd")
    return folder, write_highd(folder, straight_recording(2), straight_recording(1))


def test_positions_in_both_directions_come_back_to_the_formats_rounding(highd: tuple[Path, dict[str, int]]) -> None:
    folder, numbers = highd
    again = read(study_of(folder))
    assert again.step_s == 0.04
    seen = set()
    for half, seed, image in (("upper", 2, UPPER), ("lower", 1, LOWER)):
        for name, true in renamed(straight_recording(seed), numbers, half).tracks.items():
            if name not in again.tracks:
                assert len(true) < 12
                continue
            track = again.tracks[name]
            seen.add(name)
            rows = (track.first_step + np.arange(len(track))) * 4 - true.first_step
            assert np.abs(track.x - image.x(true.x[rows])).max() <= 0.0051
            assert np.abs(track.y + image.y(true.y[rows])).max() <= 0.0051
            lanes = [again.lanes[k] for k in track.lane.tolist()]
            assert {lane.edge for lane in lanes} == {half}
            # Rounding by up to half a centimetre may move a state over a marking.
            clear = np.abs(true.lane_lat[rows]) < 1.79
            assert (np.array([lane.index for lane in lanes])[clear] == true.lane[rows][clear]).all()
            assert np.abs(track.lane_lat - true.lane_lat[rows])[clear].max() <= 0.0051
            assert (track.length_m, track.width_m) == (true.length_m, true.width_m)
    assert seen == again.tracks.keys()


def test_events_in_both_directions_come_back(highd: tuple[Path, dict[str, int]]) -> None:
    folder, numbers = highd
    study = study_of(folder)
    mine = label(read(study), study.labels)
    halves = [
        label(renamed(straight_recording(seed), numbers, half), study.labels)
        for half, seed in (("upper", 2), ("lower", 1))
    ]
    true = replace(halves[0], events=halves[0].events + halves[1].events)
    found = found_events(true, mine)
    events = sum(of.events for of in found.values())
    assert events > 20
    assert {"left_lane_change", "right_lane_change", "hard_brake"} <= found.keys()
    assert sum(of.matched for of in found.values()) >= 0.99 * events
    assert sum(of.surplus for of in found.values()) <= 0.01 * events
    assert all(max(of.medians_s) <= 0.1 for of in found.values())


def test_a_scenario_is_named_like_its_file_and_depends_on_all_three(highd: tuple[Path, dict[str, int]]) -> None:
    folder, _ = highd
    source = motion_source(study_of(folder))
    by_folder, by_file = source.load(str(folder)), source.load(str(folder / "07_tracks.csv"))
    assert by_folder.name == by_file.name == "07"
    assert source.inputs(by_folder).keys() == {"07_tracks.csv", "07_tracksMeta.csv", "07_recordingMeta.csv"}
    assert by_folder.sites
    assert min(abs(site.y - lane.shape[0, 1]) for site in by_folder.sites for lane in by_folder.lanes) > 10.0


def test_frames_at_a_rate_that_is_no_whole_number_of_milliseconds(tmp_path: Path) -> None:
    write_highd(tmp_path, None, straight_recording(1))
    meta = tmp_path / "07_recordingMeta.csv"
    meta.write_text(meta.read_text().replace("7,25,", "7,29.97,", 1))
    again = read(study_of(tmp_path))
    assert again.step_s == pytest.approx(1 / 29.97)


@given(
    st.lists(st.floats(2.5, 5.0), min_size=1, max_size=6),
    st.floats(-50.0, 50.0),
    st.booleans(),
    st.floats(0.001, 0.999),
)
def test_a_place_between_two_markings_is_in_the_lane_between_them(
    widths: list[float], low: float, forward: bool, share: float
) -> None:
    markings = low + np.concatenate([[0.0], np.cumsum(widths)])
    road = MarkedCarriageway("road", markings, forward, 0.0, 100.0)
    for k, (a, b) in enumerate(pairwise(markings)):
        y = a + share * (b - a)
        lane = road.lanes[int(road.lane_of(np.array([y]))[0])]
        assert abs(y - lane.shape[0, 1]) <= lane.width_m / 2.0 + 1e-9
        # The rightmost lane is the first one, as its drivers see it.
        assert lane.index == (k if forward else len(widths) - 1 - k)
        assert (lane.shape[1, 0] > lane.shape[0, 0]) == forward
    outside = np.array([markings[0] - 1.5, markings[-1] + 1.5])
    assert road.lane_of(outside).tolist() == [-1, -1]


def rows_of(text: str) -> list[list[str]]:
    return [line.split(",") for line in text.splitlines()]


def table(rows: list[list[str]]) -> str:
    return "\n".join(",".join(row) for row in rows) + "\n"


def without(name: str) -> Callable[[str], str]:
    def change(text: str) -> str:
        rows = rows_of(text)
        at = rows[0].index(name)
        return table([row[:at] + row[at + 1 :] for row in rows])

    return change


def column(name: str, of: Callable[[str], object]) -> Callable[[str], str]:
    def change(text: str) -> str:
        rows = rows_of(text)
        at = rows[0].index(name)
        return table([rows[0], *([*row[:at], str(of(row[at])), *row[at + 1 :]] for row in rows[1:])])

    return change


def cell(row: int, name: str, value: str) -> Callable[[str], str]:
    def change(text: str) -> str:
        rows = rows_of(text)
        rows[row][rows[0].index(name)] = value
        return table(rows)

    return change


def swapped(text: str) -> str:
    rows = rows_of(text)
    rows[5], rows[6] = rows[6], rows[5]
    return table(rows)


BAD = {
    "no column": ("tracks", without("height"), r"_tracks\.csv: has no column height \(it has .*write it with"),
    "no class": ("tracksMeta", without("class"), r"_tracksMeta\.csv: has no column class"),
    "no rate": ("recordingMeta", without("frameRate"), r"_recordingMeta\.csv: has no column frameRate"),
    "rate of zero": ("recordingMeta", cell(1, "frameRate", "0"), r"row 2: frameRate is 0\.0; give frames per second"),
    "no markings": ("recordingMeta", without("lowerLaneMarkings"), r"\d+% of its positions are beyond the markings"),
    "one marking": ("recordingMeta", cell(1, "lowerLaneMarkings", "28.8"), r"Markings is 28\.8; give the y of"),
    "text for markings": ("recordingMeta", cell(1, "lowerLaneMarkings", "a;b"), r"Markings is a;b; give the y"),
    "two recordings": ("recordingMeta", lambda text: text + text.splitlines()[1] + "\n", r"has 2 rows and needs one"),
    "another size": ("tracksMeta", cell(6, "width", "0.45"), r"vehicle 6 is 0\.45 m x \S+ m, and \S+ m x \S+ m in 07"),
    "speeds in km/h": ("tracks", column("xVelocity", lambda text: float(text) * 3.6), r"speeds are 3\.\d+ times"),
    "x backwards": ("tracks", column("x", lambda text: -float(text)), r"row \d+: vehicle \d+ and most others drive ag"),
    "y upwards": ("tracks", column("y", lambda text: -float(text)), r"\d+% of its positions are beyond the markings"),
    "no number": ("tracks", cell(5, "x", "wide"), r"cannot be read as a table \(.*wide"),
    "missing": ("tracks", cell(5, "x", ""), r"row 6: x is missing; fix it"),
    "not finite": ("tracks", cell(5, "y", "inf"), r"row 6: y is inf; fix it"),
    "no speed of a vehicle": ("tracks", cell(5, "yVelocity", "1e308"), r"row 6: yVelocity is 1e\+308; fix it"),
    "twice": ("tracks", lambda text: text + text.splitlines()[-1] + "\n", r"vehicle \d+ has two states at \S+ s"),
    "time runs backwards": ("tracks", swapped, r"row 7: time runs backwards, from frame \d+ to \d+ of vehicle 1"),
    "cut off": ("tracks", lambda text: text[:-20], r"cannot be read as a table .*it may be cut off"),
    "no vehicle": ("tracks", lambda text: text.splitlines()[0] + "\n", r"holds no state of a vehicle"),
    "no vehicle named": ("tracksMeta", lambda text: text.splitlines()[0] + "\n", r"names no vehicle"),
    "a vehicle that is not named": ("tracksMeta", cell(3, "id", "9999"), r"row \d+: vehicle 3 is not in 07_tracksMeta"),
    "named twice": ("tracksMeta", cell(3, "id", "1"), r"vehicle 1 has two rows"),
    "no such direction": ("tracksMeta", cell(3, "drivingDirection", "0"), r"row 4: drivingDirection is 0; give 1"),
    "no size": ("tracksMeta", cell(3, "height", "0"), r"row 4: vehicle 3 is \S+ m x 0 m; give more than 0"),
}  # fmt: skip


@pytest.mark.parametrize("fault", BAD)
def test_bad_input_is_refused_in_one_line(fault: str, highd: tuple[Path, dict[str, int]], tmp_path: Path) -> None:
    kind, change, message = BAD[fault]
    folder = tmp_path / "recording"
    shutil.copytree(highd[0], folder)
    file = folder / f"07_{kind}.csv"
    file.write_text(change(file.read_text()))
    with pytest.raises(InputError) as refused:
        read(study_of(folder))
    assert re.search(message, str(refused.value)), refused.value
    assert "\n" not in str(refused.value)
    assert str(refused.value).startswith(str(folder))


def test_speeds_of_another_rate_are_told(highd: tuple[Path, dict[str, int]], tmp_path: Path) -> None:
    folder = tmp_path / "recording"
    shutil.copytree(highd[0], folder)
    meta = folder / "07_recordingMeta.csv"
    meta.write_text(cell(1, "frameRate", "30")(meta.read_text()))
    source = motion_source(study_of(folder))
    (remark,) = (remark for remark in source.remarks(source.load(str(folder))) if "speeds" in remark)
    assert re.search(
        r"by \d\.\d m/s in the median, and are 0\.83 times these: see whether rate and units are right", remark
    )


def test_missing_states_are_told(highd: tuple[Path, dict[str, int]], tmp_path: Path) -> None:
    folder = tmp_path / "recording"
    shutil.copytree(highd[0], folder)
    source = motion_source(study_of(folder))
    assert not any("fewer states" in remark for remark in source.remarks(source.load(str(folder))))
    lines = (folder / "07_tracks.csv").read_text().splitlines(keepends=True)
    (folder / "07_tracks.csv").write_text("".join(lines[:100] + lines[110:]))
    remarks = [*source.remarks(source.load(str(folder)))]
    assert re.match(r"1 of \d+ vehicles, such as \d+, have fewer states than 07_tracksMeta\.csv says", remarks[-1])


@pytest.mark.parametrize("left", [-1, -200, 900])
@pytest.mark.parametrize("columns", ["all", "no finalFrame"])
def test_tracks_that_end_early_with_a_whole_row_are_refused(
    left: int, columns: str, highd: tuple[Path, dict[str, int]], tmp_path: Path
) -> None:
    """Without the last frames in the meta file, where a vehicle is missing altogether."""
    folder = tmp_path / "recording"
    shutil.copytree(highd[0], folder)
    tracks, meta = folder / "07_tracks.csv", folder / "07_tracksMeta.csv"
    if columns != "all":
        meta.write_text(without("finalFrame")(meta.read_text()))
    tracks.write_text("".join(tracks.read_text().splitlines(keepends=True)[:left]))
    if columns != "all" and left == -1:
        assert read(study_of(folder)).tracks
        return
    with pytest.raises(
        InputError, match=r"07_tracks\.csv: vehicle \d+ .*, and \d+ of \d+ vehicles end .*it is cut off"
    ):
        read(study_of(folder))


@pytest.mark.parametrize("value", ["-1e6", "1e6", "-300.0", "4000"])
def test_a_wrong_position_makes_no_road(value: str, highd: tuple[Path, dict[str, int]], tmp_path: Path) -> None:
    """The sound recording shows 1,600 m of road."""
    folder = tmp_path / "recording"
    shutil.copytree(highd[0], folder)
    (folder / "07_tracks.csv").write_text(cell(400, "x", value)((folder / "07_tracks.csv").read_text()))
    source = motion_source(study_of(folder))
    place, sound = source.load(str(folder)), motion_source(study_of(highd[0])).load(str(highd[0]))
    assert [lane.shape.tolist() for lane in place.lanes] == [lane.shape.tolist() for lane in sound.lanes]
    assert place.sites == sound.sites
    assert any(
        re.match(r"07_tracks\.csv: row 401 lies \S+ m from where its vehicle is", line)
        for line in source.remarks(place)
    )


def test_lengths_in_feet_are_refused(highd: tuple[Path, dict[str, int]], tmp_path: Path) -> None:
    for file in highd[0].iterdir():
        feet = column("width", lambda text: float(text) * 3.28) if "width" in file.read_text() else str
        (tmp_path / file.name).write_text(feet(file.read_text()))
    with pytest.raises(InputError, match=r"median car is \d+\.\d+ m long"):
        read(study_of(tmp_path))


def test_what_is_no_recording_is_refused_with_what_to_name(highd: tuple[Path, dict[str, int]], tmp_path: Path) -> None:
    folder, _ = highd
    with pytest.raises(InputError, match="has no recording; name the tracks of each"):
        read(study_of(tmp_path))
    for number in ("07", "08"):
        for kind in ("tracks", "tracksMeta", "recordingMeta"):
            shutil.copy(folder / f"07_{kind}.csv", tmp_path / f"{number}_{kind}.csv")
    with pytest.raises(InputError, match=r"has 2 recordings; name the tracks .*07_tracks\.csv"):
        read(study_of(tmp_path))
    (tmp_path / "08_tracksMeta.csv").unlink()
    with pytest.raises(InputError, match=r"08_tracksMeta\.csv: is missing"):
        read(study_of(tmp_path / "08_tracks.csv"))
    with pytest.raises(InputError, match=r"is no recording of levelX; name its tracks"):
        read(study_of(tmp_path / "08_recordingMeta.csv"))


def test_a_recording_without_a_vehicle_long_enough_is_refused(tmp_path: Path) -> None:
    write_highd(tmp_path, None, straight_recording(1))
    with pytest.raises(InputError, match=r"no vehicle is seen for 120 s; \d+ is seen longest, for \d"):
        read(study_of(tmp_path, least_s=120.0))
