"""Bad input: exit code 2, one line that says what is wrong, and nothing written."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.command_line.arguments import one_of
from isac_cosim.isacsim.scenarios.scenario import bundled
from tests.support.refusals import refusal


@pytest.fixture
def bad(tmp_path: Path) -> Path:
    """A folder of inputs that are wrong in one way each."""
    motorway = bundled()["motorway"]
    shutil.copytree(motorway, tmp_path / "siteless")
    (tmp_path / "siteless" / "sites.add.xml").write_text("<additional/>")
    shutil.copytree(motorway, tmp_path / "garbled")
    (tmp_path / "garbled" / "motorway.net.xml").write_text("<net")
    (tmp_path / "empty").mkdir()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("years of work")
    (tmp_path / "key.toml").write_text("[dataset]\nsede = 3\n")
    (tmp_path / "range.toml").write_text("[dataset.sensing.channel]\nsnr_range_db = [9, 3]\n")
    (tmp_path / "type.toml").write_text('[training.optimiser]\nepochs = "many"\n')
    (tmp_path / "wide.toml").write_text("[dataset]\n", encoding="utf-16")
    (tmp_path / "marked.toml").write_text("[dataset]\nsede = 3\n", encoding="utf-8-sig")
    (tmp_path / "broken.toml").write_text("[dataset\n")
    return tmp_path


BAD = {
    "run none.toml": "none.toml: no such study file",
    "run key.toml": "key.toml: dataset.sede: unknown key",
    "run range.toml": "range.toml: dataset.sensing.channel: snr_range_db 9:3 is no range",
    "run type.toml": "type.toml: training.optimiser.epochs: ",
    "run broken.toml": "broken.toml: not a readable TOML file",
    "run -o full": "full: is not empty and holds no study's results",
    "generate nowhere -o new": "no scenario nowhere",
    "generate siteless -o new": "has no sites",
    "generate garbled -o new": "cannot be read as XML",
    "generate empty -o new": "empty has no SUMO configuration (.sumocfg) and no network (.net.xml)",
    "generate siteless/motorway.net.xml -o new": "siteless/motorway.net.xml",
    "generate motorway -o full": "full: is not empty and holds no dataset",
    "generate motorway -o key.toml": "key.toml: is a file",
    "generate motorway -o new --snr 10:0": "--snr 10:0: is not a range",
    "generate motorway -o new --snr loud": "--snr loud: is not a range",
    "generate motorway -o new --snr 0:nan": "--snr 0:nan: is not a range",
    "generate motorway -o new --snr 0:900": "snr_range_db.1: must be at most 80, not 900",
    "generate motorway -o new --seeds 5": "--seeds 5: is not a range",
    "generate motorway -o new --seeds=-3:2": "seeds.first",
    "generate motorway -o new --windows 0": "--windows",
    "generate motorway -o new --jobs none": "--jobs",
    "generate motorway -o new --cluster nowhere": "--cluster nowhere: no dask scheduler answers",
    "generate motorway -o new --cluster tcp://127.0.0.1:9 --jobs 2": "give one of them",
    "run -o new --cluster carrier://pigeon": "--cluster carrier://pigeon: no dask scheduler answers",
    "run -o new --quiet --verbose": "--quiet and --verbose contradict each other",
    "generate motorway": "Missing option '-o'",
    "generate motorway -o new --colour red": "No such option: --colour",
    "generate -o new": "Missing argument 'SCENARIO'",
    "": "name a command: `cosim run` runs the quick study",
    "network": "Missing command",
    "fly": "No such command 'fly'",
    "inspect empty": "empty: not a dataset",
    "inspect nowhere": "nowhere: not a dataset",
    "sense empty -o new": "empty: not a dataset",
    "network import nowhere.osm -o new": "there is no file nowhere.osm",
    "network import key.toml -o new": "key.toml is not an OpenStreetMap file",
    "network import key.toml -o new --box 9,52": "--box 9,52: is not a box",
    "network import key.toml -o new --box 9,52,8,53": "--box 9,52,8,53: is not a box",
    "network sites nowhere -o new": "no scenario nowhere",
    "network sites motorway -o new": "sites already",
    "network sites siteless -o full": "full exists and is not an empty folder",
    "network sites siteless -o new --spacing 3": "arguments: spacing_m",
    "network sites siteless -o new --vehicles 0": "arguments: vehicles",
    "network sites siteless": "Missing option '-o'",
    "bench trian": "unknown bench 'trian': did you mean train? choose one of echo, traffic",
    "train full -o new": "full: not a dataset",
    "evaluate empty --data empty": "empty: not a run",
    "evaluate empty": "give one of them",
    "evaluate empty --data empty --traffic motorway": "give one of them",
    "evaluate empty --data empty --seeds 1:2": "--seeds applies to an evaluation in traffic",
    "evaluate empty --traffic motorway": "empty: not a run",
    "evaluate empty --data empty --no-lanes": "--no-lanes applies to an evaluation in traffic",
    "generate -o new --source kinematic --natural": "--natural: source kinematic has no world in which",
    "train full -o new --model trees --epochs 3": "--epochs applies to networks: remove it, or --model trees",
    "train full -o new --seed -1": "--seed",
    "train full -o new --seed 4294967296": "--seed",
    "run --dry-run --cluster tcp://127.0.0.1:9": "--dry-run counts on local workers",
    "network sites siteless -o new --seed 3": "--seed applies to demand that is made",
    "network sites siteless -o new --vehicles 3": "--vehicles applies to demand that is made",
    "run wide.toml": "wide.toml: is in UTF-16, and TOML is in UTF-8; save the file as UTF-8",
    "run marked.toml": "marked.toml: dataset.sede: unknown key",
}


@pytest.mark.parametrize("line", BAD)
def test_bad_input_is_one_line_and_exit_2(
    line: str, bad: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(bad)
    assert BAD[line] in refusal(line.split(), bad, capfd)


EMPTY = {
    ("generate", "motorway", "-o", ""): "--out: is empty; give it a value",
    ("generate", "", "-o", "new"): "SCENARIO: is empty",
    ("generate", "motorway", "-o", "new", "--seeds", ""): "--seeds: is empty; give it a value, or leave it out",
    ("generate", "motorway", "-o", "new", "--snr", " "): "--snr: is empty",
    ("inspect", ""): "DATASET: is empty",
    ("reproduce", "asi-bip", "--stages", ""): "--stages: is empty",
    ("evaluate", "run", "--data", ""): "--data: is empty",
    ("evaluate", "run", "--data", "data", "--against", ""): "--against: is empty",
    ("network", "import", "map.osm", "-o", "new", "--box", ""): "--box: is empty",
}
"""Arguments that are an empty text, which is no path, no range and no list, and what is said to them."""


@pytest.mark.parametrize("arguments", EMPTY)
def test_an_empty_text_is_refused(
    arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert EMPTY[arguments] in refusal(arguments, tmp_path, capfd)


def test_the_former_name_of_samples_still_works() -> None:
    assert one_of(None, 5) == one_of(5, None) == 5
    with pytest.raises(InputError, match="--windows is the former name of --samples"):
        one_of(5, 5)
