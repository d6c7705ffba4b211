"""What the machine lacks, and what SUMO dies of, in worker processes: the right line, and nothing is lost.

A command that ends for want of something leaves episodes missing, not lost, and the same command makes them.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

import cosim
from isac_cosim.base.errors import InputError, OutputError, RunError, ShortageError
from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.simulated import SumoSource
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.generation.generate import generate
from tests.support.roads import straight_road, vehicle
from tests.support.scripted import InlineEngine, ScriptedSource, small_study

resource = pytest.importorskip("resource", reason="limits of processes are of POSIX")

STUDY = small_study(seeds={"first": 1, "last": 3})
HARMED = 2
"""The seed whose episode something is lacking for."""


def no_memory() -> None:
    raise MemoryError


def no_memory_in_a_library() -> None:
    os.write(2, b"terminate called after throwing an instance of 'std::bad_alloc'\n")
    os.abort()


def out_of_memory_killer() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def too_many_files() -> None:
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (64, hard))
    files = []
    while True:
        files.append(open(os.devnull))  # noqa: SIM115 - until there are too many


def full_disk() -> None:
    with open("/dev/full", "w") as file:
        file.write("x")


def segmentation_fault() -> None:
    os.write(2, b"SUMO's last words\n")
    os.kill(os.getpid(), signal.SIGSEGV)


HARMS = {
    harm.__name__: harm
    for harm in (no_memory, no_memory_in_a_library, out_of_memory_killer, too_many_files, full_disk, segmentation_fault)
}


@dataclass(frozen=True)
class HarmedSource(ScriptedSource):
    """A source that does something to its process before an episode."""

    harm: str = ""
    harmed: tuple[int, ...] = (HARMED,)

    def record(self, scenario: Scenario, seed: int) -> Recording:
        if seed in self.harmed:
            HARMS[self.harm]()
        return super().record(scenario, seed)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("undisturbed")
    return generate(STUDY, folder / "data", InlineEngine(), source=ScriptedSource(folder))


@pytest.mark.parametrize(
    ("harm", "kind", "line"),
    [
        pytest.param("no_memory", ShortageError, "no memory is left; give fewer --jobs", marks=pytest.mark.slow),
        pytest.param(
            "no_memory_in_a_library", ShortageError, r"no memory is left \(.*bad_alloc.*\)", marks=pytest.mark.slow
        ),
        pytest.param(
            "out_of_memory_killer",
            ShortageError,
            r"killed in each of 3 tries \(signal 9, Killed\)",
            marks=pytest.mark.slow,
        ),
        pytest.param("too_many_files", ShortageError, r"too many files are open .*ulimit -n", marks=pytest.mark.slow),
        ("full_disk", OutputError, r"the folder for temporary files cannot be written \(.*No space left on device\)"),
    ],
)
def test_what_is_lacking_ends_the_command_and_leaves_the_episode_missing(
    harm: str, kind: type[Exception], line: str, undisturbed: Dataset, tmp_path: Path
) -> None:
    with pytest.raises(kind, match=line) as caught:
        generate(STUDY, tmp_path / "data", LocalEngine(1), source=HarmedSource(tmp_path, harm=harm))
    assert "\n" not in str(caught.value)
    data = tmp_path / "data"
    assert [path.name for path in (data / "shards").iterdir()] == ["road-1.parquet"]
    with pytest.raises(InputError, match="not finished"):
        Dataset.open(data)
    dataset = generate(STUDY, data, InlineEngine(), source=ScriptedSource(tmp_path))
    assert dataset.meta.lost == ()
    assert dataset.digest == undisturbed.digest


@dataclass(frozen=True)
class SmallDisk(SumoSource):
    """SUMO's traffic, with files that cannot grow in one episode, as on a full disk."""

    largest_bytes: int = 0

    def record(self, scenario: Scenario, seed: int) -> Recording:
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        try:
            if seed == HARMED:
                resource.setrlimit(resource.RLIMIT_FSIZE, (self.largest_bytes, before[1]))
            return super().record(scenario, seed)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.slow
