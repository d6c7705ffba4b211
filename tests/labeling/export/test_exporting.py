"""Exports: SUMO replays what was written, its own converter reads it, tables hold the dataset's numbers."""

from __future__ import annotations

import errno
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import sumo

from isac_cosim.base.errors import InputError, OutputError
from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.base.workers.kept_workers import KeptWorkers
from isac_cosim.isacsim.scenarios.lane import Lane
from isac_cosim.isacsim.scenarios.scenario import Scenario, Site, load
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.labeling.dataset.dataset import SCALARS, STATE, Dataset
from isac_cosim.labeling.dataset.meta import write_meta
from isac_cosim.labeling.dataset.record_point import in_plane
from isac_cosim.labeling.export import floating_car_data, tables
from isac_cosim.labeling.export.exporting import export_episode, export_sample
from isac_cosim.labeling.export.floating_car_data import write_fcd
from tests.labeling.export.conftest import EPISODE
from tests.support.refusals import refusal

SUMO = Path(sumo.SUMO_HOME)
HOSTILE = '</fcd-export><script>alert("x")&'
States = dict[tuple[str, str], dict[str, str]]


@pytest.fixture(scope="module")
def replayed(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an export, with what `sumo` says that it replayed."""
    folder = tmp_path_factory.mktemp("exported") / "fcd"
    with LocalEngine(1).started() as pool:
        export_episode(dataset, EPISODE, "fcd", folder, KeptWorkers(lambda: pool, 1, 1))
    options = ("--fcd-output", "out.xml", "--precision", "17", "--xml-validation", "never", "--no-step-log")
    subprocess.run([SUMO / "bin" / "sumo", "-c", "replay.sumocfg", *options], cwd=folder, check=True)
    return folder


def states(path: Path) -> States:
    """The attributes of every vehicle at every instant."""
    return {
        (str(float(step.attrib["time"])), vehicle.attrib["id"]): vehicle.attrib
        for step in ElementTree.parse(path).getroot()
        for vehicle in step
    }


@pytest.mark.slow
def test_sumo_replays_every_vehicle_to_the_last_digit(replayed: Path) -> None:
    """But at its first instant, at which SUMO inserts it in the middle of the lane."""
    written, driven = states(replayed / "episode.fcd.xml"), states(replayed / "out.xml")
    assert len(written) > 10_000
    assert written.keys() == driven.keys()
    first = {}
    for key in sorted(written, key=lambda key: float(key[0])):
        first.setdefault(key[1], key)
    for name in ("x", "y", "speed"):
        pairs = [(float(written[key][name]), float(driven[key][name])) for key in written if first[key[1]] != key]
        ours, sumos = np.array(pairs).T
        # SUMO prints digits after the point, not significant ones.
        np.testing.assert_allclose(sumos, ours, rtol=1e-15, atol=1e-16)


@pytest.mark.slow
def test_it_holds_what_was_recorded(recording: Recording, replayed: Path) -> None:
    written = states(replayed / "episode.fcd.xml")
    types = {kind.attrib["id"]: kind.attrib for kind in ElementTree.parse(replayed / "types.add.xml").getroot()}
    assert {vehicle for _, vehicle in written} == recording.tracks.keys()
    for name, track in recording.tracks.items():
        steps = track.first_step + np.arange(len(track))
        for row in np.flatnonzero(steps % 10 == 0)[::20]:
            state = written[str(round(steps[row] * 0.01, 3)), name]
            assert float(state["x"]) == track.x[row]
            assert float(state["y"]) == track.y[row]
            assert float(state["speed"]) == track.speed[row]
            assert state["lane"] == recording.lanes[track.lane[row]].id
            kind = types[state["type"]]
            assert (float(kind["length"]), float(kind["width"])) == (track.length_m, track.width_m)
            assert kind["vClass"] == track.kind


@pytest.mark.slow
def test_the_sites_are_those_of_the_scenario(replayed: Path) -> None:
    """The export is itself a network with sites."""
    sites = {site.attrib["id"]: site for site in ElementTree.parse(replayed / "sites.add.xml").getroot()}
    for site in load("motorway").sites:
        poi = sites[site.id]
        assert (float(poi.attrib["x"]), float(poi.attrib["y"])) == pytest.approx((site.x, site.y), abs=0.006)


@pytest.mark.slow
def test_sumos_converter_reads_it(replayed: Path) -> None:
    options = ("--fcd-input", "episode.fcd.xml", "--ns2mobility-output", "ns2.tcl", "--gpx-output", "track.gpx")
    script = SUMO / "tools" / "traceExporter.py"
    subprocess.run([sys.executable, script, *options, "--net-input", "motorway.net.xml"], cwd=replayed, check=True)
    assert (replayed / "ns2.tcl").read_text().count("setdest") > 1000
    assert (replayed / "track.gpx").read_text().count("<trkpt") > 1000


def test_the_table_of_vehicles_is_the_recording(
    dataset: Dataset, recording: Recording, tmp_path: Path, one_worker: KeptWorkers
) -> None:
    done = export_episode(dataset, EPISODE, "csv", tmp_path / "csv", one_worker, step_s=0.05)
    vehicles = pd.read_csv(tmp_path / "csv" / "vehicles.csv")
    assert len(vehicles) == done.states
    name, track = max(recording.tracks.items(), key=lambda item: len(item[1]))
    rows = vehicles[vehicles["vehicle"] == name]
    steps = track.first_step + np.arange(len(track))
    kept = steps % 5 == 0
    np.testing.assert_array_equal(rows["x_m"], track.x[kept])
    np.testing.assert_array_equal(rows["lane_lat_m"], track.lane_lat[kept])
    np.testing.assert_allclose(rows["time_s"], steps[kept] * 0.01, atol=1e-9)
    samples = pd.read_csv(tmp_path / "csv" / "samples.csv")
    assert samples["sample_id"].tolist() == dataset.frame(["sample_id"])["sample_id"].tolist()
    assert list(samples) == list(SCALARS)
    assert len(pd.read_csv(tmp_path / "csv" / "sites.csv")) == len(load("motorway").sites)


def test_the_table_of_a_sample_is_the_record(dataset: Dataset, tmp_path: Path) -> None:
    sample = dataset.samples(dataset.meta.shards[0])[-1]
    export_sample(dataset, sample.sample_id, tmp_path / "one")
    tv = pd.read_csv(tmp_path / "one" / "tv.csv")
    uv = pd.read_csv(tmp_path / "one" / "uv.csv")
    for table, suffix, stored in ((tv, "", sample.tv), (tv, "_true", sample.tv_truth), (uv, "", sample.uv)):
        placed = in_plane(stored, sample.x0, sample.y0)
        np.testing.assert_array_equal(table[[f"{name}{suffix}" for name in STATE]].to_numpy().T, placed)
    assert tv["time_s"].iloc[0] == sample.t_start
    assert pd.read_csv(tmp_path / "one" / "samples.csv")["intention"].tolist() == [sample.intention.text]


def made_up(**more: object) -> Recording:
    """A vehicle of a hostile name and class on a lane of a hostile name."""
    n = 20
    track = Track(
        HOSTILE, HOSTILE, 4.0, 1.8, 3, np.arange(n) * 1.0, np.zeros(n), np.full(n, 9.0), np.zeros(n, np.int64),
        np.arange(n) * 1.0, np.zeros(n),
    )  # fmt: skip
    lane = Lane(HOSTILE, HOSTILE, 0, 3.2, 100.0, np.array([[0.0, 0.0], [100.0, 0.0]]), ())
    return replace(Recording("toy", 1, 0.01, (lane,), {HOSTILE: track}), **more)  # type: ignore[arg-type]


def place(network: Path) -> Scenario:
    network.write_text("<net/>")
    site = Site(HOSTILE, 1.0, 2.0, 15.0, 90.0)
    return Scenario("toy", network, (), (), (1000.0, -500.0), made_up().lanes, (site,))


def test_no_name_ends_an_element(tmp_path: Path) -> None:
    """And the places are in SUMO's coordinates, at instants that the step divides."""
    (tmp_path / "out").mkdir()
    assert write_fcd(made_up(), place(tmp_path / "toy.net.xml"), tmp_path / "out", 10) == 2
    written = states(tmp_path / "out" / "episode.fcd.xml")
    assert written.keys() == {("0.1", HOSTILE), ("0.2", HOSTILE)}
    state = written["0.1", HOSTILE]
    assert (state["lane"], state["x"], state["y"], state["angle"]) == (HOSTILE, "1007.0", "-500.0", "90.0")
    (kind,) = ElementTree.parse(tmp_path / "out" / "types.add.xml").getroot()
    assert (kind.attrib["id"], kind.attrib["vClass"]) == (state["type"], "passenger")
    (site,) = ElementTree.parse(tmp_path / "out" / "sites.add.xml").getroot()
    assert site.attrib["id"] == HOSTILE


def test_what_sumo_cannot_replay_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match=r"roads\.csv: is no SUMO network, .*; export with --csv"):
        write_fcd(made_up(), place(tmp_path / "roads.csv"), tmp_path / "out", 10)
    with pytest.raises(InputError, match="toy, seed 1: no vehicle is there for long enough"):
        write_fcd(made_up(tracks={}), place(tmp_path / "toy.net.xml"), tmp_path / "out", 10)
    with pytest.raises(InputError, match="no vehicle is there for long enough"):
        write_fcd(made_up(), place(tmp_path / "toy.net.xml"), tmp_path / "out", 100)


