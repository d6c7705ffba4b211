"""Generation with scripted traffic: the same bytes however it went, nothing lost, nothing foreign touched."""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import os
import signal
import sys
import threading
from pathlib import Path

import numpy as np
import psutil
import pytest

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.files import claim
from isac_cosim.base.workers.engine import LocalEngine
from isac_cosim.base.workers.kept_workers import KeptWorkers
from isac_cosim.labeling.dataset.dataset import META_FILE, Dataset, read_meta, write_meta
from isac_cosim.labeling.dataset.shard import read_episode
from isac_cosim.labeling.dataset.summary import summary
from isac_cosim.labeling.generation.episode import ready
from isac_cosim.labeling.generation.generate import generate
from isac_cosim.labeling.generation.settings import DatasetStudy
from tests.support.scripted import InlineEngine, ScriptedSource, small_study
from tests.support.waiting import wait_until

INLINE = InlineEngine()
SEEDS = {"first": 1, "last": 4}
needs_posix = pytest.mark.skipif(os.name != "posix", reason="process groups and their signals are of POSIX")


def bytes_of(folder: Path) -> dict[str, bytes]:
    """Every file but the log, which is of the runs."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != "log.jsonl"]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> ScriptedSource:
    return ScriptedSource(tmp_path_factory.mktemp("road"))


@pytest.fixture(scope="module")
def study() -> DatasetStudy:
    return small_study(seeds=SEEDS)


@pytest.fixture(scope="module")
def undisturbed(source: ScriptedSource, study: DatasetStudy, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return generate(study, tmp_path_factory.mktemp("made") / "data", INLINE, source=source)


def test_a_dataset_is_made(undisturbed: Dataset) -> None:
    undisturbed.verify()
    assert undisturbed.meta.by_intention()["hard_brake"] == 4
    assert undisturbed.meta.by_intention()["left_lane_change"] == 4
    assert [shard.episode.seed for shard in undisturbed.meta.shards] == [1, 2, 3, 4]
    assert undisturbed.meta.shards[0].episode.collided == 1
    # What grows with the samples stands in the shards alone.
    assert undisturbed.meta.shards[0].episode.state_error_m == ()
    assert len(read_episode(undisturbed.shard_path(undisturbed.meta.shards[0])).state_error_m) == 2
    assert undisturbed.meta.study["record"]["before_onset_s"] == 2.6
    assert {"libsumo", "pyarrow", "numpy"} <= set(undisturbed.meta.versions)


def test_samples_are_of_the_scripted_motion(undisturbed: Dataset) -> None:
    """The braking follower keeps its lane, loses 7.2 m/s, and is sensed to centimetres."""
    frame, arrays = undisturbed.frame(), undisturbed.arrays("tv", "tv_truth", "uv")
    braking = (frame["intention"] == "hard_brake").to_numpy()
    truth = arrays["tv_truth"][braking]
    np.testing.assert_allclose(truth[:, 1], 1.6, atol=1e-5)
    np.testing.assert_allclose(truth[:, 2, 0] - truth[:, 2, -1], 7.2, atol=0.05)
    assert set(frame.loc[braking, "tv_id"]) == {"follow0"}
    assert set(frame.loc[braking, "uv_id"]) == {"lead0"}
    # The leader drives 40 m ahead of where the follower was until it braked.
    np.testing.assert_allclose(arrays["uv"][braking][:, 0, 0] - truth[:, 0, 0], 40, atol=0.3)
    error = np.hypot(*np.moveaxis(arrays["tv"] - arrays["tv_truth"], 1, 0)[:2])
    assert np.median(error) < 0.1
    since_start = (frame["t_onset"] - frame["t_start"]).to_numpy()
    assert (np.abs(since_start - 2.6) <= 0.2 + 1e-3).all()


def test_a_summary_takes_a_shard_of_states_at_a_time(undisturbed: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = undisturbed.arrays("tv_truth")["tv_truth"]
    parts = [part["tv_truth"] for part in undisturbed.arrays_by_shard("tv_truth")]
    assert [len(part) for part in parts] == [2, 2, 2, 2]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    monkeypatch.delattr(Dataset, "arrays")
    least = summary(undisturbed)["distributions"]["hard_brake"]["peak_along_mps2"]
    braking = whole[(undisturbed.frame()["intention"] == "hard_brake").to_numpy()]
    # On a straight road along x, where nothing but the braking accelerates.
    np.testing.assert_allclose(least[2], np.median(braking[:, 4].min(axis=1)), atol=1e-3)


def test_more_jobs_make_the_same_bytes(
    undisturbed: Dataset, source: ScriptedSource, study: DatasetStudy, tmp_path: Path, two_workers: KeptWorkers
) -> None:
    generate(study, tmp_path / "data", two_workers, source=source)
    assert bytes_of(tmp_path / "data") == bytes_of(undisturbed.path)


def test_what_stands_is_kept_and_what_is_missing_is_made(
    undisturbed: Dataset, source: ScriptedSource, study: DatasetStudy, tmp_path: Path
) -> None:
    """As after an interruption: one shard gone, one cut short, one left half-written under its temporary name,
    and one under another's name."""
    folder = tmp_path / "data"
    generate(study, folder, INLINE, source=source)
    finished = read_meta(folder)
    assert finished is not None
    write_meta(folder, finished.model_copy(update={"complete": False}))
    (folder / "shards.parquet").unlink()
    (folder / "shards/road-2.parquet").unlink()
    cut = folder / "shards/road-3.parquet"
    cut.write_bytes(cut.read_bytes()[:1000])
    (folder / "shards/.road-4.parquet.77").write_bytes(b"PAR1")
    (folder / "shards/road-9.parquet").write_bytes((folder / "shards/road-1.parquet").read_bytes())
    kept = (folder / "shards/road-1.parquet").stat().st_ino
    generate(study, folder, INLINE, source=source)
    assert bytes_of(folder) == bytes_of(undisturbed.path)
    assert (folder / "shards/road-1.parquet").stat().st_ino == kept


