"""Ways in which a scenario makes SUMO write a file. Each is a function that changes the files of a straight road.

Each returns the file that SUMO then writes. Without walls, all of them work.
"""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Callable
from pathlib import Path

BLOCK = 1 << 20
"""Bytes that a reader is likely to read at once."""
NAME = "evil.xml"
DETECTOR = f'<e1Detector id="evil" lane="e0_1" pos="1" period="1" file="{NAME}"/>'
SSM = f'<param key="has.ssm.device" value="true"/><param key="device.ssm.file" value="{NAME}"/>'
Way = Callable[[Path], Path]
WAYS: dict[str, Way] = {}


def way(function: Way) -> Way:
    WAYS[function.__name__] = function
    return function


def option(folder: Path, name: str, value: str) -> Path:
    config = folder / "r.sumocfg"
    config.write_text(config.read_text().replace("</configuration>", f'<{name} value="{value}"/></configuration>'))
    return folder / NAME


def change(folder: Path, file: str, old: str, new: str) -> Path:
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new, 1))
    return folder / NAME


def additional(folder: Path, elements: str) -> Path:
    return change(folder, "sites.add.xml", "</additional>", f"{elements}</additional>")


def equipped(folder: Path, parameters: str) -> Path:
    change(folder, "r.rou.xml", "<vType ", f'<vType id="evil">{parameters}</vType><vType ')
    return change(folder, "r.rou.xml", 'type="car" route', 'type="evil" route')


def encoded(folder: Path, encoding: str) -> Path:
    file = folder / "sites.add.xml"
    text = file.read_text().replace("</additional>", f"{DETECTOR}</additional>")
    file.write_bytes(f'<?xml version="1.0" encoding="{encoding}"?>{text}'.encode(encoding))
    return folder / NAME


@way
def a_word_after_an_option(folder: Path) -> Path:
    return option(folder, "sloppy-insert", f"--tripinfo-output={folder / NAME}")


@way
def saving_the_configuration(folder: Path) -> Path:
    return option(folder, "eager-insert", f"--save-configuration={folder / NAME}")


@way
def another_configuration(folder: Path) -> Path:
    (folder / "other.txt").write_text(f'<configuration><summary-output value="{NAME}"/></configuration>')
    return option(folder, "ignore-route-errors", f"--configuration-file={folder / 'other.txt'}")


@way
def a_namespace_in_additional_files(folder: Path) -> Path:
    additional(folder, DETECTOR)
    return change(folder, "sites.add.xml", "<additional", '<additional xmlns="urn:x"')


@way
def a_namespace_in_a_network(folder: Path) -> Path:
    change(folder, "r.net.xml", "<net ", '<net xmlns="urn:x" ')
    return change(folder, "r.net.xml", "</net>", f"{DETECTOR}</net>")


@way
def a_namespace_in_routes(folder: Path) -> Path:
    change(folder, "r.rou.xml", "<routes", '<routes xmlns="urn:x"')
    return equipped(folder, SSM)


@way
def blanks_across_a_block(folder: Path) -> Path:
    text = (folder / "r.net.xml").read_text()
    blanks = DETECTOR.replace("file=", f"file{' ' * 300}=")
    filler = f"<!--{'x' * (BLOCK - len(text) - len(DETECTOR) - 150)}-->"
    return change(folder, "r.net.xml", "</net>", f"{filler}{blanks}</net>")


@way
def a_letter_as_a_number(folder: Path) -> Path:
    return equipped(folder, SSM.replace("ssm", "&#115;sm"))


@way
def a_detector_as_root(folder: Path) -> Path:
    (folder / "root.add.xml").write_text(DETECTOR)
    return change(folder, "r.sumocfg", "sites.add.xml", "sites.add.xml,root.add.xml")


@way
def inside_an_unknown_element(folder: Path) -> Path:
    return additional(folder, f"<nobody><knows>{DETECTOR}</knows></nobody>")


@way
def an_unknown_root(folder: Path) -> Path:
    additional(folder, f'<edgeData id="evil" period="1" file="{NAME}"/>')
    change(folder, "sites.add.xml", "</additional>", "</nobody>")
    return change(folder, "sites.add.xml", "<additional>", "<nobody>")


@way
def a_compressed_file_that_is_included(folder: Path) -> Path:
    (folder / "more.txt").write_bytes(gzip.compress(f"<additional>{DETECTOR}</additional>".encode()))
    return additional(folder, '<include href="more.txt"/>')


@way
def another_compression(folder: Path) -> Path:
    additional(folder, DETECTOR)
    (folder / "sites.add.xml").write_bytes(zlib.compress((folder / "sites.add.xml").read_bytes()))
    return folder / NAME


@way
def utf_16(folder: Path) -> Path:
    return encoded(folder, "utf-16")


@way
def windows_1252(folder: Path) -> Path:
    return encoded(folder, "windows-1252")


@way
def xml_1_1(folder: Path) -> Path:
    additional(folder, DETECTOR)
    return change(folder, "sites.add.xml", "<additional>", '<?xml version="1.1"?><additional>')


@way
def what_a_calibrator_reads(folder: Path) -> Path:
    (folder / "calibrator.txt").write_text(
        f'<calibrator><vType id="evil">{SSM}</vType><route id="way" edges="e0 e1"/>'
        '<flow begin="0" end="50" speed="20" vehsPerHour="3600" route="way" type="evil"/></calibrator>'
    )
    return additional(folder, '<calibrator id="c" edge="e0" pos="0" file="calibrator.txt"/>')


@way
def what_a_calibrator_reports(folder: Path) -> Path:
    return additional(
        folder,
        f'<route id="way" edges="e0 e1"/><calibrator id="c" edge="e0" pos="0" output="{NAME}">'
        '<flow begin="0" end="50" speed="20" vehsPerHour="3600" route="way"/></calibrator>',
    )


@way
def a_device_that_takes_over(folder: Path) -> Path:
    toc = "".join(
        f'<param key="{key}" value="{value}"/>'
        for key, value in {
            "has.toc.device": "true", "device.toc.file": NAME, "device.toc.manualType": "car",
            "device.toc.automatedType": "car",
        }.items()
    )  # fmt: skip
    return change(folder, "r.rou.xml", 'departSpeed="25.0"/>', f'departSpeed="25.0">{toc}</vehicle>')


@way
def a_vehicle_with_a_device(folder: Path) -> Path:
    return change(folder, "r.rou.xml", 'departSpeed="25.0"/>', f'departSpeed="25.0">{SSM}</vehicle>')


@way
def a_variable_of_the_environment(folder: Path) -> Path:
    """It has to hold `../road/`."""
    return additional(folder, f'<laneData id="evil" period="1" file="${{EVIL}}{NAME}"/>')


@way
def a_probe_of_routes(folder: Path) -> Path:
    return additional(folder, f'<routeProbe id="evil" edge="e0" period="1" file="{NAME}"/>')


@way
def a_probe_of_types(folder: Path) -> Path:
    return additional(folder, f'<vTypeProbe id="evil" type="car" period="1" file="{NAME}"/>')


@way
def a_detector_of_instants(folder: Path) -> Path:
    return additional(folder, f'<instantInductionLoop id="evil" lane="e0_1" pos="12" file="{NAME}"/>')


@way
def a_detector_of_an_area(folder: Path) -> Path:
    return additional(
        folder,
        f'<entryExitDetector id="evil" period="1" file="{NAME}"><detEntry lane="e0_1" pos="12"/>'
        '<detExit lane="e0_1" pos="50"/></entryExitDetector>',
    )
