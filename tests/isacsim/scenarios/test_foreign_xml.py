"""Input files may come from anyone: no entity is expanded, no other file read, and SUMO writes no file for them."""

from __future__ import annotations

import gzip
import tracemalloc
from pathlib import Path
from typing import Any

import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios import making, scenario
from isac_cosim.isacsim.scenarios.demand import DemandSettings
from isac_cosim.isacsim.scenarios.making import import_map
from isac_cosim.isacsim.scenarios.scenario import load, load_without_sites
from isac_cosim.isacsim.scenarios.site_placement import PlacementSettings
from isac_cosim.isacsim.scenarios.sumo_files import BLOCK, parse
from tests.support.roads import straight_road, vehicle


def bomb(levels: int = 9) -> str:
    """A billion laughs: 3 kB that are 3 GB when expanded."""
    entities = [f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, levels)]
    return f'<!DOCTYPE a [<!ENTITY l0 "ha">{"".join(entities)}]>'


ATTACKS = {
    "bomb": (bomb(), "&l8;"),
    "file": ('<!DOCTYPE a [<!ENTITY f SYSTEM "secret.txt">]>', "&f;"),
    "parameter": ('<!DOCTYPE a [<!ENTITY % p SYSTEM "secret.txt"> %p;]>', ""),
    "subset": ('<!DOCTYPE a SYSTEM "secret.txt">', ""),
}
FILES = ("r.net.xml", "r.net.xml.gz", "r.sumocfg", "r.rou.xml", "sites.add.xml")


def infected(text: str, attack: str) -> str:
    """An XML file with a document type, and what it declares used within the root element."""
    declared, used = ATTACKS[attack]
    text = text[text.index("?>") + 2 :] if text.startswith("<?xml") else text
    at = text.rindex("</")
    return f'<?xml version="1.0"?>{declared}{text[:at]}{used}{text[at:]}'


def unreachable(*_: Any, **__: Any) -> Any:
    raise AssertionError("reached with a document type")


@pytest.mark.parametrize("attack", ATTACKS)
@pytest.mark.parametrize("name", FILES)
def test_a_scenario_with_a_document_type_is_refused(
    tmp_path: Path, name: str, attack: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    road = straight_road(tmp_path / "road", vehicle("a"))
    (road / "secret.txt").write_text("<secret/>")
    plain = road / name.removesuffix(".gz")
    text = infected(plain.read_text(), attack)
    if name.endswith(".gz"):
        (road / name).write_bytes(gzip.compress(text.encode()))
        config = road / "r.sumocfg"
        config.write_text(config.read_text().replace("r.net.xml", name))
    else:
        plain.write_text(text)
    if "net" in name:
        monkeypatch.setattr(scenario.sumolib.net, "readNet", unreachable)
    tracemalloc.start()
    for read in (load, load_without_sites):
        with pytest.raises(InputError, match=rf"{name} declares a document type") as caught:
            read(road)
        assert "\n" not in str(caught.value)
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()


@pytest.mark.parametrize("attack", ATTACKS)
@pytest.mark.parametrize("name", ["map.osm", "map.osm.gz"])
def test_a_map_with_a_document_type_is_refused(
    tmp_path: Path, name: str, attack: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(making, "_netconvert", unreachable)
    text = infected('<osm version="0.6"><node id="1" lat="1" lon="1"/></osm>', attack).encode()
    (tmp_path / name).write_bytes(gzip.compress(text) if name.endswith(".gz") else text)
    with pytest.raises(InputError, match="declares a document type"):
        import_map(tmp_path / name, tmp_path / "out", None, PlacementSettings(), DemandSettings())
    assert sorted(path.name for path in tmp_path.iterdir()) == [name]


@pytest.mark.parametrize(
    "content",
    [
        b"<a>&undeclared;</a>",
        b"",
        b"\x00",
        b"<a/><b/>",
        '<a b="ü"/>'.encode("latin-1"),
        b'<?xml version="1.0" encoding="big5"?><a/>',
    ],
)
def test_a_file_that_is_not_xml_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    for name, packed in (("a.xml", content), ("a.xml.gz", gzip.compress(content)), ("b.xml.gz", content)):
        (tmp_path / name).write_bytes(packed)
        with pytest.raises(InputError, match=rf"{name} cannot be read as XML \(.+\): fix the file") as caught:
            parse(tmp_path / name)
        assert "\n" not in str(caught.value)


SSM = '<param key="has.ssm.device" value="true"/><param key="device.ssm.file" value="evil.xml"/>'
WRITERS = {
    "rou device": ("r.rou.xml", '<vType id="car"', f'<vType id="evil">{SSM}</vType><vType id="car"'),
    "rou hidden": (
        "r.rou.xml", '<vType id="car"', f'<vType id="evil">{SSM.replace("ssm", "&#115;sm")}</vType><vType id="car"'
    ),
    "net detector": ("r.net.xml", "</net>", '<e1Detector id="evil" lane="e0_0" pos="1" file="evil.xml"/></net>'),
    "net calibrator": ("r.net.xml", "</net>", '<calibrator id="evil" edge="e0" output="evil.xml"/></net>'),
    "net signals": ("r.net.xml", "</net>", '<tlLogic id="t"><param key="file" value="evil.xml"/></tlLogic></net>'),
}  # fmt: skip


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
@pytest.mark.parametrize("case", WRITERS)
def test_a_file_that_makes_sumo_write_another_is_refused(tmp_path: Path, case: str, encoding: str) -> None:
    name, old, new = WRITERS[case]
    road = straight_road(tmp_path / "road", vehicle("a"))
    text = (road / name).read_text().replace('<?xml version="1.0" encoding="UTF-8"?>', "")
    assert old in text
    (road / name).write_text(text, encoding=encoding)
    load(road)
    (road / name).write_text(text.replace(old, new), encoding=encoding)
    with pytest.raises(InputError, match=rf"{name}: \w+ '[\w.]+' makes SUMO write a file: remove it"):
        load(road)


def test_parameters_that_write_no_file_are_accepted(tmp_path: Path) -> None:
    """Also where a word that does lies across two blocks of reading."""
    road = straight_road(tmp_path / "road", vehicle("a"))
    routes = road / "r.rou.xml"
    text = routes.read_text()
    routes.write_text(
        text.replace("</routes>", '<vType id="x"><param key="has.ssm.device" value="false"/></vType></routes>')
    )
    load(road)
    at = text.index("</routes>")
    for shift in range(-70, 10, 5):
        filler = f"<!--{'x' * (BLOCK - at + shift - 7)}-->"
        routes.write_text(f'{text[:at]}{filler}<vType id="evil">{SSM}</vType></routes>')
        with pytest.raises(InputError, match=r"has\.ssm\.device"):
            load(road)