def test_a_finished_dataset_is_left_as_it_is(undisturbed: Dataset, source: ScriptedSource, study: DatasetStudy) -> None:
    before = {path: path.stat().st_mtime_ns for path in undisturbed.path.glob("shards/*")}
    seen: list[tuple[int, int]] = []
    generate(study, undisturbed.path, INLINE, lambda done, total: seen.append((done, total)), source)
    assert {path: path.stat().st_mtime_ns for path in undisturbed.path.glob("shards/*")} == before
    assert seen == []


def run_in_a_group(study: DatasetStudy, folder: Path, source: ScriptedSource) -> None:
    """Generate at the head of a process group, as a command that a terminal started."""
    os.setsid()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
    with contextlib.suppress(KeyboardInterrupt):
        generate(study, folder, LocalEngine(2), source=source)
    sys.exit(130)


@needs_posix
@pytest.mark.parametrize("name", ["SIGINT", pytest.param("SIGKILL", marks=pytest.mark.slow)])
def test_an_interrupted_command_is_resumed(
    undisturbed: Dataset, source: ScriptedSource, study: DatasetStudy, tmp_path: Path, name: str
) -> None:
    """With two episodes finished and two under way, which never end by themselves."""
    folder, number = tmp_path / "data", signal.Signals[name]
    (tmp_path / "gate").mkdir()
    held = ScriptedSource(source.folder, held=(3, 4), gate=tmp_path / "gate")
    process = multiprocessing.get_context("spawn").Process(target=run_in_a_group, args=(study, folder, held))
    process.start()
    wait_until(lambda: held.begun() == {3, 4}, process.is_alive)
    assert process.pid is not None
    os.killpg(process.pid, number)
    process.join()
    assert process.exitcode == (130 if number == signal.SIGINT else -number)
    assert sorted(path.name for path in folder.glob("shards/road-*")) == ["road-1.parquet", "road-2.parquet"]
    with pytest.raises(InputError, match="not finished"):
        Dataset.open(folder)
    generate(study, folder, INLINE, source=source)
    assert bytes_of(folder) == bytes_of(undisturbed.path)


