"""The documents: their code runs, their links lead somewhere, and what they say of the project is so."""

from __future__ import annotations

import json
import os
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path
from pkgutil import resolve_name

import numpy as np
import pandas as pd
import pytest
from cffconvert import Citation

import cosim
from isac_cosim.isacsim.traffic.recordings.recording import COLUMNS
from isac_cosim.isacsim.traffic.sources.kinematic import KinematicSource
from isac_cosim.isacsim.traffic.sources.kinematic_scenes import STEP_S
from isac_cosim.isacsim.traffic.sources.kinematic_settings import KinematicSettings
from isac_cosim.labeling.dataset.dataset import Dataset
from tests.support.made_up_dataset import write_dataset

ROOT = Path(cosim.__file__).parent
EXAMPLE = ROOT / "docs" / "example_package"
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("sumo_nets/**/*.md")])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), target


def anchors(page: Path) -> set[str]:
    """What the headings of a page are linked by: lower case, without punctuation, blanks as hyphens."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#{1,6} (.*)$", text, flags=re.MULTILINE)
    plain = [re.sub(r"\[([^\]]+)\]\([^)]*\)", r"\1", heading).lower() for heading in headings]
    return {re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_into_pages_lead_to_a_heading(page: Path) -> None:
    for target, anchor in re.findall(r"\]\(([^)#\s]*)#([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if "://" not in target:
            assert anchor in anchors(page.parent / target if target else page), f"{target}#{anchor}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_files_that_are_named_exist(page: Path) -> None:
    """`isacsim/radio/echo.py` in a text, unless a path of the example package."""
    for name in re.findall(
        r"`((?:base|isacsim|labeling|models|evaluation|studies|benchmarks|command_line|tests|docs)/[\w/.]+)`",
        page.read_text(),
    ):
        assert (ROOT / name).exists(), name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_names_that_are_imported_exist(page: Path) -> None:
    """`isac_cosim.isacsim.tracking.fusion_tdoa_aoa` in a text, or a function in it; no group of entry points."""
    for name in re.findall(r"`(isac_cosim\.\w+(?:\.\w+)+)`", page.read_text(encoding="utf-8")):
        resolve_name(name)


SCRIPTS = sorted(path for path in ROOT.glob("docs/*.py") if path.name != "conf.py")


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.name)
def test_the_scripts_of_the_documents_load(script: Path) -> None:
    assert "main" in runpy.run_path(str(script), run_name="loaded")


def test_the_citation_is_valid_and_of_this_version() -> None:
    citation = Citation((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    citation.validate()
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert f"version: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"## {version}\n" in (ROOT / "CHANGELOG.md").read_text()


@pytest.mark.parametrize("path", sorted(EXAMPLE.glob("my_cosim_parts/*.py")), ids=lambda path: path.name)
def test_the_files_of_the_example_package_are_short(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 40


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment in which the example package of docs/extending.md is installed."""
    folder = tmp_path_factory.mktemp("site")
    shutil.copytree(EXAMPLE / "my_cosim_parts", folder / "my_cosim_parts", ignore=shutil.ignore_patterns("__pycache__"))
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]
    metadata = folder / "my_cosim_parts-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: my-cosim-parts\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(
        "".join(
            f"[{group}]\n" + "".join(f"{name} = {place}\n" for name, place in points.items())
            for group, points in project["entry-points"].items()
        )
    )
    return {**os.environ, "PYTHONPATH": os.pathsep.join((str(folder), str(ROOT)))}


