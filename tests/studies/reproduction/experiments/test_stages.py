"""Stages: chosen by name, run once, resumed, and refused in the folder of another reproduction."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import SILENT
from isac_cosim.labeling.dataset.dataset import write_meta
from isac_cosim.models.runs.run import Run, write_card
from isac_cosim.studies.reproduction.experiments.stage_results import StageResult
from isac_cosim.studies.reproduction.experiments.stages import (
    MARK,
    Capacity,
    Stage,
    chosen_stages,
    cost_of,
    fastest,
    identity_of,
    result_of,
    run_stages,
)
from tests.support.forged import resealed
from tests.support.recorded_feedback import RecordedFeedback
from tests.support.small_dataset import make

ALONE = Capacity(1, 1)
IDENTITY = identity_of("asi-bip", "tiny", {"seed": 1})


class Named(StageResult):
    """What the stages of these tests leave."""

    name: str


def stage(name: str, runs: list[str], fails: bool = False, group: str = "") -> Stage:
    def run() -> Named:
        runs.append(name)
        if fails:
            raise RuntimeError("killed")
        return Named(name=name)

    return Stage(name, group or name, f"what {name} answers", 60.0, 3, run, Named)


def name_in(folder: Path, stage: str) -> str | None:
    result = result_of(folder, stage, Named)
    return None if result is None else result.name


def test_a_killed_reproduction_goes_on_where_it_was(tmp_path: Path) -> None:
    out, runs = tmp_path / "out", list[str]()
    with pytest.raises(RuntimeError, match="killed"):
        run_stages(IDENTITY, [stage("a", runs), stage("b", runs, fails=True)], out, ALONE, SILENT)
    assert (name_in(out, "a"), name_in(out, "b")) == ("a", None)
    run_stages(IDENTITY, [stage("a", runs), stage("b", runs)], out, ALONE, SILENT)
    assert runs == ["a", "b", "b"]
    assert name_in(out, "b") == "b"


def test_a_folder_holds_one_reproduction(tmp_path: Path) -> None:
    run_stages(IDENTITY, [stage("a", [])], tmp_path / "out", ALONE, SILENT)
    other = IDENTITY.model_copy(update={"settings": {"seed": 2}})
    with pytest.raises(InputError, match="another paper, size, setting or version"):
        run_stages(other, [stage("a", [])], tmp_path / "out", ALONE, SILENT)


def test_stages_are_chosen_by_name_or_group() -> None:
    stages = [stage("a", [], group="table"), stage("b", [], group="table"), stage("c", [])]
    assert [chosen.name for chosen in chosen_stages(stages, ["table"])] == ["a", "b"]
    assert [chosen.name for chosen in chosen_stages(stages, ["c", "b"])] == ["b", "c"]
    assert chosen_stages(stages, None) == stages
    assert chosen_stages(stages, ["page"]) == []
    with pytest.raises(InputError, match="--stages d: no such stage; choose among a, table, b, c, claims, page"):
        chosen_stages(stages, ["d"])


def test_the_cost_is_that_of_what_is_not_finished(tmp_path: Path) -> None:
    stages = [stage("a", []), stage("b", [])]
    run_stages(IDENTITY, stages[:1], tmp_path / "out", ALONE, SILENT)
    cost = cost_of(stages, tmp_path / "out", Capacity(2, 2))
    # Three parts of 20 s on two workers take two rounds.
    assert cost.stages == {"b": 40.0}
    assert (cost.cpu_s, cost.seconds) == (60.0, 40.0)


def test_what_stages_share_is_counted_once_and_again_where_it_was_lost(tmp_path: Path) -> None:
    out = tmp_path / "out"
    data, predictor = out / "work" / "data", out / "work" / "predictor"
    first = replace(stage("a", []), makes={data: 100.0, predictor: 30.0})
    second = replace(stage("b", []), makes={data: 100.0})
    assert cost_of([first, second], out, ALONE).stages == {"a": 190.0, "b": 60.0}
    assert cost_of([second], out, ALONE).stages == {"b": 160.0}
    make(data, (3,))
    assert cost_of([first, second], out, ALONE).stages == {"a": 90.0, "b": 60.0}
    shutil.rmtree(out)
    run_stages(IDENTITY, [first], out, ALONE, SILENT)
    assert cost_of([first, second], out, ALONE).stages == {"b": 160.0}


def test_what_was_interrupted_is_counted(trees_run: Run, tmp_path: Path) -> None:
    out, data, run, scores = (tmp_path / name for name in ("out", "data", "run", "scores.json"))
    shutil.copytree(trees_run.path, run)
    write_meta(data, make(data, (3,)).meta.model_copy(update={"complete": False}))
    needs = replace(stage("a", []), makes={data: 100.0, run: 30.0, scores: 7.0})
    assert cost_of([needs], out, ALONE).cpu_s == 60.0 + 100.0 + 7.0
    write_card(run, trees_run.card.model_copy(update={"complete": False}))
    assert cost_of([needs], out, ALONE).cpu_s == 60.0 + 100.0 + 30.0 + 7.0
    scores.write_text("{}")
    assert cost_of([needs], out, ALONE).cpu_s == 60.0 + 100.0 + 30.0


@pytest.mark.parametrize(
    ("parts", "workers", "cores", "seconds"),
    [
        (3, 2, 2, 40.0),
        (3, 3, 2, 30.0),
        (3, 3, 3, 20.0),
        (3, 4, 4, 20.0),
        (3, 1, 1, 60.0),
        (4, 3, 2, 37.5),
        (1, 3, 2, 60.0),
    ],
)
def test_parts_run_in_rounds_and_share_the_cores(parts: int, workers: int, cores: int, seconds: float) -> None:
    shared = Stage("a", "a", "what a answers", 60.0, parts, lambda: Named(name="a"), Named)
    assert shared.seconds(Capacity(workers, cores)) == pytest.approx(seconds)


def test_the_fastest_workers_keep_all_cores_busy() -> None:
    three = [stage("a", [])]
    assert [fastest(three, cores) for cores in (1, 2, 3, 4)] == [
        Capacity(1, 1), Capacity(3, 2), Capacity(3, 3), Capacity(4, 4)
    ]  # fmt: skip


def changed(path: Path, **values: Any) -> None:
    """Change a file of a stage, and make its digest right again."""
    path.write_text(json.dumps(resealed(json.loads(path.read_text()) | values)))


def other_value(path: Path) -> None:
    path.write_text(path.read_text().replace('"name": "a"', '"name": "c"'))


@pytest.mark.parametrize(
    ("damage", "fault"),
    [
        (lambda path: path.write_text("{"), "the file is damaged"),
        (lambda path: path.write_text("[" * 100_000), "the file is damaged"),
        (lambda path: path.write_bytes(b"\xff"), "the file is damaged"),
        (lambda path: (path.unlink(), path.mkdir()), "cannot be read"),
        (other_value, "sha256: differs from the content"),
        (lambda path: changed(path, name=7), "name: must be"),
        (lambda path: path.write_text('{"schema_version": 2, "name": "a"}'), "sha256: is missing"),
        (lambda path: shutil.copy(path.with_name("b.json"), path), "stage: is 'b', not 'a'"),
        (lambda path: changed(path, reproduction="0" * 64), "another reproduction's"),
    ],
)
def test_a_damaged_file_is_reported_before_any_stage_runs(
    tmp_path: Path, damage: Callable[[Path], object], fault: str
) -> None:
    out, runs = tmp_path / "out", list[str]()
    run_stages(IDENTITY, [stage("a", []), stage("b", [])], out, ALONE, SILENT)
    damage(out / "stages" / "a.json")
    with pytest.raises(InputError, match=rf"a\.json: .*{fault}.*; delete the file, and run the same command again"):
        run_stages(IDENTITY, [stage("c", runs)], out, ALONE, SILENT, [stage("a", runs)])
    assert runs == []


def test_a_file_of_the_version_without_digests_is_read(tmp_path: Path) -> None:
    run_stages(IDENTITY, [stage("a", [])], tmp_path / "out", ALONE, SILENT)
    (tmp_path / "out" / "stages" / "a.json").write_text('{"name": "former"}')
    assert name_in(tmp_path / "out", "a") == "former"


def test_a_damaged_identity_is_reported(tmp_path: Path) -> None:
    run_stages(IDENTITY, [stage("a", [])], tmp_path / "out", ALONE, SILENT)
    (tmp_path / "out" / MARK).write_text("[" * 100_000)
    with pytest.raises(InputError, match=r"reproduction\.json: .*the file is damaged"):
        run_stages(IDENTITY, [stage("a", [])], tmp_path / "out", ALONE, SILENT)


def test_the_cost_is_not_told_where_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").touch()
    feedback = RecordedFeedback()
    with pytest.raises(InputError, match="holds no reproduction"):
        run_stages(IDENTITY, [stage("a", [])], tmp_path, ALONE, feedback)
    assert feedback.messages == []
