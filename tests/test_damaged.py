"""Damaged and forged runs and datasets: a command refuses them in one line, or does what it does with sound ones.

A case is a file that was changed, and a command that reads it. Where the digests are left as they were, the only other
way is the very result of the sound input. Where they are made right again, or the run is of a version that stored none,
a result may be another, but nothing crashes, hangs, or takes memory without end.

`COSIM_CASES=2000:2300 pytest -m slow tests/test_damaged.py` runs these cases alone.
"""

from __future__ import annotations

import collections
import hashlib
import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from random import Random

import pytest

from isac_cosim.models.runs.settings import TrainSettings
from isac_cosim.models.training.training import train
from tests.support.damage import damage
from tests.support.forged import as_former_run, forge_dataset, forge_run
from tests.support.forking import Ended, WarmedProcess
from tests.support.made_up_dataset import write_dataset

QUICK = range(12)
SLOW = range(*map(int, os.environ.get("COSIM_CASES", "0:10000").split(":")))
RUNS = ("asi-bip", "trees", "rule")
OF_DATASET = (
    "inspect data --verify --json", "inspect data --json", "train data -o new --model rule --json",
    "evaluate trees --data data -o new --json", "evaluate rule --data data -o new --json",
    "sense data -o new --sensor truth --json", "sense data -o new --snr 5 --json",
)  # fmt: skip
SMALL = {
    "windows": {"window_s": 1.0}, "trees": {"rounds": 2}, "pre_onset": {"rounds": 2},
    "optimiser": {"epochs": 1, "threads": 1}, "asi_bip": {"hidden": 4, "width": 8, "heads": 2, "feedforward": 8},
}  # fmt: skip
met: collections.Counter[str] = collections.Counter()
"""What the cases of this run met, by what was done with the digests and the exit code."""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sound dataset, and a sound run of each kind."""
    folder = tmp_path_factory.mktemp("inputs") / "sound"
    dataset = write_dataset(folder / "data", seeds=3, per_class=1, passing=True)
    for model in RUNS:
        train(dataset, folder / model, TrainSettings.model_validate({**SMALL, "model": model}))
        (folder / model / ".lock").unlink(missing_ok=True)
    return folder


@pytest.fixture(scope="module")
def warmed() -> Iterator[WarmedProcess]:
    with WarmedProcess() as process:
        yield process


def result(folder: Path, ended: Ended) -> tuple[str, dict[str, str]]:
    """What a command printed and wrote; pages tell no more than these."""
    new = folder / "new"
    files = {
        str(path.relative_to(new)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(new.rglob("*"))
        if path.is_file() and path.name not in (".lock", "log.jsonl", "index.html")
    }
    return ended.out, files


def case(inputs: Path, folder: Path, number: int) -> tuple[str, str, str]:
    """Make the inputs of a case in a folder. Returns its command, what becomes of digests, and what was damaged."""
    random = Random(f"damaged {number}")
    shutil.copytree(inputs, folder)
    kind = random.choice(("data", *RUNS))
    files = [path for path in sorted((folder / kind).rglob("*")) if path.is_file()]
    digests = random.choice(("kept", "forged", "forged" if kind == "data" else "former"))
    done = damage(random.choice(files), random)
    if kind == "data":
        command = f"{random.choice(OF_DATASET)} --quiet"
        if digests == "forged":
            forge_dataset(folder / "data")
    else:
        command = f"evaluate {kind} --data data -o new --json --quiet"
        if digests == "forged":
            forge_run(folder / kind)
        elif digests == "former":
            with_former_card(folder / kind)
    return command, digests, f"{kind}/{done}"


def with_former_card(folder: Path) -> None:
    """Make a run one without digests, if its card can still be read."""
    try:
        as_former_run(folder)
    except (KeyError, OSError, TypeError, ValueError):
        return


def fault(ended: Ended, digests: str, same: bool) -> str | None:
    """What is wrong with how a command ended, None if nothing is."""
    lines = ended.err.splitlines()
    if ended.code == 2:
        if ended.out or len(lines) != 1 or not lines[0].startswith("cosim: ") or len(lines[0]) > 2000:
            return "it was not refused in one line"
        return None
    if "Traceback" in ended.err or "Warning: " in ended.err:
        return "it printed more than it should"
    if ended.code != 0:
        return f"it ended with {ended.code}"
    if digests == "kept" and not same:
        return "it gave another result, unnoticed"
    return None


@pytest.mark.parametrize("cases", [QUICK, pytest.param(SLOW, marks=pytest.mark.slow)])
def test_damaged_input_is_refused_or_does_no_harm(
    inputs: Path, warmed: WarmedProcess, tmp_path: Path, cases: range
) -> None:
    sound: dict[str, tuple[str, dict[str, str]]] = {}
    faults = []
    for number in cases:
        folder = tmp_path / "case"
        command, digests, done = case(inputs, folder, number)
        ended = warmed.run(folder, [command.split()])
        met[f"{digests} {ended.code}"] += 1
        same = True
        if ended.code == 0 and digests == "kept":
            if command not in sound:
                whole = tmp_path / "sound"
                shutil.copytree(inputs, whole)
                sound[command] = result(whole, warmed.run(whole, [command.split()]))
                shutil.rmtree(whole)
            same = result(folder, ended) == sound[command]
        if problem := fault(ended, digests, same):
            faults.append(f"case {number}: {problem}: {command}; {digests}; {done}\n{ended.err[-1500:]}")
        shutil.rmtree(folder)
    print(json.dumps(dict(sorted(met.items()))))
    assert not faults, f"{len(faults)} of {len(cases)}\n" + "\n".join(faults[:20])


def test_sound_input_is_not_refused(inputs: Path, warmed: WarmedProcess, tmp_path: Path) -> None:
    """Forged without a change, and of a version without digests: the result is the same."""
    for change in (lambda folder: None, forge_run, as_former_run):
        folder = tmp_path / "case"
        shutil.copytree(inputs, folder)
        change(folder / "trees")
        forge_dataset(folder / "data")
        ended = warmed.run(folder, [["evaluate", "trees", "--data", "data", "-o", "new"]])
        assert ended.code == 0, ended.err
        shutil.rmtree(folder)
