"""What SUMO gets of a scenario's files: what its schemas name, without what writes files; and what files include."""

from __future__ import annotations

import gzip
import os
import xml.etree.ElementTree as ET
import zlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios import sumo_schemas
from isac_cosim.isacsim.scenarios.scenario import bundled, load
from isac_cosim.isacsim.scenarios.sumo_files import (
    DEEPEST_INCLUDE,
    NETWORK_ENDINGS,
    Handover,
    content,
    is_lefthand,
    removed_from,
    with_includes,
)
from isac_cosim.isacsim.traffic.drivers.settings import LEFT_ALONE, ManeuverSettings
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from tests.support.roads import straight_road, vehicle

BRIEF = TrafficSettings(step_s=0.1, sample_s=0.1, run_in_s=0.0, duration_s=2.0)
NATURAL = ManeuverSettings(**LEFT_ALONE)
WRITERS = ("file", "output", "dest", "outputFile")
READERS = ("rerouter", "variableSpeedSign", "calibrator", "include")


def given_to_sumo(file: Path, folder: Path) -> ET.Element:
    folder.mkdir(exist_ok=True)
    return ET.parse(Handover(folder).path_of(file)).getroot()


def test_everything_but_outputs_is_kept_and_what_is_removed_is_named(tmp_path: Path) -> None:
    file = tmp_path / "a.add.xml"
    file.write_text(
        '<additional><edgeData id="m" file="x"/><edgeData id="n" file="x"/><busStop id="b" colour="red"/>'
        '<calibrator id="c" output="x" freq="1"/><e1Detector id="d" file="x"/><e1Detector id="e" file="NUL"/>'
        '<vType id="t"><param key="has.ssm.device" value="true"/><param key="color" value="red"/></vType>'
        '<unknown><busStop id="lost"/></unknown></additional>'
    )
    root = given_to_sumo(file, tmp_path / "copies")
    assert [node.tag for node in root] == ["busStop", "calibrator", "e1Detector", "e1Detector", "vType"]
    assert root[0].attrib == {"id": "b"}
    assert root[1].attrib == {"id": "c", "output": "NUL", "freq": "1"}
    assert [node.attrib["file"] for node in root.iter("e1Detector")] == ["NUL", "NUL"]
    assert [node.attrib for node in root.iter("param")] == [{"key": "color", "value": "red"}]
    assert removed_from([file]) == (
        "busStop colour in a.add.xml",
        "calibrator output in a.add.xml",
        "e1Detector file in a.add.xml",
        "edgeData (2 times) in a.add.xml",
        "param has.ssm.device in a.add.xml",
        "unknown in a.add.xml",
    )


def test_bundled_files_are_given_as_they_are(tmp_path: Path) -> None:
    for folder in bundled().values():
        scenario = load(folder)
        assert scenario.removed == ()
        for file in (scenario.network, *scenario.demand, *scenario.additional):
            assert Handover(tmp_path).path_of(file) == file
    assert not list(tmp_path.iterdir())


