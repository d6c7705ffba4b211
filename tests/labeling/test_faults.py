"""What goes wrong on disks and roads: the right line, nothing half-written, nothing foreign touched."""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from scripted import InlineEngine, ScriptedSource, small_study

import cosim
from isacsim.errors import InputError, OutputError, RunError, output_error
from isacsim.recording import Recording
from isacsim.scenario import Scenario
from labeling.dataset import Dataset, read_shard
from labeling.engine import Engine, LocalEngine
from labeling.generate import generate
from labeling.summary import faults, summary

sys.path.append(str(Path(__file__).parents[1] / "isacsim"))
from roads import straight_road, vehicle

INLINE = InlineEngine()
STUDY = small_study(seeds={"first": 1, "last": 2})


@dataclass(frozen=True)
class FullDisk(ScriptedSource):
    """Makes the temporary files of one kind, whose names are known, lead to where no byte fits."""

    partial: Path = Path()

    def record(self, scenario: Scenario, seed: int) -> Recording:
        if seed == 2:
            self.partial.symlink_to("/dev/full")
        return super().record(scenario, seed)


@pytest.mark.parametrize("file", ["shards/road-2.parquet", "dataset.json"])
def test_a_full_disk_ends_the_command_and_leaves_nothing_half_written(tmp_path: Path, file: str) -> None:
    """The operating system's own ENOSPC, on a shard and on the last write."""
    data = tmp_path / "data"
    path = data / file
    full = FullDisk(tmp_path, partial=path.with_name(f".{path.name}.{os.getpid()}"))
    with pytest.raises(OutputError, match=rf"{path.name}: cannot be written \(.*No space left on device.*\)") as caught:
        generate(STUDY, data, INLINE, source=full)
    assert "\n" not in str(caught.value)
    assert list(data.rglob(".*")) == []
    assert (data / "shards/road-1.parquet").is_file()
    with pytest.raises(InputError, match="not finished"):
        Dataset.open(data)
    made = generate(STUDY, data, INLINE, source=ScriptedSource(tmp_path))
    assert made.digest == generate(STUDY, tmp_path / "other", INLINE, source=ScriptedSource(tmp_path)).digest


@pytest.mark.parametrize("wrapped", [True, False])
def test_a_full_disk_is_one_line_and_exit_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], wrapped: bool
) -> None:
    def fail(*_: object, **__: object) -> None:
        try:
            Path("/dev/full").write_text("x")
        except OSError as error:
            raise output_error(tmp_path, error) if wrapped else error from None

    monkeypatch.setattr("labeling.generate.generate", fail)
    assert cosim.main(["generate", "motorway", "-o", str(tmp_path / "data"), "--jobs", "1"]) == 1
    said = capfd.readouterr().err
    assert said.startswith("cosim: ")
    assert said.count("\n") == 1
    assert "No space left on device" in said


@pytest.fixture
def made(tmp_path: Path) -> Dataset:
    return generate(STUDY, tmp_path / "data", INLINE, source=ScriptedSource(tmp_path))


def test_a_truncated_shard_is_told_by_whoever_reads_it(made: Dataset, capfd: pytest.CaptureFixture[str]) -> None:
    shard = made.shard_path(made.meta.shards[1])
    shard.write_bytes(shard.read_bytes()[:-100])
    for line in ("inspect DATA", "inspect DATA --verify", "train DATA -o DATA/../run"):
        assert cosim.main(line.replace("DATA", str(made.path)).split()) == 2
        said = capfd.readouterr().err.splitlines()[-1]
        assert said.startswith(f"cosim: {shard}: ")


def test_a_shard_of_another_version_is_told(made: Dataset, tmp_path: Path) -> None:
    path = made.shard_path(made.meta.shards[0])
    table = pq.read_table(path)
    episode = {**json.loads(table.schema.metadata[b"cosim.episode"]), "schema_version": 2, "new": 1}
    pq.write_table(table.replace_schema_metadata({b"cosim.episode": json.dumps(episode)}), path)
    with pytest.raises(InputError, match=r"road-1\.parquet: a shard of schema version 2, not 1"):
        read_shard(path)
    before = made.digest
    assert generate(STUDY, made.path, INLINE, source=ScriptedSource(tmp_path)).digest == before