@pytest.mark.parametrize("sample_s", [0.01, 0.1])
def test_a_simulation_without_room_names_the_folder_for_temporary_files(tmp_path: Path, sample_s: float) -> None:
    """Its states are written by SUMO, which does not say that it cannot, or by the tool itself."""
    cars = "".join(vehicle(f"v{k}", depart=2.5 * k, lane=k % 3, speed=20.0) for k in range(12))
    traffic = {"run_in_s": 20.0, "duration_s": 20.0, "sample_s": sample_s}
    scenario = straight_road(tmp_path / "road", cars)
    (scenario / "r.sumocfg").rename(scenario / "road.sumocfg")
    study = small_study(
        scenarios=[str(scenario)], seeds={"first": 1, "last": 3}, traffic=traffic, maneuvers={"rest_s": 1.0}
    )
    source = SumoSource(**study.source_settings())
    with pytest.raises(OutputError, match="the folder for temporary files cannot be written"):
        generate(study, tmp_path / "data", LocalEngine(1), source=SmallDisk(source.traffic, source.maneuvers, 50_000))
    assert [path.name for path in (tmp_path / "data/shards").iterdir()] == ["road-1.parquet"]
    dataset = generate(study, tmp_path / "data", LocalEngine(1), source=source)
    assert dataset.digest == generate(study, tmp_path / "other", LocalEngine(1), source=source).digest


@pytest.mark.slow
def test_an_episode_in_which_the_process_crashes_is_lost_with_what_was_printed(tmp_path: Path) -> None:
    """Twice more it is tried; the others stand."""
    dataset = generate(
        STUDY, tmp_path / "data", LocalEngine(1), source=HarmedSource(tmp_path, harm="segmentation_fault")
    )
    (lost,) = dataset.meta.lost
    assert (lost.seed, lost.reason) == (
        HARMED,
        "the worker process died (signal 11, Segmentation fault) and said: SUMO's last words",
    )
    entries = [json.loads(line) for line in (dataset.path / "log.jsonl").read_text().splitlines()]
    assert {entry["seed"]: entry["printed"] for entry in entries} == {1: "", 2: "SUMO's last words", 3: ""}
    assert {entry["seed"]: entry["retries"] for entry in entries} == {1: 0, 2: 2, 3: 0}


@pytest.mark.slow
def test_a_scenario_in_which_the_process_always_crashes_is_bad_input(tmp_path: Path) -> None:
    source = HarmedSource(tmp_path, harm="segmentation_fault", harmed=(1, 2, 3))
    with pytest.raises(InputError, match=r"road, seed 1: the worker process died \(signal 11.* and said: SUMO's last"):
        generate(STUDY, tmp_path / "data", LocalEngine(2), source=source)


CRASHING = """
import ctypes
class TraCIException(Exception): pass
class FatalTraCIError(Exception): pass
def start(words): ctypes.string_at(0)
def close(): pass
class simulation:
    isLoaded = staticmethod(lambda: False)
def getVersion(): return (22, "SUMO 1.28.0")
"""


@pytest.mark.slow
def test_a_file_that_makes_sumo_crash_is_named_in_one_line(tmp_path: Path) -> None:
    """As a file of speeds that was cut off made it, before files were read ahead of SUMO: a segmentation fault."""
    scenario = straight_road(tmp_path / "road", vehicle("a"))
    # A library that crashes takes the place of SUMO's own.
    (tmp_path / "libsumo").mkdir()
    (tmp_path / "libsumo" / "__init__.py").write_text(CRASHING)
    command = [sys.executable, "-m", "cosim", "generate", str(scenario), "-o", str(tmp_path / "data")]
    root = Path(cosim.__file__).parent
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(tmp_path), str(root)))}
    done = subprocess.run(
        [*command, "--seeds", "1:2", "--jobs", "1", "--quiet"],
        cwd=root,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith("cosim: SUMO crashed while it read scenario road, seed 1 (signal 11, Segmentation fault)")
    assert str(scenario) in line


@pytest.mark.slow
def test_a_failure_that_is_no_shortage_costs_one_episode(tmp_path: Path) -> None:
    dataset = generate(STUDY, tmp_path / "data", LocalEngine(1), source=ScriptedSource(tmp_path, broken=(HARMED,)))
    assert [lost.seed for lost in dataset.meta.lost] == [HARMED]
    with pytest.raises(RunError, match="all 3 episodes failed"):
        generate(STUDY, tmp_path / "none", LocalEngine(1), source=ScriptedSource(tmp_path, broken=(1, 2, 3)))