STUDY = """
[dataset]
scenarios = ["tracks.csv"]
source = "drone"
seeds = { first = 1, last = 2 }
drone = { frame_s = 0.05 }
record = { tv_rate_hz = 40.0, uv_rate_hz = 20.0 }

[dataset.labels]
preset = "gentle-1"

[dataset.labels.detectors.gentle_brake]
threshold_mps2 = 0.6
"""
FRAMES_S = 0.05
GENERATE = "generate tracks.csv -o drone --source drone --seeds 1:2 --jobs 1 --quiet"
EVALUATE = "evaluate nearest --traffic tracks.csv --source drone --seeds 2:2 --development 1:1 --jobs 1 --quiet"
COMMANDS = (
    "sense data -o gnss --sensor gnss --jobs 1 --quiet",
    "sense data -o codebook --estimator codebook --jobs 1 --quiet",
    "sense data -o best --fusion best_site --jobs 1 --quiet",
    "train --help",
    "train data -o nearest --model nearest --quiet",
    "evaluate nearest --data data --json --quiet",
    GENERATE,
    EVALUATE + " -o live --json",
)
REFUSED = {
    "generate tracks.csv -o none --source drone --seeds 8:9": "tracks: has no seed of 8:9; it has 1 to 2; name others",
    EVALUATE.replace("2:2", "2:3"): "tracks: has no seed 3; give other --seeds or --development",
    EVALUATE + " --advisories": "source drone: has recordings only, and a closed loop needs a world that runs",
    EVALUATE + " --natural": "--natural: source drone has no world in which drivers are left alone; leave it out",
    EVALUATE + " --stress": "--stress: source drone has no world in which drivers are left alone; leave it out",
}
AFTER_A_CHANGE = {
    GENERATE: "drone: holds a dataset, and tracks.csv of tracks has changed since it was begun",
    EVALUATE + " -o live": "live: tracks.csv has changed since the evaluation was begun",
}
SCRIPT = """
import contextlib, io, json, sys
from pathlib import Path

import cosim
from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.base.workers.kept_workers import kept_running
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.studies.study import read_study


def said_by(command):
    with contextlib.redirect_stdout(io.StringIO()) as output, contextlib.redirect_stderr(io.StringIO()) as errors:
        code = cosim.main(command.split())
    return code, output.getvalue(), errors.getvalue()


if __name__ == "__main__":
    with kept_running(LocalEngine(1)) as kept:  # one worker process for all
        LocalEngine.run = lambda engine, *arguments, **named: kept.run(*arguments, **named)
        if not Path("generated").exists() and Path("study.toml").exists():
            generate(read_study(Path("study.toml")).dataset, Path("generated"), LocalEngine(1))
        print(json.dumps({command: said_by(command) for command in sys.argv[1:]}))
"""