@contextmanager
def unprivileged() -> Iterator[None]:
    """As a user whom permissions bind."""
    own = os.geteuid()
    if own == 0:
        os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(own)


def test_a_read_only_folder_is_bad_input(made: Dataset, tmp_path: Path) -> None:
    """A new dataset in it, one to go on with, and one whose shards alone are read-only."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(made.path, folder / "data")
        (folder / "road").mkdir()
        shutil.copy(tmp_path / "road.net.xml", folder / "road")
        for path in (folder / "data", folder / "data/shards", folder):
            path.chmod(0o555)
        (folder / "road").chmod(0o777)
        (folder / "road/road.net.xml").chmod(0o666)
        source = ScriptedSource(folder / "road")
        with unprivileged():
            with pytest.raises(InputError, match=r"new: cannot be used .*Permission denied"):
                generate(STUDY, folder / "new", INLINE, source=source)
            with pytest.raises(InputError, match="data: is read-only"):
                generate(STUDY, folder / "data", INLINE, source=source)
        assert Dataset.open(folder / "data").digest == made.digest
        for path in (folder, folder / "data", folder / "data/shards"):
            path.chmod(0o755)


def masts(first: tuple[float, float]) -> str:
    """Sites 80 m off both sides of a road along x, but for the first."""
    places = [first, *((60 + 150 * (k // 2), 80 if k % 2 else -80) for k in range(1, 14))]
    return "".join(
        f'<poi id="s{k}" x="{x}" y="{y}" type="isac_site"><param key="height" value="15"/>'
        f'<param key="azimuth" value="{180 if y >= 0 else 0}"/></poi>'
        for k, (x, y) in enumerate(places)
    )


def on_road(
    folder: Path, cars: str, lanes: int, first: tuple[float, float] = (60, 80), engine: Engine = INLINE
) -> Dataset:
    """A dataset of 40 s of SUMO's traffic on a straight road."""
    scenario = straight_road(folder / "r", cars, masts(first), lanes=lanes)
    study = small_study(
        scenarios=[str(scenario)],
        seeds={"first": 1, "last": 1},
        traffic={"run_in_s": 30.0, "duration_s": 40.0},
        maneuvers={"rest_s": 1.0},
    )
    return generate(study, folder / "data", engine)


def convoy(lane: int) -> str:
    return "".join(vehicle(f"v{k}", depart=2.5 * k, lane=lane, speed=20.0) for k in range(12))


def test_one_lane_roads_have_no_events_across_lanes(tmp_path: Path) -> None:
    made = on_road(tmp_path, convoy(0), 1)
    made.verify()
    counts = made.meta.by_intention()
    assert made.meta.samples > 0
    assert counts["left_lane_change"] == counts["right_lane_change"] == counts["overtake"] == 0


def test_no_traffic_makes_an_empty_dataset_that_says_so(tmp_path: Path) -> None:
    made = on_road(tmp_path / "late", vehicle("late", depart=9999.0, lane=0), 1)
    made.verify()
    assert made.meta.samples == 0
    assert any(line.startswith("no sample was found") for line in faults(summary(made)))
    with pytest.raises(InputError, match="has no demand"):
        on_road(tmp_path / "none", "", 1)


def test_a_site_on_top_of_the_road_sees_what_it_sees(tmp_path: Path) -> None:
    made = on_road(tmp_path, convoy(1), 3, first=(300.0, -5.4))
    made.verify()
    assert made.meta.samples > 0
    assert max(error for shard in made.meta.shards for error in shard.episode.state_error_m) < 0.5


def test_what_sumo_says_of_a_lost_episode_is_shown_as_it_is(tmp_path: Path) -> None:
    """From a worker process, where SUMO's own exceptions cannot leave: a car that wants to enter beyond the limit."""
    with pytest.raises(RunError) as caught:
        on_road(tmp_path, vehicle("racer", depart=1.0, lane=0, speed=90.0), 1, engine=LocalEngine(1))
    assert str(caught.value).startswith("all 1 episodes failed, the first with: r, seed 1: Departure speed for vehicle")
    (line,) = (tmp_path / "data/log.jsonl").read_text().splitlines()
    assert (json.loads(line)["outcome"], json.loads(line)["retries"]) == ("lost", 2)
