"""Damaged files of trajectories, in every format: `generate` refuses them in one line, or makes a dataset of them.

`COSIM_CASES=2000:2300 pytest -m slow tests/isacsim/traffic/sources/test_damaged_recordings.py` runs these cases alone.
"""

from __future__ import annotations

import collections
import json
import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest

from isac_cosim.isacsim.traffic.recordings.recording import COLUMNS, Recording
from tests.support.exid_writer import write_exid
from tests.support.forking import Ended, WarmedProcess
from tests.support.highd_writer import straight_recording, write_highd
from tests.support.lanelet_writer import UTM, write_lanelets
from tests.support.ngsim_writer import ngsim_rows, write_csv, write_txt
from tests.support.recording_damage import damage_recording
from tests.support.sumo_recording import motorway_recording
from tests.support.trajectory_writers import states, write_fcd

QUICK = range(8)
SLOW = range(*map(int, os.environ.get("COSIM_CASES", "0:10000").split(":")))
FORMATS = {
    "xml": "fcd --network motorway", "csv": "fcd --network motorway", "parquet": "fcd --network motorway",
    "highd": "levelx", "exid": "levelx", "txt": "ngsim", "merged": "ngsim",
}  # fmt: skip
"""Sources with their options, by the folder that holds a file of them."""
met: collections.Counter[str] = collections.Counter()
"""Exit codes by format."""


def short(recording: Recording, vehicles: int = 10, seconds: float = 12.0) -> Recording:
    """The first seconds of the vehicles that are there longest."""
    begin = min(track.first_step for track in recording.tracks.values())
    end = begin + round(seconds / recording.step_s)
    longest = sorted(recording.tracks.values(), key=lambda track: (track.first_step, -len(track)))[:vehicles]
    tracks = {
        track.vehicle: replace(track, **{name: getattr(track, name)[: end - track.first_step] for name in COLUMNS})
        for track in longest
    }
    return replace(recording, tracks=tracks)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short recording in each format, each in a folder of its own."""
    folder = tmp_path_factory.mktemp("inputs") / "sound"
    motorway, straight = short(motorway_recording()), short(straight_recording(1))
    for kind in FORMATS:
        (folder / kind).mkdir(parents=True)
    for kind in ("xml", "csv", "parquet"):
        write_fcd(folder / kind / f"drive.{kind}", states(motorway, every=4), persons=True)
    write_highd(folder / "highd", None, straight)
    write_exid(folder / "exid", motorway, utm=UTM)
    write_lanelets(folder / "exid" / "place.osm", motorway.lanes)
    rows, _ = ngsim_rows(straight)
    write_txt(folder / "txt" / "trajectories.txt", rows)
    write_csv(folder / "merged" / "all.csv", rows)
    return folder


@pytest.fixture(scope="module")
def warmed() -> Iterator[WarmedProcess]:
    with WarmedProcess() as process:
        yield process


def command(folder: Path, kind: str) -> list[str]:
    file = (
        kind if kind in ("highd", "exid") else next(str(path.relative_to(folder)) for path in (folder / kind).iterdir())
    )
    return f"generate {file} --source {FORMATS[kind]} --snr 10 -o new --json --quiet".split()


def fault(ended: Ended) -> str | None:
    """What is wrong with how a command ended, None if nothing is."""
    lines = ended.err.splitlines()
    if ended.code == 2:
        one = len(lines) == 1 and lines[0].startswith("cosim: ") and len(lines[0]) <= 2000
        return None if one and not ended.out else "it was not refused in one line"
    if "Traceback" in ended.err or "Warning: " in ended.err:
        return "it printed more than it should"
    return None if ended.code == 0 else f"it ended with {ended.code}"


@pytest.mark.parametrize("cases", [QUICK, pytest.param(SLOW, marks=pytest.mark.slow)])
def test_a_damaged_recording_is_refused_or_read(
    inputs: Path, warmed: WarmedProcess, tmp_path: Path, cases: range
) -> None:
    faults = []
    for number in cases:
        random = Random(f"damaged recording {number}")
        folder = tmp_path / "case"
        kind = random.choice([*FORMATS])
        shutil.copytree(inputs / kind, folder / kind)
        words = command(folder, kind)
        done = damage_recording(random.choice(sorted((folder / kind).iterdir())), random)
        ended = warmed.run(folder, [words])
        met[f"{kind} {ended.code}"] += 1
        if problem := fault(ended):
            faults.append(f"case {number}: {problem}: {' '.join(words)}; {done}\n{ended.err[-1500:]}")
        shutil.rmtree(folder)
    print(json.dumps(dict(sorted(met.items()))))
    assert not faults, f"{len(faults)} of {len(cases)}\n" + "\n".join(faults[:20])


@pytest.mark.parametrize("kind", FORMATS)
def test_a_sound_recording_is_read(inputs: Path, warmed: WarmedProcess, tmp_path: Path, kind: str) -> None:
    shutil.copytree(inputs / kind, tmp_path / kind)
    ended = warmed.run(tmp_path, [command(tmp_path, kind)])
    assert (ended.code, ended.err.count("Traceback")) == (0, 0), ended.err
    assert "samples" in json.loads(ended.out.splitlines()[-1])
