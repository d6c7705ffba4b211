"""SUMO's floating car data, written from a recording in each format, gives the recording back."""

from __future__ import annotations

import gzip
import os
import re
import subprocess
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import sumo

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios import scenario as scenarios
from isac_cosim.isacsim.traffic.recordings.recording import COLUMNS
from isac_cosim.isacsim.traffic.sources.protocol import recorded
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.generation.episode import shard_of
from isac_cosim.labeling.generation.settings import DatasetStudy
from tests.support.event_match import found_events
from tests.support.reading import fcd_study, read
from tests.support.sumo_recording import SCENARIO, motorway_recording
from tests.support.trajectory_writers import State, states, write_fcd

FORMATS = ("xml", "csv", "parquet", "xml.gz", "csv.gz", "parquet.gz")


def study_of(file: Path, network: str = SCENARIO, **fcd: object) -> DatasetStudy:
    return fcd_study(file, network, **fcd)


@pytest.fixture(scope="module")
def at_25_hz() -> dict[float, list[State]]:
    return states(motorway_recording(), every=4)


@pytest.mark.parametrize("kind", FORMATS)
def test_positions_come_back_to_the_formats_rounding(
    kind: str, at_25_hz: dict[float, list[State]], tmp_path: Path
) -> None:
    true = motorway_recording()
    again = read(study_of(write_fcd(tmp_path / f"drive.{kind}", at_25_hz, persons=True)))
    assert again.step_s == 0.04
    assert again.tracks.keys() == {name for name, track in true.tracks.items() if len(track) >= 12}
    for name, track in again.tracks.items():
        rows = (track.first_step + np.arange(len(track))) * 4 - true.tracks[name].first_step
        assert np.abs(track.x - true.tracks[name].x[rows]).max() <= 0.0051
        assert np.abs(track.y - true.tracks[name].y[rows]).max() <= 0.0051
        assert (track.lane == true.tracks[name].lane[rows]).all()
        assert np.abs(track.lane_lat - true.tracks[name].lane_lat[rows]).max() <= 0.06
        assert np.median(np.abs(track.speed - true.tracks[name].speed[rows])) < 0.15


def test_one_drive_in_three_formats_is_one_dataset(at_25_hz: dict[float, list[State]], tmp_path: Path) -> None:
    shards: list[bytes] = []
    for kind in ("xml.gz", "csv", "parquet"):
        study = study_of(write_fcd(tmp_path / f"drive.{kind}", at_25_hz))
        study = study.model_copy(update={"selection": study.selection.model_copy(update={"per_class": 2})})
        source = motion_source(study)
        place = source.load(study.scenarios[0])
        folder = tmp_path / kind / "shards"
        folder.mkdir(parents=True)
        shard_of(study, place, recorded(source, place, 1), folder, "0" * 64)
        shards += [file.read_bytes() for file in folder.iterdir()]
    assert len(shards) == 3
    assert len(set(shards)) == 1


def test_events_come_back(at_25_hz: dict[float, list[State]], tmp_path: Path) -> None:
    study = study_of(write_fcd(tmp_path / "drive.parquet", at_25_hz))
    found = found_events(label(motorway_recording(), study.labels), label(read(study), study.labels))
    events = sum(of.events for of in found.values())
    assert events > 20
    assert sum(of.matched for of in found.values()) >= 0.99 * events
    assert sum(of.surplus for of in found.values()) <= 0.01 * events
    for of in found.values():
        assert max(of.medians_s) <= 0.1


def test_vehicles_have_the_classes_and_sizes_of_their_types(at_25_hz: dict[float, list[State]], tmp_path: Path) -> None:
    types = tmp_path / "types.add.xml"
    types.write_text('<additional><vType id="car" vClass="truck" width="2.5"/></additional>')
    file = write_fcd(tmp_path / "drive.parquet", at_25_hz)
    track = next(iter(read(study_of(file, types=[str(types)])).tracks.values()))
    assert (track.kind, track.length_m, track.width_m) == ("truck", 7.1, 2.5)
    unknown = study_of(file)
    source = motion_source(unknown)
    track = next(iter(read(unknown).tracks.values()))
    assert (track.kind, track.length_m, track.width_m) == ("passenger", 5.0, 1.8)
    assert "no file names the types car" in " ".join(source.remarks(source.load(str(file))))


