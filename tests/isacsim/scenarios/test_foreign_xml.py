"""Input files may come from anyone: no entity is expanded, no other file read, and none fills the memory."""

from __future__ import annotations

import gzip
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios import making, scenario
from isac_cosim.isacsim.scenarios.demand import DemandSettings
from isac_cosim.isacsim.scenarios.making import import_map
from isac_cosim.isacsim.scenarios.scenario import load, load_without_sites
from isac_cosim.isacsim.scenarios.site_placement import PlacementSettings
from isac_cosim.isacsim.scenarios.xml_files import LIMIT_VARIABLE, LONGEST_PIECE, elements, read_through
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
            read_through(tmp_path / name)
        assert "\n" not in str(caught.value)


ELEMENTS = b"<a/>" * 250_000
"""A megabyte, of which a bomb holds a thousand."""
LARGE = {
    "attribute": (b'<net a="' + b" " * 50_000_000, r"has a tag or comment of more than 16 MB: shorten it"),
    "comment": (b"<net><!--" + b"x" * 50_000_000, r"has a tag or comment of more than 16 MB: shorten it"),
    "depth": (b"<net>" * 1_000_000, r"has more than 200 elements within each other: fix it"),
}


def bomb_file(file: Path, start: bytes, megabyte: bytes) -> None:
    """Write a gigabyte as a megabyte."""
    file.write_bytes(gzip.compress(start) + gzip.compress(megabyte) * 1000)


def test_a_small_file_that_holds_a_gigabyte_is_refused(tmp_path: Path) -> None:
    road = straight_road(tmp_path / "road", vehicle("a"))
    bomb_file(road / "r.net.xml.gz", b"<net>", ELEMENTS)
    change_name(road)
    tracemalloc.start()
    with pytest.raises(
        InputError, match=r"r\.net\.xml\.gz holds more than 200 times its size: decompress it"
    ) as caught:
        load(road)
    assert tracemalloc.get_traced_memory()[1] < 80e6
    tracemalloc.stop()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("kind", LARGE)
def test_what_would_fill_the_memory_is_refused(tmp_path: Path, kind: str, packed: bool) -> None:
    text, message = LARGE[kind]
    file = tmp_path / "a.xml"
    file.write_bytes(gzip.compress(text, 1) if packed else text)
    tracemalloc.start()
    with pytest.raises(InputError, match=rf"a\.xml {message}") as caught:
        read_through(file)
    assert tracemalloc.get_traced_memory()[1] < 80e6
    tracemalloc.stop()
    assert "\n" not in str(caught.value)


def change_name(road: Path) -> None:
    config = road / "r.sumocfg"
    config.write_text(config.read_text().replace("r.net.xml", "r.net.xml.gz"))


def test_a_map_that_holds_a_gigabyte_is_refused_before_netconvert_reads_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(making, "_netconvert", unreachable)
    bomb_file(tmp_path / "map.osm.gz", b"<osm>", ELEMENTS)
    with pytest.raises(InputError, match="holds more than 200 times its size"):
        import_map(tmp_path / "map.osm.gz", tmp_path / "out", None, PlacementSettings(), DemandSettings())


@pytest.mark.parametrize("packed", [False, True])
def test_how_much_is_read_is_a_setting(tmp_path: Path, packed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "a.xml"
    rng = np.random.default_rng(0)
    text = b"<a>" + b"".join(b'<b c="%d"/>' % number for number in rng.integers(1 << 60, size=50_000)) + b"</a>"
    file.write_bytes(gzip.compress(text) if packed else text)
    monkeypatch.setenv(LIMIT_VARIABLE, "0.001")
    with pytest.raises(InputError, match=r"a\.xml holds more than 0\.001 GB: set ISAC_COSIM_XML_LIMIT_GB higher"):
        read_through(file)
    monkeypatch.setenv(LIMIT_VARIABLE, "0.002")
    assert sum(1 for _ in elements(file)) == 50_001
    for wrong in ("much", "nan", "0", "-1"):
        monkeypatch.setenv(LIMIT_VARIABLE, wrong)
        with pytest.raises(InputError, match=rf"ISAC_COSIM_XML_LIMIT_GB = '{wrong}' is not a number above 0"):
            read_through(file)


def test_a_long_attribute_is_read(tmp_path: Path) -> None:
    """The edges of a long route."""
    (tmp_path / "a.xml").write_text(f'<a b="{"x" * (LONGEST_PIECE - 3_000_000)}"/>')
    ((_, name, attributes),) = elements(tmp_path / "a.xml")
    assert (name, len(attributes["b"])) == ("a", LONGEST_PIECE - 3_000_000)
