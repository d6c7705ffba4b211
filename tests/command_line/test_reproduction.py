"""`reproduce`: what it is given, what it states before it starts, and what it shows."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from rich.console import Console

import cosim
from isac_cosim.command_line.reproduction import reproduce_and_show
from isac_cosim.evaluation.statistics import Estimate
from isac_cosim.studies.reproduction import reproduce as reproduction
from isac_cosim.studies.reproduction.experiments.verdicts import Claim
from isac_cosim.studies.reproduction.reproduce import ReproductionResult, request
from tests.support.scripted import InlineEngine

CLAIM = Claim(
    claim="A is better than B",
    paper="+0.06",
    rule="the difference is above 0",
    measured=Estimate(value=0.05, low=0.01, high=0.09),
    verdict="holds",
)


def test_a_dry_run_states_the_cost_and_writes_nothing(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    arguments = ["reproduce", "asi-bip", "-o", str(tmp_path / "out"), "--stages", "table1,fig5", "--dry-run", "--json"]
    assert cosim.main([*arguments, "--jobs", "2"]) == 0
    out, err = capfd.readouterr()
    cost = json.loads(out)
    assert list(cost["stages"])[-2:] == ["isac-grid-weather", "fig5"]
    assert cost["workers"] == 2
    assert cost["cpu_s"] > cost["seconds"] > max(cost["stages"].values())
    assert "16 stages to run: about" in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["lstm"], "lstm: no such paper; choose asi-bip or castformer"),
        (["asibip"], "asibip: no such paper; did you mean asi-bip? choose"),
        (["asi-bip", "--stages", "fig9"], "--stages fig9: no such stage; choose among data"),
        (["asi-bip", "--clips", "clips"], "--clips applies to castformer only"),
        (["castformer", "--clips", "nowhere"], "--clips nowhere: no such folder"),
        (["castformer", "--background", "0"], "--background names a class of the clips; give --clips FOLDER"),
    ],
)
def test_wrong_arguments(arguments: list[str], message: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert cosim.main(["reproduce", *arguments, "--dry-run"]) == 2
    assert message in capfd.readouterr().err


def test_the_verdicts_are_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    result = ReproductionResult(page=tmp_path / "index.html", claims=[CLAIM], not_run=["fig5"])
    monkeypatch.setattr(reproduction, "reproduce", lambda *_: result)
    console = Console(file=io.StringIO(), width=200)
    shown = reproduce_and_show(request("asi-bip", tmp_path, quick=True), InlineEngine(), console)
    printed = console.file.getvalue()  # type: ignore[attr-defined]
    assert "holds" in printed
    assert "0.050 (0.010 to 0.090)" in printed
    assert "these figures say nothing about the paper" in printed
    assert "not run: fig5" in printed
    assert shown["claims"][0]["verdict"] == "holds"
    assert printed.count(CLAIM.claim) == 1