BAD = {
    "data --episode motorway-1 --fcd -o foreign": "foreign exists and is not an empty folder",
    "data --episode motorway-1 --fcd -o foreign/thesis.tex": "thesis.tex exists and is not an empty folder",
    "data --episode motorway-2 --fcd -o new": "data has no such episode; did you mean motorway-1?",
    "data --episode motorway-1 -o new": "give either --fcd, --csv or --mcap",
    "data --episode motorway-1 --fcd --csv -o new": "give either --fcd, --csv or --mcap",
    "data --fcd -o new": "give either --episode SCENARIO-SEED or --sample ID",
    "data --sample motorway-1-99 --csv -o new": "data: has no sample 'motorway-1-99'; did you mean motorway-1-",
    "data --sample x --csv -o new": "has no sample 'x'; they are named motorway-1-0, motorway-1-1, ...",
    "data --sample motorway-1-0 --fcd -o new": "--fcd applies to an episode",
    "data --sample motorway-1-0 --csv --step 1 -o new": "--step applies to an episode",
    "data --episode motorway-1 --csv --step 0.015 -o new": "--step 0.015: is no multiple of the recording's step",
    "data --episode motorway-1 --csv --step nan -o new": "--step",
    "data --sample motorway-1-0 --mcap --from 1 -o new": "--from applies to an episode",
    "data --episode motorway-1 --csv --to 50 -o new": "--from and --to apply to --mcap",
    "data --episode motorway-1 --mcap --from 50 --to 50 -o new": "--from 50 --to 50: the stretch ends before it begins",
    "data --episode motorway-1 --mcap --from nan -o new": "--from nan --to inf: the stretch ends before it begins",
    "data --episode motorway-1 --mcap --from 500 --to 600 -o new": "--from 500 --to 600: no vehicle of motorway",
    "unfinished --sample motorway-1-0 --mcap -o new": "unfinished: dataset is not finished",
    "foreign --episode motorway-1 --csv -o new": "foreign: not a dataset",
    "unfinished --episode motorway-1 --csv -o new": "unfinished: dataset is not finished",
}