def test_a_worker_that_dies_is_replaced(
    undisturbed: Dataset, source: ScriptedSource, tmp_path: Path, two_workers: KeptWorkers
) -> None:
    (tmp_path / "died").mkdir()
    frail = ScriptedSource(source.folder, frail=tmp_path / "died")
    dataset = generate(small_study(seeds={"first": 1, "last": 2}), tmp_path / "data", two_workers, source=frail)
    assert sorted(path.name for path in (tmp_path / "died").iterdir()) == ["1", "2"]
    assert dataset.meta.lost == ()
    np.testing.assert_array_equal(dataset.arrays("tv")["tv"], undisturbed.arrays("tv")["tv"][:4])


def test_an_episode_that_keeps_failing_is_reported_and_left_out(
    undisturbed: Dataset, source: ScriptedSource, study: DatasetStudy, tmp_path: Path, two_workers: KeptWorkers
) -> None:
    failing = ScriptedSource(source.folder, broken=(1,), deadly=(3,))
    dataset = generate(study, tmp_path / "data", two_workers, source=failing)
    assert [shard.episode.seed for shard in dataset.meta.shards] == [2, 4]
    reasons = {lost.seed: lost.reason for lost in dataset.meta.lost}
    assert reasons[1] == "RuntimeError: the simulation broke"
    assert reasons[3] == "the worker process died (exit code 1)"
    # Mended, the same command makes what is missing.
    assert generate(study, tmp_path / "data", INLINE, source=source).digest == undisturbed.digest


def test_when_every_episode_fails_nothing_is_called_finished(source: ScriptedSource, tmp_path: Path) -> None:
    failing = ScriptedSource(source.folder, broken=(1, 2))
    with pytest.raises(RuntimeError, match=r"all 2 episodes failed.*broke"):
        generate(small_study(seeds={"first": 1, "last": 2}), tmp_path / "data", INLINE, source=failing)
    with pytest.raises(InputError, match="not finished"):
        Dataset.open(tmp_path / "data")


def test_a_fault_of_the_scenario_ends_the_command(source: ScriptedSource, study: DatasetStudy, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no road for seed 2"):
        generate(study, tmp_path / "data", INLINE, source=ScriptedSource(source.folder, wrong=(2,)))


def test_the_first_episode_of_a_process_leaves_modules_out_of_garbage_collection(
    source: ScriptedSource, tmp_path: Path
) -> None:
    ready.cache_clear()
    gc.unfreeze()
    generate(small_study(seeds={"first": 1, "last": 1}), tmp_path / "one", INLINE, source=source)
    spared = gc.get_freeze_count()
    generate(small_study(seeds={"first": 1, "last": 1}), tmp_path / "another", INLINE, source=source)
    assert 10_000 < gc.get_freeze_count() <= spared
    gc.unfreeze()


def test_windows_take_the_shortest_run_of_seeds(source: ScriptedSource, tmp_path: Path) -> None:
    """Two samples an episode, none of seed 2: five are reached with seed 4, and surplus episodes leave nothing."""
    study = small_study(seeds={"first": 1, "last": 2**31 - 1}, selection={"windows": 5})
    sparse = ScriptedSource(source.folder, empty=(2,))
    one = generate(study, tmp_path / "one", INLINE, source=sparse)
    assert [shard.samples for shard in one.meta.shards] == [2, 0, 2, 2]
    two = generate(study, tmp_path / "two", LocalEngine(2), source=sparse)
    assert bytes_of(two.path) == bytes_of(one.path)


def test_seeds_that_end_too_early_name_the_short_classes(source: ScriptedSource, tmp_path: Path) -> None:
    study = small_study(seeds={"first": 1, "last": 2}, selection={"windows": 3, "min_per_class": 1})
    dataset = generate(study, tmp_path / "data", INLINE, source=source)
    assert dataset.meta.samples == 4
    assert set(dataset.meta.short) == {"right_lane_change", "overtake", "hard_accel", "evasive_swerve"}


def test_traffic_without_events_is_given_up(source: ScriptedSource, tmp_path: Path) -> None:
    study = small_study(seeds={"first": 1, "last": 1000}, selection={"windows": 3, "patience": 3})
    dataset = generate(study, tmp_path / "data", INLINE, source=ScriptedSource(source.folder, empty=tuple(range(1001))))
    assert (dataset.meta.samples, len(dataset.meta.shards)) == (0, 3)
    assert dataset.arrays("tv")["tv"].shape == (0, 6, 200)


def test_another_study_is_refused_with_the_difference(
    undisturbed: Dataset, source: ScriptedSource, tmp_path: Path
) -> None:
    before = bytes_of(undisturbed.path)
    other = small_study(seeds=SEEDS, sensing={"channel": {"snr_range_db": [5, 10]}})
    with pytest.raises(InputError, match=r"sensing\.channel\.snr_range_db is \[0\.0, 10\.0\] there and \[5\.0"):
        generate(other, undisturbed.path, INLINE, source=source)
    assert bytes_of(undisturbed.path) == before


def test_another_network_of_the_same_name_is_refused(
    undisturbed: Dataset, source: ScriptedSource, study: DatasetStudy
) -> None:
    class Changed(ScriptedSource):
        def load(self, where: str):  # type: ignore[no-untyped-def]
            scenario = super().load(where)
            scenario.network.write_text("<net version='2'/>")
            return scenario

    with pytest.raises(InputError, match=r"road\.net\.xml of road has changed since it was begun"):
        generate(study, undisturbed.path, INLINE, source=Changed(source.folder))


def test_a_foreign_folder_is_refused_and_left_untouched(
    source: ScriptedSource, study: DatasetStudy, tmp_path: Path
) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match="is not empty and holds no dataset"):
        generate(study, tmp_path, INLINE, source=source)
    assert bytes_of(tmp_path) == {"thesis.tex": b"years of work"}
    with pytest.raises(InputError, match="is a file"):
        generate(study, tmp_path / "thesis.tex", INLINE, source=source)


