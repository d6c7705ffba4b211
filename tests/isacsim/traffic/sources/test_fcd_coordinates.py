"""Floating car data in longitudes and latitudes, or in UTM, are read as SUMO's own coordinates."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
import sumo

from isac_cosim.base.errors import InputError
from tests.support.reading import fcd_study, read

NODES = """<nodes>
    <node id="west" x="9.7000" y="52.3000"/><node id="middle" x="9.7080" y="52.3010"/>
    <node id="east" x="9.7160" y="52.3000"/>
</nodes>
"""
EDGES = """<edges>
    <edge id="in" from="west" to="middle" numLanes="2" speed="30"/>
    <edge id="out" from="middle" to="east" numLanes="2" speed="30"/>
</edges>
"""
ROUTES = """<routes>
    <vType id="car" length="4.5"/>
    <route id="along" edges="in out"/>
    <flow id="cars" type="car" route="along" begin="0" end="20" period="3" departLane="random" departSpeed="20"/>
</routes>
"""


def made_in_hanover(folder: Path, kind: str, *options: str, projection: str = "--proj.utm") -> tuple[Path, Path, Path]:
    """A network with a projection, and a drive on it in SUMO's coordinates and as the options say."""
    home = Path(sumo.SUMO_HOME)
    for name, text in {"a.nod.xml": NODES, "a.edg.xml": EDGES, "a.rou.xml": ROUTES}.items():
        (folder / name).write_text(text)
    net = folder / "a.net.xml"
    made = [home / "bin" / "netconvert", "-n", folder / "a.nod.xml", "-e", folder / "a.edg.xml", "-o", net, projection]
    subprocess.run(list(map(str, made)), check=True, capture_output=True)
    drives = []
    for name, more in (("plain", ()), ("other", options)):
        drives.append(folder / f"{name}.{kind}")
        command = [
            str(home / "bin" / "sumo"), "-n", str(net), "-r", str(folder / "a.rou.xml"), "--end", "40",
            "--step-length", "0.1", "--lateral-resolution", "5", "--no-step-log", *more,
            "--fcd-output", str(drives[-1]),
        ]  # fmt: skip
        subprocess.run(command, check=True, capture_output=True)
    return net, drives[0], drives[1]


@pytest.mark.parametrize(
    ("kind", "options", "within_m"),
    [
        ("xml", ("--fcd-output.geo", "--precision.geo", "8"), 0.012),
        ("csv", ("--fcd-output.geo", "--precision.geo", "8"), 0.012),
        ("parquet", ("--fcd-output.geo",), 0.012),
        ("xml", ("--fcd-output.geo",), 0.1),
        ("xml", ("--fcd-output.utm",), 0.012),
    ],
)
def test_other_coordinates_are_those_of_sumo(
    kind: str, options: tuple[str, ...], within_m: float, tmp_path: Path
) -> None:
    """To the rounding of both files: 1 cm, and 1e-8 or 1e-6 of a degree."""
    net, plain, other = made_in_hanover(tmp_path, kind, *options)
    expected, again = (read(fcd_study(drive, str(net), noise_m=0.0)) for drive in (plain, other))
    assert expected.tracks.keys() == again.tracks.keys()
    assert len(expected.tracks) > 3
    for name, track in expected.tracks.items():
        assert np.hypot(again.tracks[name].x - track.x, again.tracks[name].y - track.y).max() < within_m


def test_a_position_that_is_none_among_longitudes_is_named(tmp_path: Path) -> None:
    net, _, geo = made_in_hanover(tmp_path, "csv", "--fcd-output.geo")
    header, *lines = geo.read_text().splitlines()
    cells = lines[40].split(";")
    cells[header.split(";").index("vehicle_x")] = "-1e6"
    geo.write_text("\n".join([header, *lines[:40], ";".join(cells), *lines[41:]]) + "\n")
    with pytest.raises(InputError, match=r"row 42: -1e\+06, 52\.\d+ is no longitude and latitude, and the other"):
        read(fcd_study(geo, str(net)))


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ("!", "names no projection"),
        ("+proj=utm +zone=32 +nadgrids=/etc/passwd", "is no projection that is read here"),
        ("+init=epsg:25832", "is no projection that is read here"),
        ("+proj=pipeline +step +proj=utm +zone=32", "is no projection that is read here"),
        ("+proj=utm +zone=99 +ellps=WGS84", "projParameter: "),
    ],
)
def test_projections_that_would_read_files_are_refused(parameters: str, said: str, tmp_path: Path) -> None:
    net, _, geo = made_in_hanover(tmp_path, "csv", "--fcd-output.geo")
    text = net.read_text()
    # Far from 0, 0, where longitudes and latitudes could be metres of the network.
    shifted = re.sub(r'projParameter="[^"]*"', f'projParameter="{parameters}"', text)
    shifted = re.sub(r'shape="([^"]*)"', lambda found: f'shape="{moved(found[1])}"', shifted)
    net.write_text(shifted)
    with pytest.raises(InputError, match=re.escape(said)):
        read(fcd_study(geo, str(net)))


def moved(shape: str) -> str:
    return " ".join(
        f"{float(x) + 9000},{float(y) + 9000}" for x, y in (point.split(",")[:2] for point in shape.split())
    )