@pytest.mark.parametrize("line", BAD)
def test_bad_input_is_one_line_and_writes_nothing(
    line: str, dataset: Dataset, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = dataset.path.parent
    foreign, unfinished = folder / "foreign", folder / "unfinished"
    foreign.mkdir(exist_ok=True)
    (foreign / "thesis.tex").write_text("years of work")
    unfinished.mkdir(exist_ok=True)
    meta = dataset.meta.model_copy(update={"complete": False, "index_sha256": None})
    write_meta(unfinished, meta)
    monkeypatch.chdir(folder)
    assert BAD[line] in refusal(["export", *line.split(), "--quiet"], folder, capfd)


def test_a_full_disk_leaves_nothing(
    recording: Recording, dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    sample_id = str(dataset.frame(["sample_id"])["sample_id"][0])
    monkeypatch.setattr(tables.csv, "write_csv", full)
    monkeypatch.setattr(floating_car_data, "write_lines", full)
    with pytest.raises(OutputError, match=r"new.*/tv\.csv: cannot be written \(No space left on device\)"):
        export_sample(dataset, sample_id, tmp_path / "new")
    assert not any(tmp_path.iterdir())
    with pytest.raises(OutputError, match="No space left on device"):
        write_fcd(recording, load("motorway"), tmp_path, 10)
