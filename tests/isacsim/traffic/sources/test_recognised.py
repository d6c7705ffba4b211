"""Files of trajectories are known by their names and their beginnings; all else is a scenario."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.command_line.arguments import dataset_study
from isac_cosim.isacsim.traffic.sources.registry import recognised
from tests.support.exid_writer import write_exid
from tests.support.highd_writer import straight_recording, write_highd
from tests.support.ngsim_writer import ngsim_rows, write_csv, write_txt
from tests.support.trajectory_writers import State, write_fcd

STATES = {0.0: [State("a", 1.0, 2.0, 90.0, "car", 30.0, 1.0, "e_0")]}


@pytest.mark.parametrize("name", ["drive.xml", "d.fcd.xml.gz", "d.csv", "d.csv.gz", "d.parquet", "d.fcd.parquet.gz"])
def test_floating_car_data(name: str, tmp_path: Path) -> None:
    file = write_fcd(tmp_path / name, STATES)
    assert recognised([str(file)]) == "fcd"
    study = dataset_study([str(file)], None, None, None, network="motorway")
    assert (study.source, study.fcd.network) == ("fcd", "motorway")


def test_recordings_of_drivers(tmp_path: Path) -> None:
    recording = straight_recording(1)
    write_highd(tmp_path / "highd", None, recording)
    write_exid(tmp_path / "exid", recording)
    rows = ngsim_rows(recording)[0][:20]
    assert recognised([str(tmp_path / "highd" / "07_tracks.csv"), str(tmp_path / "exid" / "03_tracks.csv")]) == "levelx"
    files = (write_txt(tmp_path / "t.txt", rows), write_csv(tmp_path / "all.csv", rows, ["i-80"] * len(rows)))
    assert recognised([*map(str, files)]) == "ngsim"
    assert recognised([str(tmp_path / "highd")]) == "sumo"  # a folder is a scenario
    assert recognised([str(tmp_path / "highd" / "07_tracksMeta.csv")]) == "sumo"


def test_what_is_no_recording(tmp_path: Path) -> None:
    contents = {
        "a.csv": b"x;y\n1;2\n", "b.txt": b"1 2 3\n", "c.xml": b"<net/>", "d.xml.gz": gzip.compress(b"<net/>")[:-9],
        "e": b"", "f.parquet": b"PAR1PAR1", "g.net.xml": b"<fcd-export/>", "h.txt": b"1 " * 17 + b"x\n",
    }  # fmt: skip
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
    assert {recognised([str(tmp_path / name)]) for name in (*contents, "missing", ".")} == {"sumo"}
    assert recognised(["motorway", "ramp_weave"]) == recognised([]) == "sumo"


def test_files_of_different_sources_are_refused(tmp_path: Path) -> None:
    file = write_fcd(tmp_path / "drive.csv", STATES)
    with pytest.raises(InputError, match=r"drive.csv \(fcd\), motorway \(sumo\): are of different sources; make a"):
        recognised([str(file), "motorway"])
    assert dataset_study(["motorway"], None, None, None, "sumo").source == "sumo"