def test_blocks_have_gaps_and_no_vehicle_is_target_in_two(at_25_hz: dict[float, list[State]], tmp_path: Path) -> None:
    study = study_of(write_fcd(tmp_path / "drive.parquet", at_25_hz), block_min=0.2, gap_s=3.0)
    source = motion_source(study)
    place = source.load(study.scenarios[0])
    assert list(source.seeds(place) or ()) == [1, 2, 3]
    parts = [recorded(source, place, seed) for seed in (1, 2, 3)]
    spans = [
        (min(t.first_step for t in part.tracks.values()), max(t.first_step + len(t) for t in part.tracks.values()))
        for part in parts
    ]
    assert all(0.04 * (later[0] - earlier[1]) == pytest.approx(3.0, abs=0.1) for earlier, later in pairwise(spans))
    mine = [{name for name, track in part.tracks.items() if not track.bystander} for part in parts]
    assert all(mine)
    assert len(mine[0] | mine[1] | mine[2]) == sum(map(len, mine))
    assert any(track.bystander for track in parts[1].tracks.values())
    labels = label(parts[1], study.labels)
    assert labels.events


def test_unshifted_coordinates_are_told_by_the_bounds_of_the_network(
    at_25_hz: dict[float, list[State]], tmp_path: Path
) -> None:
    network = scenarios.load(SCENARIO).network
    moved = tmp_path / "moved.net.xml"
    moved.write_text(network.read_text().replace('netOffset="0.000,0.000"', 'netOffset="-428333.55,-5539109.82"', 1))
    shifted = {
        time: [
            State(s.vehicle, s.x + 428333.55, s.y + 5539109.82, s.angle, s.kind, s.speed, s.pos, s.lane)
            for s in present
        ]
        for time, present in at_25_hz.items()
    }
    again = read(study_of(write_fcd(tmp_path / "drive.parquet", shifted), str(moved)))
    plain = read(study_of(write_fcd(tmp_path / "plain.parquet", at_25_hz)))
    for name, track in plain.tracks.items():
        assert np.abs(again.tracks[name].x - track.x).max() < 1e-6


def test_sumos_own_output_is_read_in_every_format(tmp_path: Path) -> None:
    """The writers of the other tests are held against SUMO itself."""
    home = Path(sumo.SUMO_HOME)
    place = scenarios.load(SCENARIO)
    command = [
        str(home / "bin" / "sumo"), "--net-file", str(place.network), "--route-files", str(place.demand[0]),
        "--end", "25",
        "--step-length", "0.1", "--lateral-resolution", "5", "--no-step-log", "--seed", "5",
    ]  # fmt: skip
    recordings = []
    for kind in ("xml", "csv", "parquet"):
        subprocess.run([*command, "--fcd-output", str(tmp_path / f"own.{kind}")], check=True, capture_output=True,
                       env={**os.environ, "SUMO_HOME": str(home)})  # fmt: skip
        recordings.append(read(study_of(tmp_path / f"own.{kind}")))
    xml, csv, parquet = recordings
    assert len(xml.tracks) > 5
    for name, track in xml.tracks.items():
        for column in COLUMNS:
            assert (getattr(track, column) == getattr(csv.tracks[name], column)).all()
        assert np.abs(track.x - parquet.tracks[name].x).max() <= 0.01  # Parquet is not rounded


