"""The command line: a whole study through SUMO, what its commands print and write, and interrupts."""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import cosim

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


def test_an_unknown_model_is_bad_input(tiny: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert cosim.main(["train", str(tiny / "dataset"), "-o", str(tmp_path / "run"), "--model", "oracle"]) == 2
    assert capfd.readouterr().err.count("\n") == 1
    assert not (tmp_path / "run").exists()


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


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_train_and_evaluate_by_hand(tiny: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    run = tmp_path / "run"
    assert cosim.main(["train", str(tiny / "dataset"), "-o", str(run), "--epochs", "1", "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["run"] == str(run)
    assert cosim.main(["evaluate", str(run), "--data", str(tiny / "dataset"), "--json", "--quiet"]) == 0
    result = json.loads(capfd.readouterr().out)
    assert {"n", "accuracy", "macro_f1", "per_class_f1", "confusion", "auroc_unknown", "by_lead_time"} <= set(result)
    assert (run / "evaluation" / "metrics.json").is_file()


@pytest.mark.slow
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
