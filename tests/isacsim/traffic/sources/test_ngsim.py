"""Recordings in the format of NGSIM, written from simulated traffic, give that traffic back."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.traffic.sources.protocol import recorded
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.isacsim.traffic.trajectory_files.standing import steadied
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.generation.settings import DatasetStudy
from tests.support.event_match import found_events
from tests.support.highd_writer import straight_recording
from tests.support.ngsim_writer import LEFT_EDGE_M, START_M, Row, ngsim_rows, straight, write_csv, write_txt
from tests.support.reading import read


def study_of(file: Path, **ngsim: object) -> DatasetStudy:
    content = {"source": "ngsim", "scenarios": [str(file)], "ngsim": {"block_min": 60.0, "noise_m": 0.0, **ngsim}}
    return DatasetStudy.model_validate(content)


@lru_cache(maxsize=1)
def plain() -> tuple[list[Row], dict[str, str]]:
    return ngsim_rows(straight_recording())


def changed(file: Path, change: Callable[[list[Row]], list[Row]]) -> Path:
    return write_txt(file, change([dict(row) for row in plain()[0]]))


def test_positions_come_back_in_metres_with_lanes_from_the_left(tmp_path: Path) -> None:
    rows, names = plain()
    again = read(study_of(write_txt(tmp_path / "trajectories.txt", rows)))
    assert again.step_s == pytest.approx(0.05)  # ten times a second, sampled twice as often
    assert [lane.id for lane in again.lanes] == ["road_4", "road_3", "road_2", "road_1"]
    other_lanes = states = 0
    for name, true in straight_recording().tracks.items():
        if name not in names:
            continue
        track = again.tracks[names[name]]
        mine = np.arange(0, len(track), 2)
        at = (track.first_step + mine) * 5 - true.first_step
        moving = np.abs(true.speed[at]) > 1.5
        assert np.abs(track.x[mine] + START_M - true.x[at]).max() <= 0.0002
        assert np.abs(track.y[mine] + LEFT_EDGE_M - true.y[at])[moving].max() <= 0.0002
        states += len(at)
        other_lanes += int((np.array([again.lanes[k].index for k in track.lane[mine]]) != true.lane[at]).sum())
        assert (track.length_m, track.kind) == (pytest.approx(true.length_m, abs=0.002), "passenger")
    assert states > 10_000
    # The markings lie between the fitted centre lines, a few centimetres from where they were.
    assert other_lanes <= 0.01 * states


@pytest.mark.parametrize("bend", [straight, lambda along: 3.0 * np.sin(along / 400.0)], ids=["straight", "bent"])
def test_events_come_back(bend: Callable[[np.ndarray], np.ndarray], tmp_path: Path) -> None:
    rows, names = ngsim_rows(straight_recording(), bend=bend)
    study = study_of(write_txt(tmp_path / "trajectories.txt", rows))
    true = straight_recording()
    tracks = {names[name]: replace(track, vehicle=names[name]) for name, track in true.tracks.items() if name in names}
    found = found_events(label(replace(true, tracks=tracks), study.labels), label(read(study), study.labels))
    events = sum(of.events for of in found.values())
    assert events > 20
    assert sum(of.matched for of in found.values()) >= 0.99 * events
    assert sum(of.surplus for of in found.values()) == 0
    assert all(max(of.medians_s) <= 0.1 for of in found.values())


def test_blanks_commas_headers_and_order_make_no_difference(tmp_path: Path) -> None:
    rows, _ = plain()
    first = read(study_of(write_txt(tmp_path / "a.txt", rows)))
    order = np.random.default_rng(3).permutation(len(rows)).tolist()
    places = ["us-101"] * len(rows)
    headless = tmp_path / "c.txt"
    headless.write_text("\n".join(write_csv(tmp_path / "c.csv", rows).read_text().splitlines()[1:]) + "\n")
    for file in (tmp_path / "c.csv", headless, write_csv(tmp_path / "d.csv", rows, places, order)):
        again = read(study_of(file))
        assert again.tracks.keys() == first.tracks.keys()
        for name, track in first.tracks.items():
            assert track.first_step == again.tracks[name].first_step
            assert np.array_equal(track.x, again.tracks[name].x)
            assert np.array_equal(track.y, again.tracks[name].y)
            assert np.array_equal(track.lane, again.tracks[name].lane)


def test_one_place_of_a_file_with_several(tmp_path: Path) -> None:
    rows, names = plain()
    others, _ = ngsim_rows(straight_recording(), later_ms=-86_400_000)
    places = ["i-80"] * len(rows) + ["us-101"] * len(others)
    file = write_csv(tmp_path / "all.csv", [*rows, *others], places)
    with pytest.raises(InputError, match=r"holds the places i-80, us-101; name one of them in \[dataset.ngsim\]"):
        read(study_of(file))
    with pytest.raises(InputError, match=r"holds no place us-66, but i-80, us-101"):
        read(study_of(file, location="us-66"))
    assert read(study_of(file, location="i-80")).tracks.keys() == set(names.values())
    with pytest.raises(InputError, match="has no column Location; leave out the setting"):
        read(study_of(write_txt(tmp_path / "a.txt", rows), location="i-80"))


def test_periods_whose_ids_and_frames_begin_anew_are_vehicles_and_blocks_of_their_own(tmp_path: Path) -> None:
    rows, names = plain()
    later, _ = ngsim_rows(straight_recording(), later_ms=3_600_000, frames_from=100)
    source = motion_source(study := study_of(write_txt(tmp_path / "both.txt", [*rows, *later])))
    place = source.load(study.scenarios[0])
    assert list(source.seeds(place) or ()) == [1, 2]
    first, second = (recorded(source, place, seed) for seed in (1, 2))
    assert first.tracks.keys() == set(names.values())
    assert second.tracks.keys() == {f"{name}@2" for name in names.values()}
    for name, track in first.tracks.items():
        again = second.tracks[f"{name}@2"]
        assert (again.first_step - track.first_step) * first.step_s == pytest.approx(3600.0)
        assert not again.bystander
        assert np.array_equal(again.x, track.x)


def test_rows_that_are_there_twice_are_left_out_once(tmp_path: Path) -> None:
    rows, _ = plain()
    source = motion_source(study := study_of(write_txt(tmp_path / "twice.txt", [*rows, *rows[:7]])))
    assert "7 rows are there twice, and left out once" in source.remarks(source.load(study.scenarios[0]))


def test_a_standing_vehicle_that_jitters_changes_no_lane(tmp_path: Path) -> None:
    """A queue in lane 2 stands for 20 s, while its places jitter by a metre across the marking."""
    rng = np.random.default_rng(5)
    rows: list[Row] = [dict(row) for row in plain()[0]]
    sample = rows[0]
    for k in range(8):
        for frame in range(400):
            along = 1500.0 - 12.0 * k + 10.0 * min(frame / 10.0, 10.0) + 10.0 * max(frame / 10.0 - 30.0, 0.0)
            stands = 100 < frame < 300
            across = 5.4 + (rng.normal(0.0, 1.0) if stands else 0.0)
            rows.append(
                sample | {"Vehicle_ID": 900 + k, "Frame_ID": 450 + frame, "Total_Frames": 400, "Lane_ID": 2,
                          "Global_Time": int(sample["Global_Time"]) + (450 + frame - int(sample["Frame_ID"])) * 100,
                          "Local_X": round(across / 0.3048, 3), "Local_Y": round(along / 0.3048, 3),
                          "v_Vel": 0.0 if stands else 32.808}
            )  # fmt: skip
    study = study_of(write_txt(tmp_path / "queue.txt", rows))
    labels = label(read(study), study.labels)
    sideways = {"left_lane_change", "right_lane_change", "evasive_swerve", "overtake"}
    assert not [event for event in labels.events if event.vehicle.startswith("90") and event.intention.text in sideways]


@given(st.lists(st.floats(0.0, 30.0), min_size=3, max_size=30), st.randoms(use_true_random=False))
def test_a_lateral_place_moves_no_further_than_before_and_after(speeds: list[float], random: object) -> None:
    time_s = np.arange(len(speeds) * 5) / 10.0
    along = np.cumsum(np.repeat(speeds, 5)) / 10.0
    left = np.array([random.uniform(-2.0, 2.0) for _ in time_s])  # type: ignore[attr-defined]
    steady = steadied(along, left, time_s, np.zeros(len(left), np.int32))
    assert steady.min() >= left.min()
    assert steady.max() <= left.max()
    stands = along[1:] == along[:-1]
    inner = stands[:-2] & stands[1:-1] & stands[2:]
    changed = np.diff(steady)[1:-1][inner]
    long_still = np.array([len(set(along[max(0, k - 6) : k + 8].tolist())) == 1 for k in np.flatnonzero(inner)], bool)
    assert np.abs(changed[long_still]).max(initial=0.0) <= 1e-12


@settings(max_examples=10, deadline=None)
@given(st.lists(st.integers(2, 140), min_size=2, max_size=4), st.booleans())
def test_ids_are_used_again_after_a_pause_and_not_after_a_gap(
    tmp_path_factory: pytest.TempPathFactory, gaps: list[int], another: bool
) -> None:
    """One number is seen for 3 s at a time, with pauses of so many frames between; `another`: as a longer vehicle."""
    rows: list[Row] = [row for row in plain()[0] if int(row["Vehicle_ID"]) < 12]
    sample, frame, pauses = rows[0], 450, list(gaps)
    for k, pause in enumerate([0, *pauses]):
        frame += pause
        for _ in range(30):
            rows.append(
                sample | {"Vehicle_ID": 7777, "Frame_ID": frame, "Total_Frames": 30, "Lane_ID": 2,
                          "v_Length": 15.0 + 2.0 * (another and k),
                          "Global_Time": int(sample["Global_Time"]) + (frame - int(sample["Frame_ID"])) * 100,
                          "Local_X": round(5.4 / 0.3048, 3), "Local_Y": round((frame - 440) * 1.0 / 0.3048, 3),
                          "v_Vel": 32.808}
            )  # fmt: skip
            frame += 1
    again = read(study_of(write_txt(tmp_path_factory.mktemp("again") / "file.txt", rows)))
    mine = [track for name, track in again.tracks.items() if re.match(r"7777\b", name)]
    # A pause of so many frames leaves one more step between two states; gaps of up to 0.3 s are no end of a track.
    ends = [another or pause + 1 > 3 for pause in pauses]
    assert len(mine) == 1 + sum(ends)
    new = [another or (pause + 1) * 100 > 5000 for pause in pauses]
    assert len({track.vehicle.partition("#")[0] for track in mine}) == 1 + sum(new)
    spans = sorted((track.first_step, track.first_step + len(track)) for track in mine)
    assert all(later[0] >= earlier[1] for earlier, later in pairwise(spans))


def everywhere(**values: Callable[[float], object]) -> Callable[[list[Row]], list[Row]]:
    def change(rows: list[Row]) -> list[Row]:
        return [row | {name: of(float(row[name])) for name, of in values.items()} for row in rows]  # type: ignore[dict-item]

    return change


def at_row(number: int, **values: object) -> Callable[[list[Row]], list[Row]]:
    def change(rows: list[Row]) -> list[Row]:
        rows[number - 1] |= values  # type: ignore[arg-type]
        return rows

    return change


BAD = {
    "metres": (everywhere(v_Length=lambda value: value * 0.3048), r"median car is 1\.\d+ m long"),
    "speeds in km/h": (everywhere(v_Vel=lambda value: value * 0.3048 * 3.6 * 3), r"speeds are 3\.\d+ times those of"),
    "mirrored": (everywhere(Local_X=lambda value: -value), r"its lanes are 4, 3, 2, 1 from the left, and lane 1 is"),
    "a street": (everywhere(Lane_ID=lambda value: value + 10), r"100% of its positions are in no lane of a freeway"),
    "no class": (at_row(1, v_Class=9), r"row \d+: v_Class is 9; give 1 \(motorcycle\), 2"),
    "no size": (at_row(1, v_Length=0.0), r"row \d+: vehicle 1 is 0 m x \S+ m; give more than 0 and at most 100 m"),
    "no number": (at_row(5, Local_X="wide"), r"cannot be read as a table \(.*wide"),
    "not finite": (at_row(5, Local_Y="inf"), r"row 5: Local_Y is inf; fix it"),
    "no speed of a vehicle": (at_row(5, v_Vel="-inf"), r"row 5: v_Vel is -inf; fix it"),
    "missing": (at_row(5, Local_Y="nan"), r"row 5: Local_Y is missing; fix it"),
    "half a lane": (at_row(5, Lane_ID=2.5), r"row 5: Lane_ID is 2\.5, which is no whole number"),
    "twice": (lambda rows: [*rows, rows[5] | {"Local_X": 1.0}], r"vehicle 1 has two states at \S+ s \(rows 6"),
    "between steps": (at_row(9, Global_Time=1118846984233), r"row 9 is at \S+ s, between two of the steps of 0\.1 s"),
    "nothing": (lambda rows: [], r"holds no state of a vehicle"),
}  # fmt: skip


@pytest.mark.parametrize("fault", BAD)
def test_bad_input_is_refused_in_one_line(fault: str, tmp_path: Path) -> None:
    change, message = BAD[fault]
    file = changed(tmp_path / "trajectories.txt", change)
    with pytest.raises(InputError) as refused:
        read(study_of(file))
    assert re.search(message, str(refused.value)), refused.value
    assert "\n" not in str(refused.value)
    assert str(refused.value).startswith(str(file))


def test_more_bad_input(tmp_path: Path) -> None:
    rows, _ = plain()
    file = write_txt(tmp_path / "trajectories.txt", rows)
    file.write_text(file.read_text()[:-100])
    with pytest.raises(InputError, match=r"row \d+: has not 18 columns; leave it out, or fix it"):
        read(study_of(file))
    lines = write_txt(file, rows).read_text().splitlines()
    for wrong in (lines[40].rsplit(maxsplit=1)[0], f"{lines[40]} 1"):
        file.write_text("\n".join([*lines[:40], wrong, *lines[41:], ""]))
        with pytest.raises(InputError, match=r"row 41: has not 18 columns; leave it out, or fix it"):
            read(study_of(file))
    file.write_text("\n".join([*lines, "", ""]))
    assert len(read(study_of(file)).tracks)
    noise = tmp_path / "noise.csv"
    noise.write_bytes(b"a,b\x00\x07")
    with pytest.raises(InputError, match=r"noise\.csv: is neither text nor Parquet; give a CSV or a Parquet file"):
        read(study_of(noise))
    table = write_csv(tmp_path / "table.csv", rows)
    table.write_text(table.read_text().replace("Lane_ID", "Lane", 1))
    with pytest.raises(InputError, match=r"table\.csv: has no column lane_id"):
        read(study_of(table))
    with pytest.raises(InputError, match="is a folder; give a file of NGSIM"):
        read(study_of(tmp_path))
    with pytest.raises(InputError, match=r"no vehicle is seen for 120 s; \d+ is seen longest"):
        read(study_of(write_txt(tmp_path / "whole.txt", rows), least_s=120.0))


@pytest.mark.parametrize("feet", [-1e6, 1e6])
def test_a_wrong_position_makes_no_road(feet: float, tmp_path: Path) -> None:
    def wrong(rows: list[Row]) -> list[Row]:
        rows[300]["Local_Y"] = feet
        return rows

    file = changed(tmp_path / "trajectories.txt", wrong)
    source = motion_source(study_of(file))
    place = source.load(str(file))
    sound_file = write_txt(tmp_path / "sound.txt", plain()[0])
    sound = motion_source(study_of(sound_file)).load(str(sound_file))
    ends = [[lane.shape[[0, -1], 0].tolist() for lane in road.lanes] for road in (place, sound)]
    assert ends[0] == ends[1]
    assert any(
        re.match(r"trajectories\.txt: row 301 lies \S+ m from where its vehicle is", line)
        for line in source.remarks(place)
    )


def test_a_file_that_ends_early_with_a_whole_row_is_refused(tmp_path: Path) -> None:
    """The vehicles of a file of one place follow each other; the file with all places is in any order."""
    cut = changed(tmp_path / "trajectories.txt", lambda rows: rows[:-3])
    last = plain()[0][-1]
    count = int(last["Total_Frames"])
    said = f"vehicle {last['Vehicle_ID']}, its last one, has {count - 3} rows, and Total_Frames says {count}: it is cut"
    with pytest.raises(InputError, match=said):
        read(study_of(cut))
    assert read(study_of(write_csv(tmp_path / "all.csv", plain()[0][:-3]))).tracks


@pytest.mark.slow
def test_the_last_vehicle_is_told_over_several_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("isac_cosim.isacsim.traffic.trajectory_files.ngsim_table.CHUNK", 7)
    assert read(study_of(write_txt(tmp_path / "trajectories.txt", plain()[0]))).tracks
    with pytest.raises(InputError, match="its last one, has"):
        read(study_of(changed(tmp_path / "trajectories.txt", lambda rows: rows[:-1])))
