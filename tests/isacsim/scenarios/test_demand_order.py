"""Route files whose vehicles are not in the order of departure, held against what SUMO makes of them."""

from __future__ import annotations

import gzip
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios.demand_order import first_departure_s, in_order, read_demand
from isac_cosim.isacsim.scenarios.remarks import remarks
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.traffic.sources.sumo_library import load_libsumo
from tests.support.roads import straight_road, vehicle

ROUTE = '<route id="r" edges="e0 e1"/>'


def write(folder: Path, *rows: str) -> Path:
    file = folder / "x.rou.xml"
    file.write_text(f"<?xml version='1.0' encoding='UTF-8'?>\n<!-- ü --><routes>{''.join(rows)}</routes>\n<!-- end -->")
    return file


def ids(file: Path) -> list[str | None]:
    return [node.get("id") for node in ET.parse(file).getroot()]


def test_a_sorted_file_is_taken_as_it_is(tmp_path: Path) -> None:
    file = write(
        tmp_path, ROUTE, '<vehicle id="a" depart="1"/>', '<flow id="b" begin="0:0:1"/>', '<trip id="c" depart="2"/>'
    )
    assert in_order(file, file, tmp_path, 0.0) == file


def test_definitions_come_first_and_equal_departures_stay_in_order(tmp_path: Path) -> None:
    file = write(
        tmp_path,
        '<vehicle id="b" type="t" depart="7"/>',
        ROUTE,
        '<flow id="f"/>',
        '<vehicle id="w" depart="triggered"/>',
        '<vehicle id="c" depart="7"><stop lane="e0_1" duration="3"/></vehicle>',
        '<vType id="t"/>',
        '<person id="p" depart="00:00:06"><walk edges="e0"/></person>',
    )
    content = read_demand(file, 5.0)
    assert (content.late, content.departures, content.sortable) == (("f", "p"), 4, True)
    copy = in_order(file, file, tmp_path, 5.0)
    assert ids(copy) == ["r", "t", "f", "w", "p", "b", "c"]
    assert copy.read_bytes().startswith(file.read_bytes().partition(b"<vehicle")[0])
    assert copy.read_bytes().endswith(b"</routes>\n<!-- end -->")
    assert sorted(map(ET.tostring, ET.parse(copy).getroot())) == sorted(map(ET.tostring, ET.parse(file).getroot()))


@given(st.lists(st.integers(0, 9), min_size=1, max_size=12))
@settings(max_examples=40, deadline=None)
def test_a_copy_is_sorted_and_holds_every_vehicle(
    tmp_path_factory: pytest.TempPathFactory, departures: list[int]
) -> None:
    folder = tmp_path_factory.mktemp("demand")
    file = write(folder, *(f'<vehicle id="{k}" depart="{depart}"/>' for k, depart in enumerate(departures)))
    copy = in_order(file, file, folder, 0.0)
    assert not read_demand(copy).late
    assert [int(name or "") for name in ids(copy)] == sorted(range(len(departures)), key=departures.__getitem__)


def test_a_packed_file_is_sorted(tmp_path: Path) -> None:
    plain = write(tmp_path, '<vehicle id="b" depart="7"/>', '<vehicle id="a" depart="1"/>')
    packed = tmp_path / "x.rou.xml.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    assert ids(in_order(packed, packed, tmp_path, 0.0)) == ["a", "b"]


@pytest.mark.parametrize("row", ['<interval begin="5" end="9"><flow id="f"/></interval>', '<include href="y.xml"/>'])
def test_a_file_whose_elements_depend_on_each_other_stays(tmp_path: Path, row: str) -> None:
    file = write(tmp_path, '<vehicle id="b" depart="7"/>', row, '<vehicle id="a" depart="1"/>')
    assert in_order(file, file, tmp_path, 0.0) == file


def test_the_late_ones_are_those_that_sumo_leaves_out(tmp_path: Path) -> None:
    cars = [vehicle(f"v{k}", depart, lane=k % 3) for k, depart in enumerate((3.0, 1.0, 5.0, 4.0, 5.0, 2.0, 6.0))]
    folder = straight_road(tmp_path / "road", "".join(cars))
    libsumo = load_libsumo()
    libsumo.start(
        ["sumo", f"--net-file={folder / 'r.net.xml'}", f"--route-files={folder / 'r.rou.xml'}", "--no-step-log=true",
         "--no-warnings=true"]
    )  # fmt: skip
    departed: set[str] = set()
    for _ in range(12):
        libsumo.simulationStep()
        departed |= set(libsumo.simulation.getDepartedIDList())
    libsumo.close()
    late = read_demand(folder / "r.rou.xml").late
    assert late == ("v1", "v3", "v5")
    assert departed == {f"v{k}" for k in range(7)} - set(late)
    (remark,) = remarks(load(folder))
    assert "SUMO would leave out 3 of its 7 vehicles and flows, the first 'v1'" in remark


def test_the_first_departure_is_that_of_a_vehicle_that_can_drive_if_there_is_one(tmp_path: Path) -> None:
    person = '<person id="p" depart="10"><walk edges="e0"/></person>'
    file = write(
        tmp_path, '<vehicle id="a" depart="3"/>', person, '<flow id="f" begin="40"/>', '<trip id="b" depart="30"/>'
    )
    assert first_departure_s([file], 5.0) == 30.0
    assert first_departure_s([file], 41.0) == 3.0
    other = tmp_path / "other.rou.xml"
    other.write_text('<routes><vehicle id="c" depart="50"/></routes>')
    assert first_departure_s([file, other], 41.0) == 50.0
    waiting = tmp_path / "waiting.rou.xml"
    waiting.write_text('<routes><vehicle id="d" depart="triggered"/></routes>')
    assert first_departure_s([waiting], 41.0) is None


LC = '<vType id="sharp" laneChangeModel="LC2013"/>'


@pytest.mark.parametrize(
    "used",
    [
        LC + vehicle("a").replace('type="car"', 'type="sharp"'),
        f'<vTypeDistribution id="mix">{LC}<vType id="soft"/></vTypeDistribution>'
        + vehicle("a").replace('type="car"', 'type="mix"'),
        LC + '<vTypeDistribution id="mix" vTypes="sharp car"/>' + vehicle("a").replace('type="car"', 'type="mix"'),
        LC.replace("sharp", "DEFAULT_VEHTYPE") + vehicle("a").replace('type="car" ', ""),
    ],
)
def test_a_lane_change_model_that_the_sublane_model_refuses(tmp_path: Path, used: str) -> None:
    name = "DEFAULT_VEHTYPE" if "DEFAULT" in used else "sharp"
    with pytest.raises(InputError, match=f"vehicle type '{name}' has laneChangeModel LC2013.*set it to SL2015"):
        load(straight_road(tmp_path / "road", used))


@pytest.mark.parametrize("model", ["LC2013", "SL2015", "default"])
def test_types_that_nobody_has_or_that_sumo_takes_are_accepted(tmp_path: Path, model: str) -> None:
    kind = "car" if model == "LC2013" else "other"
    types = f'<vType id="other" laneChangeModel="{model}"/>'
    load(straight_road(tmp_path / "road", types + vehicle("a").replace('type="car"', f'type="{kind}"')))
