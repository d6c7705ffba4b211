"""The command line: exit codes, the one line of bad input, JSON, and a whole study through SUMO."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import typer

import cosim
from isac_cosim.base.errors import InputError
from isac_cosim.command_line.arguments import one_of
from isac_cosim.isacsim.scenarios.scenario import bundled
from isac_cosim.isacsim.scenarios.site_placement import PlacementSettings

ROOT = Path(cosim.__file__).parent
TINY = """
[dataset]
scenarios = ["motorway"]
seeds = { first = 1, last = 3 }
traffic = { run_in_s = 60.0, duration_s = 75.0 }
record = { tv_rate_hz = 40.0, uv_rate_hz = 20.0 }
selection = { per_class = 4, following = 2 }

[training]
asi_bip = { hidden = 8, width = 8, heads = 2, encoder_layers = 1, tv_pool = 4, uv_pool = 4 }
optimiser = { epochs = 1, threads = 1 }
trees = { rounds = 5 }
pre_onset = { rounds = 5 }
"""


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
    before = sorted(bad.rglob("*"))
    assert cosim.main(line.split()) == 2
    printed = capfd.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("cosim: ")
    assert printed.err.endswith("\n")
    assert printed.err.count("\n") == 1
    assert BAD[line] in printed.err
    assert sorted(bad.rglob("*")) == before


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
    assert cosim.main(arguments) == 2
    printed = capfd.readouterr().err
    assert EMPTY[arguments] in printed
    assert printed.count("\n") == 1
    assert not any(tmp_path.iterdir())


def test_an_unknown_model_is_bad_input(tiny: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert cosim.main(["train", str(tiny / "dataset"), "-o", str(tmp_path / "run"), "--model", "oracle"]) == 2
    assert capfd.readouterr().err.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_help_answers_without_the_heavy_packages() -> None:
    code = (
        "import sys, cosim; cosim.main(['generate', '--help']); "
        "print(sorted({'torch', 'dask', 'libsumo'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert "--samples" in done.stdout
    assert "--windows" not in done.stdout


def commands() -> dict[str, Any]:
    """Every command by what calls it, `network sites`."""
    root: Any = typer.main.get_command(cosim.app)
    leaves = {}
    for name, command in root.commands.items():
        parts = getattr(command, "commands", None)
        leaves |= {f"{name} {part}": leaf for part, leaf in parts.items()} if parts else {name: command}
    return leaves


@pytest.mark.parametrize("name", commands())
def test_help_is_complete_and_its_examples_are_understood(name: str, capfd: pytest.CaptureFixture[str]) -> None:
    """Defaults and choices that only the packages know are filled in; every example has only known options."""
    assert cosim.main([*name.split(), "--help"]) == 0
    shown = capfd.readouterr().out
    assert not re.search(r"\{[a-z_]+\}", shown)
    command = commands()[name]
    lines = re.findall(r"`cosim ([^`]+)`", command.epilog)
    assert lines
    for line in lines:
        words = shlex.split(line)
        assert words[: len(name.split())] == name.split()
        command.make_context(name, words[len(name.split()) :])


def test_help_shows_the_defaults_of_the_settings(capfd: pytest.CaptureFixture[str]) -> None:
    assert cosim.main(["network", "sites", "--help"]) == 0
    shown = " ".join(capfd.readouterr().out.replace("│", "").split())
    for field in ("spacing_m", "set_back_m", "height_m"):
        assert f"Default: {PlacementSettings.model_fields[field].default:g}." in shown


def test_the_version_names_what_results_depend_on(capfd: pytest.CaptureFixture[str]) -> None:
    assert cosim.main(["--version"]) == 0
    assert re.fullmatch(r"isac-cosim \S+, SUMO 1\.\S+, torch 2\.\S+\n", capfd.readouterr().out)


def test_the_former_name_of_samples_still_works() -> None:
    assert one_of(None, 5) == one_of(5, None) == 5
    with pytest.raises(InputError, match="--windows is the former name of --samples"):
        one_of(5, 5)


def test_a_script_from_the_source_tree_gives_the_exit_code(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, ROOT / "cosim.py", "inspect", "nowhere"], cwd=tmp_path, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a whole study through SUMO, as small as it goes; its own JSON lies beside it."""
    folder = tmp_path_factory.mktemp("tiny")
    (folder / "tiny.toml").write_text(TINY)
    done = subprocess.run(
        [sys.executable, ROOT / "cosim.py", "run", "tiny.toml", "--json", "--jobs", "1"],
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    (folder / "results.json").write_text(done.stdout.splitlines()[-1])
    (folder / "printed.txt").write_text(done.stderr)
    return folder / "results" / "tiny"


def test_a_study_runs_from_a_network_to_a_report(tiny: Path) -> None:
    result = json.loads((tiny.parents[1] / "results.json").read_text())
    contract = {"dataset", "run", "report", "accuracy", "macro_f1", "floor_macro_f1", "seconds"}
    assert set(result) == {*contract, "before_commit", "floor_before_commit", "macro_f1_over"}
    scores = {"n", "groups", "accuracy", "macro_f1", "macro_f1_low", "macro_f1_high", "macro_f1_over"}
    assert set(result["before_commit"]) == scores
    metrics = json.loads((tiny / "report" / "metrics.json").read_text())
    assert result["macro_f1"] == metrics["macro_f1"]
    for name in ("index.html", "record.png", "confusion.png", "loss.png"):
        assert (tiny / "report" / name).stat().st_size > 1000
    printed = (tiny.parents[1] / "printed.txt").read_text()
    assert "results/tiny/report/index.html" in printed
    assert "macro-F1" in printed
    assert "Traceback" not in printed


def test_the_python_example_of_the_readme_runs(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "results").mkdir()
    shutil.copytree(tiny, tmp_path / "results" / "quick")
    (example,) = re.findall(r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(), re.MULTILINE | re.DOTALL)
    assert len(example.splitlines()) <= 12
    exec(example, {})
    assert re.fullmatch(r"\w+: \w+, p = [01]\.\d\d\n", capfd.readouterr().out)


def test_a_finished_study_answers_again(
    tiny: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tiny.parents[1])
    shards = {path: path.stat().st_mtime_ns for path in tiny.glob("dataset/shards/*")}
    assert cosim.main(["run", "tiny.toml", "--json", "--quiet"]) == 0
    printed = capfd.readouterr()
    before = json.loads((tiny.parents[1] / "results.json").read_text())
    after = json.loads(printed.out.splitlines()[-1])
    assert {**after, "seconds": 0} == {**before, "seconds": 0}
    assert {path: path.stat().st_mtime_ns for path in tiny.glob("dataset/shards/*")} == shards
    assert [
        line for line in printed.err.splitlines() if not line.startswith(("warning: too few", "warning: SUMO"))
    ] == []


def test_the_replay_of_a_run_shows_the_other_vehicles_and_what_it_answers(
    tiny: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "replay.html"
    assert cosim.main(["replay", str(tiny / "run"), "--episode", "motorway-2", "-o", str(page), "--json"]) == 0
    printed = capfd.readouterr()
    result = json.loads(printed.out)
    assert result["others"] is True
    assert "TV and UV only" not in printed.err
    embedded = re.search(r'id="replay-data">(.*?)</script>', page.read_text(), re.DOTALL)
    assert embedded is not None
    content = json.loads(embedded[1])
    assert len(content["records"]) == result["records"] > 5
    assert all(record["answers"]["probabilities"] for record in content["records"])
    wrong = [record["id"] for record in content["records"] if record["answers"]["wrong"]]
    assert wrong == result["wrong"]
    # Neither TV nor UV is also one of the others.
    for record in content["records"]:
        ids = re.match(r"TV (\S+), UV (\S+): ", record["about"])
        assert ids is not None
        assert not {*ids.groups()} & {other["id"] for other in record["others"]}


def test_another_study_in_the_same_folder_is_refused(
    tiny: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "other.toml").write_text(TINY.replace("epochs = 1", "epochs = 2"))
    assert cosim.main(["run", str(tmp_path / "other.toml"), "-o", str(tiny)]) == 2
    assert "another study" in capfd.readouterr().err


def test_inspect_says_what_is_in_it(tiny: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert cosim.main(["inspect", str(tiny / "dataset"), "--verify", "--json"]) == 0
    printed = capfd.readouterr()
    result = json.loads(printed.out)
    assert result["verified"] is True
    assert result["samples"] == sum(result["by_intention"].values()) == sum(result["by_origin"].values()) > 20
    for name, number in result["by_intention"].items():
        assert sum(result["by_intention_and_origin"][name].values()) == number
    assert result["seeds"] == {"motorway": [1, 2, 3]}
    assert "hard_brake" in printed.err


def test_inspect_verify_notices_damage(tiny: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(tiny / "dataset", tmp_path / "data")
    shard = next((tmp_path / "data" / "shards").iterdir())
    content = bytearray(shard.read_bytes())
    content[len(content) // 2] ^= 1
    shard.write_bytes(content)
    assert cosim.main(["inspect", str(tmp_path / "data"), "--verify"]) == 2
    printed = capfd.readouterr().err
    assert shard.name in printed
    assert printed.count("\n") == 1


SENSE_BAD = {
    "--snr loud": "--snr loud: is not a range",
    "--estimator guess": "arguments: sensing.estimator",
    "--fusion eq7": "arguments: sensing.fusion.method",
    "--sites 0": "arguments: sensing.view.sites",
    "--rain -1": "arguments: sensing.channel.rain_mm_per_h",
    "--sensor sonar": "arguments: sensor",
    "--radar nlos": "--radar applies to the onboard radar only: add --sensor radar",
    "--sensor radar --radar fog": "arguments: radar.condition",
    "--sensor radar --radar nlos --pattern line_of_sight": "choose random or contiguous",
    "--records 0": "arguments: records",
    "--records 100000000000000000000": "arguments: records",
    "--sensor truth --snr 5": "--snr applies to the sites: remove it, or --sensor truth",
    "--sensor truth --rain 5": "--rain applies to sensors with echoes",
    "--sensor radar --estimator music": "--estimator applies to the sites",
    "--sensor radar --fusion eq5": "--fusion applies to the sites",
    "--sensor radar --sites 2": "--sites applies to the sites",
    "--sensor radar --no-blockage": "--no-blockage applies to the sites",
    "--sensor radar --radar clear --pattern random": "--pattern applies to --radar nlos: add it",
}


@pytest.mark.parametrize("options", SENSE_BAD)
def test_sensing_by_wrong_settings_is_one_line_and_exit_2(
    options: str, tiny: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert cosim.main(["sense", str(tiny / "dataset"), "-o", str(out), *options.split()]) == 2
    printed = capfd.readouterr().err
    assert printed.count("\n") == 1
    assert SENSE_BAD[options] in printed
    assert not out.exists()


def test_a_dataset_is_sensed_anew(tiny: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    command = ["sense", str(tiny / "dataset"), "-o", str(tmp_path / "truth"), "--sensor", "truth", "--json"]
    assert cosim.main([*command, "--jobs", "1"]) == 0
    printed = capfd.readouterr()
    result = json.loads(printed.out)
    assert cosim.main(["inspect", str(tiny / "dataset"), "--json", "--quiet"]) == 0
    before = json.loads(capfd.readouterr().out)
    assert result["sensors"] == {"truth": result["samples"]}
    assert before["sensors"] == {"isac": before["samples"]}
    assert {key: result[key] for key in ("samples", "by_intention", "seeds")} == {
        key: before[key] for key in ("samples", "by_intention", "seeds")
    }
    assert "sensors: truth" in printed.err
    assert cosim.main(["inspect", str(tmp_path / "truth"), "--verify", "--quiet"]) == 0


def test_train_and_evaluate_by_hand(tiny: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    run = tmp_path / "run"
    assert cosim.main(["train", str(tiny / "dataset"), "-o", str(run), "--epochs", "1", "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["run"] == str(run)
    assert cosim.main(["evaluate", str(run), "--data", str(tiny / "dataset"), "--json", "--quiet"]) == 0
    result = json.loads(capfd.readouterr().out)
    assert {"n", "accuracy", "macro_f1", "per_class_f1", "confusion", "auroc_unknown", "by_lead_time"} <= set(result)
    assert (run / "evaluation" / "metrics.json").is_file()


def test_runs_compared_by_hand_one_with_an_intention_held_out(
    tiny: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    data, runs = str(tiny / "dataset"), [str(tmp_path / name) for name in ("whole", "without")]
    assert cosim.main(["train", data, "-o", runs[0], "--model", "trees"]) == 0
    assert cosim.main(["train", data, "-o", runs[1], "--model", "trees", "--held-out", "overtake"]) == 0
    capfd.readouterr()
    command = ["evaluate", runs[1], "--data", data, "--against", runs[0], "--json", "--quiet"]
    assert cosim.main(command) == 0
    result = json.loads(capfd.readouterr().out)
    assert result["held_out"]["intention"] == "overtake"
    assert "held_out" not in result["compared"][0]
    assert "paired_difference" in result["compared"][0]
    assert cosim.main(["train", data, "-o", str(tmp_path / "no"), "--held-out", "following"]) == 2
    assert "held_out" in capfd.readouterr().err


@pytest.mark.slow
def test_an_interrupted_generate_keeps_what_is_finished(tmp_path: Path) -> None:
    command = [sys.executable, ROOT / "cosim.py", "generate", "motorway", "-o", "data", "--seeds", "1:3", "--jobs", "1"]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 300
    while not list(tmp_path.glob("data/shards/motorway-*")) and time.monotonic() < deadline:
        time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    _, printed = process.communicate(timeout=60)
    assert process.returncode == 130
    assert printed.splitlines()[-1].startswith("cosim: interrupted")
    assert "Traceback" not in printed
    first = (tmp_path / "data/shards/motorway-1.parquet").stat().st_mtime_ns
    resumed = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert resumed.returncode == 0, resumed.stderr
    assert (tmp_path / "data/shards/motorway-1.parquet").stat().st_mtime_ns == first
    subprocess.run([*command[:5], "again", *command[6:-1], "2"], cwd=tmp_path, check=True, capture_output=True)
    for shard in (tmp_path / "data/shards").iterdir():
        assert shard.read_bytes() == (tmp_path / "again/shards" / shard.name).read_bytes()