def test_sumo_replays_what_the_writers_write(at_25_hz: dict[float, list[State]], tmp_path: Path) -> None:
    """Each vehicle is where SUMO puts it, but at its first instant, at which SUMO inserts it in its lane."""
    write_fcd(tmp_path / "drive.xml", at_25_hz)
    (tmp_path / "types.add.xml").write_text('<additional><vType id="car"/></additional>')
    home, network = Path(sumo.SUMO_HOME), scenarios.load(SCENARIO).network
    command = [
        str(home / "bin" / "sumo"), "--net-file", str(network), "--additional-files", "types.add.xml",
        "--device.fcd-replay.files", "drive.xml", "--begin", str(min(at_25_hz)), "--end", str(max(at_25_hz)),
        "--step-length", "0.04", "--insertion-checks", "none", "--eager-insert", "true", "--no-warnings", "true",
        "--collision.action", "none", "--time-to-teleport", "-1", "--no-step-log", "--fcd-output", "out.xml",
    ]  # fmt: skip
    environment = {**os.environ, "SUMO_HOME": str(home)}
    subprocess.run(command, check=True, capture_output=True, cwd=tmp_path, env=environment)
    written, driven = (read(study_of(tmp_path / name)) for name in ("drive.xml", "out.xml"))
    compared = 0
    for name, track in written.tracks.items():
        if name in driven.tracks:
            other = driven.tracks[name]
            after = max(track.first_step, other.first_step) + 5
            until = min(track.first_step + len(track), other.first_step + len(other)) - 5
            ours, sumos = (slice(after - of.first_step, until - of.first_step) for of in (track, other))
            compared += max(0, until - after)
            assert np.abs(track.x[ours] - other.x[sumos]).max(initial=0.0) <= 0.011
            assert np.abs(track.y[ours] - other.y[sumos]).max(initial=0.0) <= 0.011
    assert compared > 0.9 * sum(map(len, written.tracks.values()))


def rows_of(text: str) -> list[list[str]]:
    return [line.split(";") for line in text.splitlines()]


def table(rows: list[list[str]]) -> str:
    return "\n".join(";".join(row) for row in rows) + "\n"


def without(name: str) -> Callable[[str], str]:
    def change(text: str) -> str:
        rows = rows_of(text)
        at = rows[0].index(name)
        return table([row[:at] + row[at + 1 :] for row in rows])

    return change


def scaled(name: str, factor: float) -> Callable[[str], str]:
    def change(text: str) -> str:
        rows = rows_of(text)
        at = rows[0].index(name)
        return table([rows[0], *([*row[:at], str(float(row[at]) * factor), *row[at + 1 :]] for row in rows[1:])])

    return change


def row_with(at: int, name: str, value: str) -> Callable[[str], str]:
    def change(text: str) -> str:
        rows = rows_of(text)
        rows[at][rows[0].index(name)] = value
        return table(rows)

    return change


def back_in_time(text: str) -> str:
    rows = rows_of(text)
    return table([rows[0], *rows[-3:], *rows[1:-3]])


BAD = {
    "no column": (without("vehicle_lane"), r"has no column vehicle_lane \(it has .*write it with that column"),
    "speeds in km/h": (scaled("vehicle_speed", 3.6), r"speeds are 3\.\d+ times those of its positions"),
    "elsewhere": (scaled("vehicle_x", 500.0), r"most of its positions.*name the network that was driven on"),
    "no number": (row_with(5, "vehicle_x", "wide"), r"cannot be read as a table \(.*wide"),
    "not finite": (row_with(5, "vehicle_y", "inf"), r"row 6: y is inf"),
    "no speed of a vehicle": (row_with(5, "vehicle_speed", "1e308"), r"row 6: speed is 1e\+308; fix it"),
    "a lane of another network": (row_with(5, "vehicle_lane", "e7_0"), r"row 6: lane e7_0 is not in .*\.net\.xml"),
    "twice": (lambda text: text + text.splitlines()[-1] + "\n", r"vehicle \S+ has two states at \S+ s \(rows \d+"),
    "time runs backwards": (back_in_time, r"row 5: time runs backwards"),
    "cut off": (lambda text: text[:-40], r"cannot be read as a table .*it may be cut off"),
    "no lanes": (
        lambda text: table([[*row[:8], row[8] if k < 9 else "", *row[9:]] for k, row in enumerate(rows_of(text))]),
        r"\d+% of its states name no lane, such as row 10; write FCD with x, y and lane",
    ),
    "quotation marks": (
        lambda text: table([[*row[:9], '"' if k else row[9], *row[10:]] for k, row in enumerate(rows_of(text))]),
        r"\d+ lines are \d+ rows, because a quotation mark is not closed on its line; leave it out",
    ),
    "no vehicle": (lambda text: text.splitlines()[0] + "\n", r"holds no vehicle"),
    "between steps": (row_with(-1, "timestep_time", "9999.013"), r"is at 9999\.01 s, between two of the steps of"),
}  # fmt: skip