def test_two_commands_on_one_folder_do_not_meet(source: ScriptedSource, study: DatasetStudy, tmp_path: Path) -> None:
    with (
        claim(tmp_path / "data", META_FILE, "dataset"),
        pytest.raises(InputError, match="another command is writing it"),
    ):
        generate(study, tmp_path / "data", INLINE, source=source)


def test_two_scenarios_of_one_name_are_refused(source: ScriptedSource, tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name / "road").mkdir(parents=True)
    study = small_study(scenarios=[str(tmp_path / "a/road"), str(tmp_path / "b/road")])
    with pytest.raises(InputError, match="two scenarios are called road"):
        generate(study, tmp_path / "data", INLINE, source=source)


def test_a_scenario_named_twice_is_refused(source: ScriptedSource, tmp_path: Path) -> None:
    (tmp_path / "road").mkdir()
    study = small_study(scenarios=[str(tmp_path / "road"), f"{tmp_path}/../{tmp_path.name}/road"])
    with pytest.raises(InputError, match="road is named twice"):
        generate(study, tmp_path / "data", INLINE, source=source)
    assert not (tmp_path / "data").exists()


def workers() -> list[psutil.Process]:
    """This process's own worker processes."""
    running = []
    for child in psutil.Process().children():
        with contextlib.suppress(psutil.Error):
            if "spawn_main" in " ".join(child.cmdline()):
                running.append(child)
    return running


def test_a_worker_that_dies_while_it_starts_is_replaced() -> None:
    """And nothing of the first attempt is left running."""
    others = workers()

    def new_workers() -> list[psutil.Process]:
        return [worker for worker in workers() if worker not in others]

    def kill_the_first() -> None:
        wait_until(new_workers)[0].kill()

    killer = threading.Thread(target=kill_the_first)
    killer.start()
    with contextlib.closing(LocalEngine(2).run(str, [1, 2])) as outcomes:
        assert sorted(str(outcome.result) for outcome in outcomes) == ["1", "2"]
    killer.join()
    assert new_workers() == []


def test_workers_that_never_start_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sitecustomize.py").write_text(
        "import os, sys\nif 'spawn_main' in ' '.join(sys.orig_argv): os._exit(7)\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with (
        pytest.raises(RunError, match=r"the worker processes do not start \((exit code 7|BrokenPipeError.*)\)"),
        contextlib.closing(LocalEngine(1).run(str, [1])) as run,
    ):
        next(run)