@given(st.data())
def test_whatever_a_file_holds_nothing_of_it_writes(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """Random trees of known and unknown elements, with known and unknown attributes."""
    known = sumo_schemas.known_elements()
    text = st.text(st.characters(min_codepoint=32, exclude_categories=["Cs"]), max_size=8)

    def tree(depth: int) -> ET.Element:
        name = data.draw(st.sampled_from([*known, "nobody", "meandata-edge"]))
        attributes = data.draw(st.lists(st.sampled_from([*known.get(name, ()), *WRITERS, "key", "nobody"]), max_size=4))
        node = ET.Element(name, {name: data.draw(text) for name in attributes if name != "href"})
        if "key" in node.attrib:
            node.set("key", data.draw(st.sampled_from(["has.ssm.device", "device.toc.file", "file", "height"])))
        if name in READERS:
            node.attrib.pop("file", None)
        node.extend(tree(depth + 1) for _ in range(data.draw(st.integers(0, 3 - depth))))
        return node

    folder = tmp_path_factory.mktemp("tree")
    root = ET.Element(data.draw(st.sampled_from(["additional", "net", "routes", "add"])))
    root.extend(tree(0) for _ in range(data.draw(st.integers(0, 3))))
    ET.ElementTree(root).write(folder / "a.xml", encoding="utf-8")
    for node in given_to_sumo(folder / "a.xml", folder / "copies").iter():
        assert node.tag in known
        assert node.attrib.keys() <= known.get(node.tag, frozenset())
        assert node.tag not in ("edgeData", "laneData", "vTypeProbe", "timedEvent")
        outputs = [node.attrib[name].upper() for name in WRITERS if name in node.attrib and node.tag not in READERS]
        assert set(outputs) <= {"NUL", "/DEV/NULL"}
        if node.tag == "param":
            assert node.get("key") not in ("device.toc.file", "file")


def test_what_lies_within_metadata_does_not_reach_sumo(tmp_path: Path) -> None:
    """SUMO does not read the element itself, but would read the elements inside it."""
    (tmp_path / "a.xml").write_text(
        '<additional><metadata file="m"><edgeData id="e" file="out.xml"/></metadata></additional>'
    )
    assert [node.tag for node in given_to_sumo(tmp_path / "a.xml", tmp_path / "copies").iter()] == ["additional"]


def test_values_come_through_unchanged(tmp_path: Path) -> None:
    value = "a \"b\" 'c' <&> ü \t\n €  "
    root = ET.Element("additional")
    ET.SubElement(root, "poi", {"id": value, "x": "1", "y": "2", "nobody": "1"})
    for encoding in ("utf-8", "utf-16", "windows-1252"):
        ET.ElementTree(root).write(tmp_path / "a.xml", encoding=encoding, xml_declaration=True)
        got = given_to_sumo(tmp_path / "a.xml", tmp_path / encoding)
        assert [node.attrib for node in got] == [{"id": value, "x": "1", "y": "2"}]


FORMS = {
    "gzip": lambda text: gzip.compress(text.encode()),
    "gzip in two parts": lambda text: gzip.compress(text.encode()[:900]) + gzip.compress(text.encode()[900:]),
    "zlib": lambda text: zlib.compress(text.encode()),
    "utf-16": lambda text: text.encode("utf-16"),
    "utf-8 with a mark": lambda text: text.encode("utf-8-sig"),
    "latin-1": lambda text: b'<?xml version="1.0" encoding="ISO-8859-1"?>' + text.encode("latin-1"),
    "xml 1.1": lambda text: b'<?xml version="1.1"?>' + text.encode(),
}


@pytest.mark.parametrize("form", FORMS)
def test_files_are_read_as_sumo_reads_them_whatever_their_form(tmp_path: Path, form: str) -> None:
    """Whatever they are called, and with letters that their encoding has to get right."""
    folder = straight_road(tmp_path / "road", vehicle("käthe"))
    for name in ("r.net.xml", "r.rou.xml", "sites.add.xml"):
        text = (folder / name).read_text().partition("?>")[2] or (folder / name).read_text()
        (folder / name).write_bytes(FORMS[form](text.strip()))
    recording = record(load(folder), 1, BRIEF, NATURAL)
    assert set(recording.tracks) == {"käthe"}


def test_a_plain_file_that_is_called_compressed_is_read(tmp_path: Path) -> None:
    folder = straight_road(tmp_path / "road", vehicle("a"))
    (folder / "r.net.xml").rename(folder / "r.net.xml.gz")
    config = folder / "r.sumocfg"
    config.write_text(config.read_text().replace("r.net.xml", "r.net.xml.gz"))
    assert set(record(load(folder), 1, BRIEF, NATURAL).tracks) == {"a"}


CUT = {
    "gzip": (lambda packed: gzip.compress(packed)[:-30], "the compressed file ends early"),
    "junk": (lambda packed: gzip.compress(packed) + b"junk", "incorrect header"),
    "utf-32": (lambda packed: packed.decode().encode("utf-32"), "save it in UTF-8"),
    "big5": (lambda packed: b'<?xml version="1.0" encoding="big5"?>' + packed, "save it in UTF-8"),
}


@pytest.mark.parametrize("form", CUT)
def test_a_file_that_cannot_be_read_is_refused_with_the_reason(tmp_path: Path, form: str) -> None:
    folder = straight_road(tmp_path / "road", vehicle("a"))
    write, reason = CUT[form]
    (folder / "r.rou.xml").write_bytes(write((folder / "r.rou.xml").read_bytes()))
    with pytest.raises(InputError, match=rf"r\.rou\.xml cannot be read as XML \(.*{reason}|{reason}"):
        load(folder)


def test_what_a_speed_sign_reads_is_part_of_the_scenario(tmp_path: Path) -> None:
    """A file that is cut off there ends SUMO; it is refused before."""
    sign = '<variableSpeedSign id="s" lanes="e1_0" file="steps.xml"/>'
    folder = straight_road(tmp_path / "road", vehicle("a"), additional=sign)
    steps = folder / "steps.xml"
    with pytest.raises(InputError, match=r"sites\.add\.xml includes 'steps\.xml', which does not exist"):
        load(folder)
    steps.write_text('<vss><step time="0" speed="10"/></vss>')
    (file,) = load(folder).additional
    assert with_includes(file) == [file, steps]
    steps.write_text("<vss><step")
    with pytest.raises(InputError, match=r"steps\.xml cannot be read as XML"):
        load(folder)


def including(*names: str) -> str:
    return "<additional>" + "".join(f'<include href="{name}"/>' for name in names) + "</additional>"


def test_files_that_include_each_other_are_refused(tmp_path: Path) -> None:
    folder = straight_road(tmp_path / "road", vehicle("a"), additional='<include href="one.xml"/>')
    (folder / "one.xml").write_text(including("two.xml"))
    (folder / "two.xml").write_text(including("one.xml"))
    with pytest.raises(InputError, match=r"one\.xml includes itself: remove the element"):
        load(folder)


def test_a_billion_includes_are_refused(tmp_path: Path) -> None:
    """Thirty files, each of which includes the next one twice."""
    for number in range(30):
        (tmp_path / f"{number}.xml").write_text(including(*[f"{number + 1}.xml"] * 2))
    (tmp_path / "30.xml").write_text("<additional/>")
    with pytest.raises(InputError, match=r"makes SUMO read more than 10000 files: include each once"):
        with_includes(tmp_path / "0.xml")


def test_a_long_chain_of_includes_is_refused(tmp_path: Path) -> None:
    for number in range(2000):
        (tmp_path / f"{number}.xml").write_text(including(f"{number + 1}.xml"))
    (tmp_path / "2000.xml").write_text("<additional/>")
    with pytest.raises(InputError, match=rf"is included at depth {DEEPEST_INCLUDE + 1}"):
        with_includes(tmp_path / "0.xml")
    assert len(with_includes(tmp_path / f"{2000 - DEEPEST_INCLUDE}.xml")) == DEEPEST_INCLUDE + 1


def test_a_file_that_changes_is_read_again(tmp_path: Path) -> None:
    file = tmp_path / "a.xml"
    file.write_text("<additional/>")
    assert content(file).removed == ()
    file.write_text('<additional><edgeData id="m" file="x"/></additional>')
    assert content(file).removed == (("edgeData", 1),)


def test_names_of_what_is_removed_can_be_shown(tmp_path: Path) -> None:
    """No escape sequence reaches the terminal, and no number of names fills it."""
    file = tmp_path / "a.xml"
    keys = [f"&#x9b;31m{'x' * 500}.file", *(f"{number}.file" for number in range(3000))]
    file.write_text("<a>" + "".join(f'<param key="{key}" value="y"/>' for key in keys) + "</a>")
    removed = removed_from([file])
    assert len(removed) <= 1001
    assert all(text.isprintable() and len(text) < 100 for text in removed)


def test_a_pipe_is_no_file(tmp_path: Path) -> None:
    """Reading it would wait for ever."""
    folder = straight_road(tmp_path / "road", vehicle("a"), additional='<include href="pipe"/>')
    os.mkfifo(folder / "pipe")
    with pytest.raises(InputError, match="includes 'pipe', which does not exist"):
        load(folder)


@pytest.mark.parametrize("ending", NETWORK_ENDINGS)
def test_left_hand_traffic_is_read_of_the_root(tmp_path: Path, ending: str) -> None:
    file = tmp_path / f"a{ending}"
    for value, expected in (("1", True), ("TRUE", True), ("0", False), ("", False)):
        text = f'<net lefthand="{value}"/>'.encode()
        file.write_bytes(gzip.compress(text) if ending.endswith("gz") else text)
        assert is_lefthand(file) is expected