def write_tracks(path: Path) -> None:
    """What a drone sees of two episodes of the kinematic source, once every `FRAMES_S`."""
    source = KinematicSource(KinematicSettings(per_class=1, following_scenes=1))
    every = round(FRAMES_S / STEP_S)
    rows = []
    for block in (1, 2):
        for name, track in source.record(source.load("straight_road"), block).tracks.items():
            seen = pd.DataFrame({column: getattr(track, column) for column in COLUMNS})
            seen.insert(0, "frame", (track.first_step + np.arange(len(track))) // every)
            seen.insert(0, "vehicle", name)
            seen.insert(0, "block", block)
            rows.append(seen[-track.first_step % every :: every])
    pd.concat(rows).to_csv(path, index=False)


def said(folder: Path, parts: dict[str, str], commands: Iterable[str]) -> dict[str, tuple[int, str, str]]:
    """Run commands in one process that has the package; return exit code and both outputs of each."""
    done = subprocess.run(
        [sys.executable, "script.py", *commands], cwd=folder, env=parts, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return {command: tuple(outcome) for command, outcome in json.loads(done.stdout.splitlines()[-1]).items()}


@pytest.fixture(scope="module")
def printed(parts: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """The folder in which the COMMANDS ran and a dataset was generated, in a process that has the package, and what
    each command printed on standard output."""
    folder = tmp_path_factory.mktemp("commands")
    write_dataset(folder / "data")
    write_tracks(folder / "tracks.csv")
    (folder / "study.toml").write_text(STUDY)
    (folder / "script.py").write_text(SCRIPT)
    outcomes = said(folder, parts, COMMANDS)
    assert {command: error for command, (code, _, error) in outcomes.items() if code} == {}
    return folder, {command: output for command, (_, output, _) in outcomes.items()}


@pytest.mark.slow
def test_the_parts_of_an_installed_package_work_through_the_commands(printed: tuple[Path, dict[str, str]]) -> None:
    """One of each kind, added without touching a file of the project."""
    folder, output = printed
    frame = Dataset.open(folder / "gnss").frame(["sensor", "n_sites"])
    assert set(frame["sensor"]) == {"gnss"}
    assert "nearest" in output["train --help"]
    metrics = json.loads(output["evaluate nearest --data data --json --quiet"].splitlines()[-1])
    assert (metrics["model"], metrics["name"]) == ("nearest", "nearest mean")
    assert metrics["macro_f1"] > 0.2
    sure = metrics["answers"]["sureness"]
    assert 0 < sure["wrong"] <= 1
    page = (folder / "nearest" / "evaluation" / "index.html").read_text()
    assert "<h2>How sure is the run?</h2>" in page
    assert f"<td>right</td><td>{sure['right']:.4g}</td>" in page


@pytest.mark.slow
def test_a_detector_and_a_source_of_an_installed_package_generate_samples(
    printed: tuple[Path, dict[str, str]],
) -> None:
    """In worker processes: the study's settings of both count and are stored, and every gentle brake is an event."""
    folder, _ = printed
    generated, by_default = Dataset.open(folder / "generated"), Dataset.open(folder / "drone")
    meta = generated.meta
    assert meta.study["labels"]["detectors"] == {"gentle_brake": {"threshold_mps2": 0.6}}
    assert (meta.study["source"], meta.study["drone"]) == ("drone", {"frame_s": 0.05})
    assert by_default.meta.study["drone"] == {"frame_s": 0.04}
    assert set(generated.frame(["source"])["source"]) == {"drone"}
    assert set(meta.by_origin()) == {"natural"}
    brakes = [sum(shard.episode.events["hard_brake"] for shard in of.shards) for of in (meta, by_default.meta)]
    assert brakes[0] > brakes[1] > 0
    assert {"traffic", "maneuvers"}.isdisjoint(meta.study)


@pytest.mark.slow
def test_a_source_of_an_installed_package_is_evaluated_in_its_traffic(printed: tuple[Path, dict[str, str]]) -> None:
    folder, output = printed
    result = json.loads(output[EVALUATE + " -o live --json"].splitlines()[-1])
    assert result["vehicle_hours"] > 0
    study = json.loads((folder / "live" / "study.json").read_text())
    assert (study["study"]["dataset"]["source"], set(study["inputs"])) == ("drone", {"tracks.csv"})


@pytest.mark.slow
def test_what_a_source_of_an_installed_package_cannot_do_is_one_line(
    parts: dict[str, str], printed: tuple[Path, dict[str, str]]
) -> None:
    """Seeds that are not there, a closed loop, drivers left alone; and afterwards, a file that has changed."""
    folder, _ = printed
    outcomes = said(folder, parts, REFUSED)
    changed = folder / "changed"
    changed.mkdir()
    for name in ("script.py", "tracks.csv"):
        shutil.copy(folder / name, changed)
    for name in ("drone", "live", "nearest"):
        shutil.copytree(folder / name, changed / name)
    with (changed / "tracks.csv").open("a") as file:
        file.write("2,late,1,0.0,0.0,20.0,1,50.0,0.0\n")
    outcomes |= said(changed, parts, AFTER_A_CHANGE)
    for command, line in (REFUSED | AFTER_A_CHANGE).items():
        code, _, error = outcomes[command]
        assert code == 2, command
        assert len(error.splitlines()) == 1, error
        assert line in error
    assert not (folder / "none").exists()
