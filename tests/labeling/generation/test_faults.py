"""What goes wrong on disks and roads: the right line, nothing half-written, nothing foreign touched."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import cosim
from isac_cosim.base.errors import InputError, OutputError, RunError, output_error
from isac_cosim.base.workers.engine import Engine
from isac_cosim.base.workers.kept_workers import KeptWorkers
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.labeling.dataset.dataset import Dataset, read_shard
from isac_cosim.labeling.dataset.shard import read_episode
from isac_cosim.labeling.dataset.summary import faults, summary
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.settings import DatasetStudy
from tests.support.roads import straight_road, vehicle
from tests.support.scripted import InlineEngine, ScriptedSource, small_study

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


needs_full_device = pytest.mark.skipif(not Path("/dev/full").exists(), reason="/dev/full is of Linux")


@needs_full_device
@pytest.mark.parametrize("file", ["shards/road-2.parquet", "dataset.json"])
def test_a_full_disk_ends_the_command_and_leaves_nothing_half_written(tmp_path: Path, file: str) -> None:
    """The operating system's own ENOSPC, on a shard and on the last write."""
    data = tmp_path / "data"
    path = data / file
    full = FullDisk(tmp_path, partial=path.with_name(f".{os.getpid()}-{path.name}"))
    with pytest.raises(OutputError, match=rf"{path.name}: cannot be written \(.*No space left on device.*\)") as caught:
        generate(STUDY, data, INLINE, source=full)
    assert "\n" not in str(caught.value)
    assert list(data.rglob(".*-*")) == []
    assert (data / "shards/road-1.parquet").is_file()
    with pytest.raises(InputError, match="not finished"):
        Dataset.open(data)
    dataset = generate(STUDY, data, INLINE, source=ScriptedSource(tmp_path))
    assert dataset.digest == generate(STUDY, tmp_path / "other", INLINE, source=ScriptedSource(tmp_path)).digest


@needs_full_device
@pytest.mark.parametrize("wrapped", [True, False])
def test_a_full_disk_is_one_line_and_exit_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], wrapped: bool
) -> None:
    def fail(*_: object, **__: object) -> None:
        try:
            Path("/dev/full").write_text("x")
        except OSError as error:
            raise output_error(tmp_path, error) if wrapped else error from None

    monkeypatch.setattr("isac_cosim.labeling.generation.generate.generate", fail)
    assert cosim.main(["generate", "motorway", "-o", str(tmp_path / "data"), "--jobs", "1"]) == 1
    stderr = capfd.readouterr().err
    assert stderr.startswith("cosim: ")
    assert stderr.count("\n") == 1
    assert "No space left on device" in stderr


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    return generate(STUDY, tmp_path / "data", INLINE, source=ScriptedSource(tmp_path))