@pytest.mark.parametrize("fault", BAD)
def test_bad_input_is_refused_in_one_line(fault: str, at_25_hz: dict[float, list[State]], tmp_path: Path) -> None:
    change, message = BAD[fault]
    few = dict(list(at_25_hz.items())[:200])
    file = write_fcd(tmp_path / "drive.csv", few)
    file.write_text(change(file.read_text()))
    with pytest.raises(InputError) as refused:
        read(study_of(file, least_s=1.0))
    assert re.search(message, str(refused.value)), refused.value
    assert "\n" not in str(refused.value)
    assert str(refused.value).startswith(str(file))


def test_more_bad_input(at_25_hz: dict[float, list[State]], tmp_path: Path) -> None:
    few = dict(list(at_25_hz.items())[:200])
    short = write_fcd(tmp_path / "drive.csv", dict(list(few.items())[:30]))
    with pytest.raises(InputError, match=r"no vehicle is seen for 6\.6 s; \S+ is seen longest, for 1\.16 s"):
        read(study_of(short))
    with pytest.raises(InputError, match="name the network by --network"):
        read(study_of(short, network=None))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="is a folder"):
        read(study_of(tmp_path))
    with pytest.raises(InputError, match="there is no file"):
        read(study_of(tmp_path / "other.csv"))
    xml = write_fcd(tmp_path / "cut.xml", few)
    xml.write_bytes(xml.read_bytes()[:-300])
    with pytest.raises(InputError, match="cannot be read as XML"):
        read(study_of(xml))
    zipped = write_fcd(tmp_path / "cut.csv.gz", few)
    zipped.write_bytes(zipped.read_bytes()[:-3000])
    with pytest.raises(InputError, match="cannot be read as a table"):
        read(study_of(zipped))
    bomb = tmp_path / "bomb.csv.gz"
    bomb.write_bytes(
        gzip.compress(b"timestep_time;vehicle_id;vehicle_x;vehicle_y;vehicle_lane\n" + b"0;;;;\n" * 20_000_000)
    )
    with pytest.raises(InputError, match="holds more than 64 MB"):
        read(study_of(bomb))
    entity = tmp_path / "entity.xml"
    entity.write_text('<!DOCTYPE a [<!ENTITY b "c">]><fcd-export/>')
    with pytest.raises(InputError, match="declares a document type"):
        read(study_of(entity))
    other = tmp_path / "other.xml"
    other.write_text("<routes/>")
    with pytest.raises(InputError, match="is no FCD: its first element is routes"):
        read(study_of(other))


def test_lane_changes_that_take_no_time_are_refused(at_25_hz: dict[float, list[State]], tmp_path: Path) -> None:
    """SUMO without its sublane model moves a vehicle by a lane in one step."""
    lanes = {lane.id: lane for lane in motorway_recording().lanes}
    jumping = {
        time: [
            State(s.vehicle, s.x, s.y, s.angle, s.kind, s.speed, s.pos, s.lane)
            if "in" not in s.lane or lanes[s.lane].edge != "runin"
            else State(
                s.vehicle, s.x, float(np.interp(s.x, *lanes[s.lane].shape.T)), s.angle, s.kind, s.speed, s.pos, s.lane
            )
            for s in present
        ]
        for time, present in at_25_hz.items()
    }
    jumping = {time: [s for s in present if s.lane.startswith("runin")] for time, present in jumping.items()}
    with pytest.raises(InputError, match=r"\d+ of \d+ lane changes take no time"):
        read(study_of(write_fcd(tmp_path / "drive.csv", jumping)))
