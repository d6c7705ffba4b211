"""Names of folders and scenarios: they work, or are refused for exactly that reason, in every command."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import cosim
from isac_cosim.base.errors import InputError
from isac_cosim.isacsim.scenarios.demand import DemandSettings
from isac_cosim.isacsim.scenarios.making import add_sites
from isac_cosim.isacsim.scenarios.naming import NAME, check_name
from isac_cosim.isacsim.scenarios.scenario import load, load_without_sites
from isac_cosim.isacsim.scenarios.site_placement import PlacementSettings
from isac_cosim.isacsim.traffic.drivers.settings import LEFT_ALONE, ManeuverSettings
from isac_cosim.isacsim.traffic.sources.sumo import TrafficSettings, record
from isac_cosim.labeling.generation.generate import generate
from tests.support.roads import straight_road, vehicle
from tests.support.scripted import InlineEngine, small_study

BRIEF = TrafficSettings(step_s=0.1, sample_s=0.1, run_in_s=0.0, duration_s=2.0)
NATURAL = ManeuverSettings(**LEFT_ALONE)
GOOD = ("straße", "my road", "道路", "Ünï-1.5_b", "a..b")
ODD = (
    "com,ma",
    "${HOME}",
    "$HOME",
    "my%20road",
    "a;b",
    "a:b",
    "it's",
    'say "so"',
    "a&b",
    "#1",
    "~",
    "new\nline",
    "...",
)
"""They can be folders, but not scenarios."""


@pytest.fixture(scope="module")
def road(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return straight_road(tmp_path_factory.mktemp("roads") / "road", vehicle("a"))


@pytest.mark.parametrize("name", [*GOOD, *ODD])
def test_a_scenario_within_any_folder_runs(
    tmp_path: Path, road: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also with a file that is copied, one that includes another, and a language without letters beyond ASCII."""
    monkeypatch.setenv("HOME", "/nowhere")
    monkeypatch.setenv("LC_ALL", "C")
    folder = tmp_path / name / "road"
    shutil.copytree(road, folder)
    (folder / "more.add.xml").write_text(
        '<additional><include href="poi.xml"/><edgeData id="m" file="x"/></additional>'
    )
    (folder / "poi.xml").write_text('<additional><poi id="p" x="1" y="1"/></additional>')
    config = folder / "r.sumocfg"
    config.write_text(config.read_text().replace("sites.add.xml", "sites.add.xml,more.add.xml"))
    before = sorted(folder.iterdir())
    assert set(record(load(folder), 1, BRIEF, NATURAL).tracks) == {"a"}
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize("name", GOOD)
def test_a_name_that_sites_are_made_for_is_one_that_a_dataset_is_made_of(tmp_path: Path, road: Path, name: str) -> None:
    folder = tmp_path / name
    network = road / "r.net.xml"
    assert cosim.main(["network", "sites", str(network), "-o", str(folder), "--vehicles", "60", "--json"]) == 0
    traffic = {"run_in_s": 1.0, "duration_s": 12.0, "step_s": 0.05, "sample_s": 0.05}
    study = small_study(source="sumo", scenarios=[str(folder)], seeds={"first": 1, "last": 1}, traffic=traffic)
    out = tmp_path / "data"
    dataset = generate(study, out, InlineEngine())
    assert [scenario.name for scenario in dataset.meta.scenarios] == [name]
    assert [path.name for path in (out / "shards").iterdir()] == [f"{name}-1.parquet"]
    assert cosim.main(["inspect", str(out), "--verify", "--json"]) == 0


@pytest.mark.parametrize("name", ODD)
def test_a_name_that_cannot_be_part_of_a_file_name_is_refused_for_that(tmp_path: Path, road: Path, name: str) -> None:
    folder = tmp_path / name
    shutil.copytree(road, folder)
    with pytest.raises(InputError, match=r"the scenario's name .* cannot be part of a file name: rename") as caught:
        load(folder)
    assert "\n" not in str(caught.value).replace(str(folder), "")
    with pytest.raises(InputError, match=r"cannot be part of a file name"):
        add_sites(str(road / "r.net.xml"), tmp_path / "new" / name, PlacementSettings(), DemandSettings(vehicles=9))
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("name", ODD)
def test_sites_are_made_for_a_network_in_any_folder_or_the_comma_is_named(
    tmp_path: Path, road: Path, name: str
) -> None:
    folder = tmp_path / name
    folder.mkdir()
    network = folder / "bare.net.xml"
    shutil.copy(road / "r.net.xml", network)

    def make(out: Path) -> None:
        add_sites(str(network), out, PlacementSettings(), DemandSettings(vehicles=9))
        assert load(out).network.samefile(network)

    make(folder / "inside")
    if "," in name:
        with pytest.raises(
            InputError, match=r"SUMO cannot name \.\./com,ma/bare\.net\.xml, because of the comma: rename"
        ):
            make(tmp_path / "outside")
        assert not (tmp_path / "outside").exists()
    else:
        make(tmp_path / "outside")


def test_a_temporary_folder_that_sumo_misreads_is_named(
    tmp_path: Path, road: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a,b").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "a,b"))
    shutil.copytree(road, tmp_path / "ü")
    with pytest.raises(InputError, match=r"SUMO misreads the path .*a,b.*: set TMPDIR"):
        record(load(tmp_path / "ü"), 1, BRIEF, NATURAL)


def test_names_that_lead_elsewhere_are_none() -> None:
    for name in ("", ".", "..", "../a", "a/b", "/a", "a\\b", "a\0", "-a", ".a", " a", "a ", "a.", "a\n", "x" * 151):
        with pytest.raises(InputError):
            check_name(name, "here")
    for name in (*GOOD, "a", "9", "हिन्दी"):
        check_name(name, "here")
    assert NAME.startswith("^")


def test_accents_are_composed(tmp_path: Path, road: Path) -> None:
    """macOS decomposes the names of files; a scenario has the same name and so the same samples there."""
    shutil.copytree(road, tmp_path / "stra\u00dfe u\u0308")
    assert load_without_sites(tmp_path / "stra\u00dfe u\u0308").name == "straße ü"


def test_a_scenario_in_the_current_folder_has_its_name(
    tmp_path: Path, road: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    add_sites(str(road / "r.net.xml"), Path(), PlacementSettings(), DemandSettings(vehicles=9))
    assert (tmp_path / "here" / "here.sumocfg").is_file()
    assert load(tmp_path / "here").name == "here"