def test_a_flipped_byte_is_reported_by_every_reader(dataset: Dataset, capfd: pytest.CaptureFixture[str]) -> None:
    """In the values, where the file's own structure does not notice."""
    shard = dataset.shard_path(dataset.meta.shards[1])
    group = pq.ParquetFile(shard).metadata.row_group(0)
    tv = next(group.column(k) for k in range(group.num_columns) if group.column(k).path_in_schema.startswith("tv."))
    content = bytearray(shard.read_bytes())
    content[tv.data_page_offset + tv.total_compressed_size // 2] ^= 4
    shard.write_bytes(content)
    for line in (
        "inspect DATA --verify",
        "train DATA -o DATA/../run",
        "sense DATA -o DATA/../anew --sensor truth --jobs 1",
    ):
        assert cosim.main(line.replace("DATA", str(dataset.path)).split()) == 2
        assert capfd.readouterr().err.splitlines()[-1].startswith(f"cosim: {shard}: ")


def test_a_truncated_shard_is_reported_by_every_reader(dataset: Dataset, capfd: pytest.CaptureFixture[str]) -> None:
    shard = dataset.shard_path(dataset.meta.shards[1])
    shard.write_bytes(shard.read_bytes()[:-100])
    for line in ("inspect DATA", "inspect DATA --verify", "train DATA -o DATA/../run"):
        assert cosim.main(line.replace("DATA", str(dataset.path)).split()) == 2
        stderr = capfd.readouterr().err.splitlines()[-1]
        assert stderr.startswith(f"cosim: {shard}: ")


def test_a_shard_of_another_version_is_refused(dataset: Dataset, tmp_path: Path) -> None:
    path = dataset.shard_path(dataset.meta.shards[0])
    table = pq.read_table(path)
    episode = {**json.loads(table.schema.metadata[b"cosim.episode"]), "schema_version": 6, "new": 1}
    pq.write_table(table.replace_schema_metadata({b"cosim.episode": json.dumps(episode)}), path)
    with pytest.raises(InputError, match=r"road-1\.parquet: a shard of schema version 6, not 5"):
        read_shard(path)
    before = dataset.digest
    assert generate(STUDY, dataset.path, INLINE, source=ScriptedSource(tmp_path)).digest == before


@contextmanager
def unprivileged() -> Iterator[None]:
    """As a user whom permissions bind."""
    user = os.geteuid()
    if user == 0:
        os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(user)


@pytest.mark.skipif(os.name != "posix", reason="permissions and users are of POSIX")
def test_a_read_only_folder_is_bad_input(dataset: Dataset, tmp_path: Path) -> None:
    """A new dataset in it, one to go on with, and one whose shards alone are read-only."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(dataset.path, folder / "data")
        (folder / "road").mkdir()
        shutil.copy(tmp_path / "road.net.xml", folder / "road")
        for path in (folder / "data", folder / "data/shards", folder):
            path.chmod(0o555)
        (folder / "road").chmod(0o777)
        (folder / "road/road.net.xml").chmod(0o666)
        source = ScriptedSource(folder / "road")
        with unprivileged():
            with pytest.raises(InputError, match=r"new: cannot be written \(Permission denied\)"):
                generate(STUDY, folder / "new", INLINE, source=source)
            with pytest.raises(InputError, match=r"data: cannot be written \(Permission denied\)"):
                generate(STUDY, folder / "data", INLINE, source=source)
        assert Dataset.open(folder / "data").digest == dataset.digest
        for path in (folder, folder / "data", folder / "data/shards"):
            path.chmod(0o755)


def masts(first: tuple[float, float]) -> str:
    """Sites 80 m off both sides of a road along x, over a kilometre from the first on, which may stand elsewhere."""
    begin = 150 * (first[0] // 150) + 60
    places = [first, *((begin + 150 * (k // 2), 80 if k % 2 else -80) for k in range(1, 14))]
    return "".join(
        f'<poi id="s{k}" x="{x}" y="{y}" type="isac_site"><param key="height" value="15"/>'
        f'<param key="azimuth" value="{180 if y >= 0 else 0}"/></poi>'
        for k, (x, y) in enumerate(places)
    )


def again(folder: Path) -> Dataset:
    """Generate what `on_road` generates, with the scenario as it is now."""
    return generate(_road_study(folder / "r", 1), folder / "data", INLINE)


def _road_study(scenario: Path, seeds: int) -> DatasetStudy:
    return small_study(
        scenarios=[str(scenario)],
        seeds={"first": 1, "last": seeds},
        traffic={"run_in_s": 30.0, "duration_s": 40.0},
        maneuvers={"rest_s": 1.0},
    )


def on_road(
    folder: Path,
    cars: str,
    lanes: int,
    first: tuple[float, float] = (60, 80),
    engine: Engine = INLINE,
    seeds: int = 1,
) -> Dataset:
    """A dataset of 40 s of SUMO's traffic on a straight road."""
    scenario = straight_road(folder / "r", cars, masts(first), lanes=lanes)
    return generate(_road_study(scenario, seeds), folder / "data", engine)


def convoy(lane: int, position: float = 10.0) -> str:
    return "".join(vehicle(f"v{k}", depart=2.5 * k, lane=lane, position=position, speed=20.0) for k in range(12))


def test_one_lane_roads_have_no_events_across_lanes(tmp_path: Path) -> None:
    dataset = on_road(tmp_path, convoy(0), 1)
    dataset.verify()
    counts = dataset.meta.by_intention()
    assert dataset.meta.samples > 0
    assert counts["left_lane_change"] == counts["right_lane_change"] == counts["overtake"] == 0


def test_no_traffic_makes_an_empty_dataset_that_says_so(tmp_path: Path) -> None:
    dataset = on_road(tmp_path / "late", vehicle("late", depart=9999.0, lane=0), 1)
    dataset.verify()
    assert dataset.meta.samples == 0
    assert any(line.startswith("no sample was found") for line in faults(summary(dataset)))
    with pytest.raises(InputError, match="has no demand"):
        on_road(tmp_path / "none", "", 1)


def test_a_site_on_top_of_the_road_sees_what_it_sees(tmp_path: Path) -> None:
    dataset = on_road(tmp_path, convoy(1), 3, first=(90.0, -5.4))
    dataset.verify()
    assert dataset.meta.samples > 0
    assert max(read_episode(dataset.shard_path(dataset.meta.shards[0])).state_error_m) < 0.5


@pytest.mark.slow
def test_records_of_vehicles_that_leave_meanwhile_are_left_out_and_counted(tmp_path: Path) -> None:
    """The first of them reach the end of the road, at 3 km, while they are recorded."""
    dataset = on_road(tmp_path, convoy(0, position=1490.0), 1, first=(2160, 80), seeds=8)
    dataset.verify()
    left_out = dataset.meta.left_out()
    assert left_out.get("tv_outside_track", 0) + left_out.get("uv_outside_track", 0) > 0
    assert dataset.meta.samples > 0
    for name in ("tv_truth", "uv"):
        x = dataset.frame(["x0"])["x0"].to_numpy()[:, None] + dataset.arrays(name)[name][:, 0]
        assert 2800.0 < x.max() <= 3000.0


def test_what_sumo_says_of_a_lost_episode_is_shown_as_it_is(tmp_path: Path, one_worker: KeptWorkers) -> None:
    """From a worker process, where SUMO's own exceptions cannot leave: a car that wants to enter beyond the limit.

    The same scenario and seed would fail again, so there is no other try.
    """
    with pytest.raises(RunError) as caught:
        on_road(tmp_path, vehicle("racer", depart=1.0, lane=0, speed=90.0), 1, engine=one_worker)
    assert str(caught.value).startswith("all 1 episodes failed, the first with: r, seed 1: Departure speed for vehicle")
    (line,) = (tmp_path / "data/log.jsonl").read_text().splitlines()
    assert (json.loads(line)["outcome"], json.loads(line)["retries"]) == ("lost", 0)


def test_a_scenario_that_sumo_refuses_ends_the_command_from_a_worker_process(
    tmp_path: Path, one_worker: KeptWorkers
) -> None:
    """The error comes with libsumo's own in its context, which no process can send to another."""
    with pytest.raises(InputError, match=r"^SUMO refuses scenario r \(.*nowhere.*\): fix its files$"):
        on_road(tmp_path, vehicle("a").replace('route="all"', 'route="nowhere"'), 1, engine=one_worker)


@pytest.mark.parametrize("option", ['<begin value="1"/>', '<scale value="3"/>'])
def test_a_dataset_does_not_go_on_after_its_configuration_has_changed(tmp_path: Path, option: str) -> None:
    on_road(tmp_path, convoy(0), 1)
    for path in (tmp_path / "data/shards").iterdir():
        path.unlink()
    config = tmp_path / "r/r.sumocfg"
    text = config.read_text().replace("</configuration>", f"{option}</configuration>")
    config.write_text(text)
    with pytest.raises(InputError, match="the configuration of r has changed since it was begun"):
        again(tmp_path)


BACKWARDS = """
import time

began, real = time.monotonic(), time.time
# The wall clock, set back by an hour every other second.
time.time = lambda: real() - 3600.0 * int((time.monotonic() - began) / 2)
"""
COMMAND = """
import sys, time
from pathlib import Path

from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.labeling.generation.generate import generate
from tests.support.scripted import ScriptedSource, small_study

if __name__ == "__main__":
    before = time.time()
    study = small_study(seeds={"first": 1, "last": 6})
    generate(study, Path("data"), LocalEngine(2), source=ScriptedSource(Path.cwd(), pause_s=1.0))
    assert time.time() < before - 3000
"""


@pytest.mark.slow
def test_a_clock_that_goes_backwards_changes_nothing(tmp_path: Path) -> None:
    """In the command and the workers alike."""
    (tmp_path / "sitecustomize.py").write_text(BACKWARDS)
    (tmp_path / "command.py").write_text(COMMAND)
    root = Path(cosim.__file__).parent
    path = os.pathsep.join(map(str, (tmp_path, root, Path(__file__).parent)))
    began = time.monotonic()
    subprocess.run([sys.executable, "command.py"], cwd=tmp_path, env={**os.environ, "PYTHONPATH": path}, check=True)
    took_s = time.monotonic() - began
    study = small_study(seeds={"first": 1, "last": 6})
    undisturbed = generate(study, tmp_path / "other", INLINE, source=ScriptedSource(tmp_path))
    assert Dataset.open(tmp_path / "data").digest == undisturbed.digest
    log = [json.loads(line) for line in (tmp_path / "data/log.jsonl").read_text().splitlines()]
    assert len(log) == 6
    assert all(1.0 <= entry["seconds"] < took_s for entry in log)
