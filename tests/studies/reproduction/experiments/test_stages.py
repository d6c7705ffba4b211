"""Stages: chosen by name, run once, resumed, and refused in the folder of another reproduction."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import SILENT
from isac_cosim.studies.reproduction.experiments.stages import (
    Capacity,
    Stage,
    chosen_stages,
    cost_of,
    fastest,
    identity_of,
    result_of,
    run_stages,
)

ALONE = Capacity(1, 1)
IDENTITY = identity_of("asi-bip", "tiny", {"seed": 1})


def stage(name: str, runs: list[str], fails: bool = False, group: str = "") -> Stage:
    def run() -> dict[str, Any]:
        runs.append(name)
        if fails:
            raise RuntimeError("killed")
        return {"name": name}

    return Stage(name, group or name, f"what {name} answers", 60.0, 3, run)


def test_a_killed_reproduction_goes_on_where_it_was(tmp_path: Path) -> None:
    out, runs = tmp_path / "out", list[str]()
    with pytest.raises(RuntimeError, match="killed"):
        run_stages(IDENTITY, [stage("a", runs), stage("b", runs, fails=True)], out, ALONE, SILENT)
    assert (result_of(out, "a"), result_of(out, "b")) == ({"name": "a"}, None)
    run_stages(IDENTITY, [stage("a", runs), stage("b", runs)], out, ALONE, SILENT)
    assert runs == ["a", "b", "b"]
    assert result_of(out, "b") == {"name": "b"}


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
    shared = Stage("a", "a", "what a answers", 60.0, parts, dict)
    assert shared.seconds(Capacity(workers, cores)) == pytest.approx(seconds)


def test_the_fastest_workers_keep_all_cores_busy() -> None:
    three = [stage("a", [])]
    assert [fastest(three, cores) for cores in (1, 2, 3, 4)] == [
        Capacity(1, 1), Capacity(3, 2), Capacity(3, 3), Capacity(4, 4)
    ]  # fmt: skip


def test_a_damaged_file_is_reported(tmp_path: Path) -> None:
    run_stages(IDENTITY, [stage("a", [])], tmp_path / "out", ALONE, SILENT)
    (tmp_path / "out" / "stages" / "a.json").write_text("{")
    with pytest.raises(InputError, match=r"a\.json: is damaged"):
        result_of(tmp_path / "out", "a")
