"""Configurations are read as SUMO reads them: files' names, times, options and their types."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import sumo

from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios.scenario import load
from isac_cosim.isacsim.scenarios.sumo_config import KEPT, SYNONYMS, encoded, read_config
from isac_cosim.isacsim.scenarios.sumo_schemas import fits, option_types, seconds
from isac_cosim.isacsim.traffic.drivers.settings import LEFT_ALONE, ManeuverSettings
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from tests.support.roads import straight_road, vehicle

PROGRAM = Path(sumo.SUMO_HOME) / "bin" / "sumo"
TYPES = {
    "INT": "int",
    "FLOAT": "float",
    "BOOL": "bool",
    "TIME": "time",
    "STR": "str",
    "STR[]": "strArray",
    "FILE": "file",
}


@pytest.fixture
def road(tmp_path: Path) -> Path:
    return straight_road(tmp_path / "road", vehicle("a"))


def with_lines(road: Path, lines: str) -> Path:
    config = road / "r.sumocfg"
    config.write_text(config.read_text().replace("</configuration>", f"{lines}</configuration>"))
    return config


def test_options_and_their_types_are_those_that_sumo_publishes(tmp_path: Path) -> None:
    subprocess.run([PROGRAM, "--save-template", tmp_path / "t.xml"], check=True, capture_output=True)
    published = {node.tag: node for node in ET.parse(tmp_path / "t.xml").iter() if "type" in node.attrib}
    assert len(published) > 400
    assert set(KEPT) <= set(published)
    types = {name: TYPES[node.attrib["type"]] for name, node in published.items()}
    assert len(types.items() & option_types().items()) > 400
    assert {name: types[name] for name in KEPT} == {name: option_types()[name] for name in KEPT}
    assert all(synonym in published[name].get("synonymes", "").split() for synonym, name in SYNONYMS.items())


CLOCKS = {
    "06:00:00": 21600.0, "1:06:00:00": 108000.0, "1:2:3": 3723.0, "06:00:00.5": 21600.5, "3600.25": 3600.25,
    "1e3": 1000.0, "+5": 5.0, "1.5:0:0": 5400.0, "1:-2:3": 3483.0, "00:00:1e1": 10.0, "5.": 5.0, "1:2:3:4:5": None,
    "::": None, "1_0": None, "06:00": None, "6 : 00:00": None, " 7 ": None, "1h": None, "1,5": None, "nan": None,
    "inf": None,
}  # fmt: skip


def test_times_are_read_as_sumo_reads_them(road: Path) -> None:
    """Each is given to SUMO, in a process of its own; the answer is the time at which it begins."""
    code = (
        "import sys, libsumo\n"
        "for begin in sys.argv[1:]:\n"
        "    try:\n"
        "        libsumo.start(['sumo', '--net-file=r.net.xml', f'--begin={begin}', '--no-step-log=true'])\n"
        "        print('read', libsumo.simulation.getTime())\n"
        "        libsumo.close()\n"
        "    except Exception:\n"
        "        print('read', None)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, *CLOCKS], cwd=road, capture_output=True, text=True, check=True)
    said = [line.removeprefix("read ") for line in done.stdout.splitlines() if line.startswith("read ")]
    for (text, expected), answer in zip(CLOCKS.items(), said, strict=True):
        assert answer == str(expected), text
        assert seconds(text) == expected, text


def test_a_clock_is_a_time(road: Path) -> None:
    with_lines(road, '<begin value="06:00:00"/>')
    assert read_config(road / "r.sumocfg").begin_s == 21600.0
    for wrong in ("6 o'clock", "-1", "-06:00:00"):
        text = (road / "r.sumocfg").read_text()
        (road / "r.sumocfg").write_text(re.sub('<begin value="[^"]*"', f'<begin value="{wrong}"', text))
        with pytest.raises(InputError, match=r"begin = .* is not a time from 0 on: give it in seconds, or as hours:"):
            load(road)


NAMES = {
    "my road.net.xml": "my%20road.net.xml",
    "ü%41.net.xml": "%C3%BC%2541.net.xml",
    "50%.net.xml": "50%.net.xml",
    "plain.net.xml": "${ISAC_TEST_NAME}.net.xml",
    "$HOME.net.xml": "$HOME.net.xml",
    "r~.net.xml": "  r~.net.xml ",
}


@pytest.mark.parametrize("name", NAMES)
def test_names_of_files_are_read_as_sumo_reads_them(road: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """SUMO itself finds the file by the same configuration."""
    monkeypatch.setenv("ISAC_TEST_NAME", "plain")
    (road / "r.net.xml").rename(road / name)
    config = road / "r.sumocfg"
    config.write_text(config.read_text().replace("r.net.xml", NAMES[name]))
    subprocess.run([PROGRAM, "-c", config, "--end", "1"], check=True, capture_output=True)
    assert load(road).network == road / name
    recording = record(load(road), 1, TrafficSettings(step_s=0.1, run_in_s=0.0, duration_s=1.0), NATURAL)
    assert set(recording.tracks) == {"a"}


NATURAL = ManeuverSettings(**LEFT_ALONE)


def test_values_may_be_text_and_every_synonym_is_known(road: Path) -> None:
    (road / "r.sumocfg").write_text(
        "<configuration><n>r.net.xml</n><routes v='r.rou.xml'/><a value=' sites.add.xml , '/><b>7</b></configuration>"
    )
    inputs = read_config(road / "r.sumocfg")
    assert (inputs.network, inputs.demand) == (road / "r.net.xml", (road / "r.rou.xml",))
    assert (inputs.additional, inputs.begin_s) == ((road / "sites.add.xml",), 7.0)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig"])
def test_a_configuration_may_have_a_mark_of_its_encoding_and_a_namespace(road: Path, encoding: str) -> None:
    text = (road / "r.sumocfg").read_text().replace("<configuration>", '<configuration xmlns="urn:x">')
    (road / "r.sumocfg").write_bytes(text.encode(encoding))
    assert load(road).sites


@pytest.mark.parametrize("name", KEPT)
def test_an_option_of_another_type_is_refused(road: Path, name: str) -> None:
    """A text cannot be of another type, and never becomes another option."""
    kind = option_types()[name]
    with_lines(road, f'<{name} value="--tripinfo-output=evil.xml"/>')
    if kind.startswith("str"):
        assert read_config(road / "r.sumocfg").kept == {name: "--tripinfo-output=evil.xml"}
    else:
        with pytest.raises(InputError, match=rf"{re.escape(name)} = '--trip.*' is not .*: fix or remove the option"):
            load(road)


def test_words_of_sumos_types() -> None:
    assert all(fits(word, "bool") for word in ("true", "FALSE", "1", "x", "-", "off"))
    assert not any(fits(word, "bool") for word in ("", "2", "maybe", " true"))
    assert [fits(word, "int") for word in ("-3", "3.0", "3e1")] == [True, False, False]
    assert [fits(word, "float") for word in ("-3", ".5", "3e-1", "--x", "1 2")] == [True, True, True, False, False]


def test_an_option_that_is_set_twice_is_refused(road: Path) -> None:
    with_lines(road, '<net value="r.net.xml"/>')
    with pytest.raises(InputError, match=r"r\.sumocfg sets net-file twice, which SUMO refuses: remove one"):
        load(road)


def test_a_configuration_of_many_megabytes_is_refused(road: Path) -> None:
    with_lines(road, f"<!--{'x' * 15_000_000}--><!--{'x' * 15_000_000}-->")
    with pytest.raises(InputError, match=r"r\.sumocfg holds more than 0\.016 GB"):
        load(road)


def test_names_are_written_so_that_they_are_read_as_they_are(road: Path) -> None:
    for name in ("50%25.net.xml", "${HOME}.net.xml", " a.net.xml", "ü ß.net.xml"):
        (road / name).write_bytes((road / "r.net.xml").read_bytes())
        (road / "n.sumocfg").write_text(f'<configuration><net-file value="{encoded(name)}"/></configuration>')
        assert read_config(road / "n.sumocfg").network == road / name
        subprocess.run(
            [PROGRAM, "-c", road / "n.sumocfg", "--end", "1"], check=True, capture_output=True, env=os.environ
        )
    with pytest.raises(InputError, match=r"SUMO cannot name a,b\.net\.xml, because of the comma: rename"):
        encoded("a,b.net.xml")
