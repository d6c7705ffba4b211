"""Studies of a demand that puts its vehicles into every seed: what is said of them, and the two ways out."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

import cosim
from isac_cosim.base.feedback import Feedback
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.dataset.dependence import Driven
from isac_cosim.studies.single import claim_study, run_study
from isac_cosim.studies.study import read_study
from tests.support.roads import straight_road, vehicle
from tests.support.scripted import InlineEngine

STUDY = """
[dataset]
scenarios = ["road"]
seeds = {{ first = 1, last = 3 }}
traffic = {{ run_in_s = 30.0, duration_s = 60.0 }}
maneuvers = {{ rest_s = 1.0 }}
record = {{ tv_rate_hz = 40.0, uv_rate_hz = 20.0 }}

[training]
model = "trees"
split = {{ by = "{by}" }}
optimiser = {{ threads = 1 }}
trees = {{ rounds = 5 }}
pre_onset = {{ rounds = 5 }}
"""
EVERY_S = 2.0
"""Time between departures of the vehicles that every seed has, s."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a scenario `road`: cars that its demand names, and others that a flow draws."""
    folder = tmp_path_factory.mktemp("seeds")
    sites = "".join(
        f'<poi id="s{k}" x="{60 + 150 * (k // 2)}" y="{80 if k % 2 else -80}" type="isac_site">'
        f'<param key="height" value="15"/><param key="azimuth" value="{180 if k % 2 else 0}"/></poi>'
        for k in range(30)
    )
    flow = (
        '<flow id="f" type="car" route="all" begin="0" end="90" probability="0.1" departLane="2" '
        'departPos="10" departSpeed="25"/>'
    )
    cars = "".join(vehicle(f"v{k}", EVERY_S * k, lane=k % 3, speed=20.0) for k in range(36))
    straight_road(folder / "road", flow + cars, sites)
    return folder


class Listening(Feedback):
    """Keeps what is said."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def message(self, line: str) -> None:
        self.said.append(line)


def run(by: str, dataset: str | None = None) -> list[str]:
    """Run the study with a split into the folder `by`; what it said.

    dataset: one that the same settings have made, to save the time.
    """
    Path(f"{by}.toml").write_text(STUDY.format(by=by))
    study, listening = read_study(Path(f"{by}.toml")), Listening()
    with claim_study(Path(by), study):
        if dataset is not None:
            shutil.copytree(dataset, Path(by, "dataset"))
    run_study(study, Path(by), InlineEngine(), listening)
    return listening.said


def of_dependence(said: list[str]) -> list[str]:
    """What was said of vehicles on two sides."""
    return [line for line in said if "also trained on" in line]


def steps(said: list[str]) -> list[str]:
    """The steps that were said to begin, each with the time that is left."""
    return [line.partition(":")[0] for line in said if " of 3: " in line and "; about " in line]


@pytest.mark.slow
def test_a_study_says_once_that_its_seeds_depend_and_how_to_part_them(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    said = run("seed")
    assert steps(said) == ["1 of 3", "2 of 3", "3 of 3"]
    (line,) = of_dependence(said)
    assert line.startswith("warning: ")
    metrics = json.loads(Path("seed/report/metrics.json").read_text())
    assert metrics["dependence"]["shared_tv"] > 0.2 * metrics["dependence"]["samples"]
    shares = (
        f"{metrics['dependence']['shared_tv']} of {metrics['dependence']['samples']} test samples have a TV that is"
    )
    assert shares in line
    assert shares in Path("seed/report/index.html").read_text()

    # The same dataset, with each vehicle on one side.
    said = run("vehicle", dataset="seed/dataset")
    assert steps(said) == ["2 of 3", "3 of 3"]
    assert of_dependence(said) == []
    parted = json.loads(Path("vehicle/report/metrics.json").read_text())
    assert parted["dependence"]["samples"] == metrics["dependence"]["samples"]
    assert parted["dependence"]["shared_tv"] == 0
    assert "also trained on" not in Path("vehicle/report/index.html").read_text()
    cards = [json.loads(Path(by, "run/run.json").read_text())["counts"] for by in ("seed", "vehicle")]
    assert 0 < sum(cards[1].values()) < sum(cards[0].values())


@pytest.mark.slow
def test_departures_are_drawn_anew_from_the_command_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    later = "".join(vehicle(f"v{k}", 60.0 + 4.0 * k, lane=k % 3, speed=20.0) for k in range(30))
    road = straight_road(folder / "later", later)
    shutil.copy(folder / "road" / "sites.add.xml", road)
    command = ["generate", "later", "-o", "drawn", "--seeds", "1:2", "--demand", "drawn", "--jobs", "1", "--quiet"]
    assert cosim.main(command) == 0
    assert "another seed" not in capsys.readouterr().err
    dataset = Dataset.open(folder / "drawn")
    frame = dataset.frame(["tv_id", "tv_departed"])
    later_s = frame["tv_departed"] - 60.0 - 4.0 * frame["tv_id"].str.removeprefix("v").astype(float)
    assert len(frame) > 5
    assert later_s.between(0.0, 60.0).all()
    assert later_s.max() > 1.0
    found = Driven.of(dataset).between_seeds()
    assert (found.shared_tv, found.near_copies) == (0, 0)
