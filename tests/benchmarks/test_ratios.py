"""The table of all benchmarks: every ratio that a benchmark declares is in its result, and in the table."""

from __future__ import annotations

import importlib
import json

import pytest

import cosim
from isac_cosim import benchmarks
from isac_cosim.benchmarks.ratios import Ratio, Row, as_markdown, machine

BENCH_MODULES = {name: importlib.import_module(module) for name, module in benchmarks.BENCHES.items()}


def made_up(ratios: tuple[Ratio, ...]) -> dict[str, object]:
    """A result in which the ratios are 1.5, 2.5, ..."""
    result: dict[str, object] = {}
    for k, ratio in enumerate(ratios):
        content = result
        for key in ratio.path[:-1]:
            content = content.setdefault(key, {})  # type: ignore[assignment]
        content[ratio.path[-1]] = k + 1.5
    return result


def test_all_benchmarks_give_one_table(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    for module in BENCH_MODULES.values():
        monkeypatch.setattr(module, "run", lambda module=module: made_up(module.RATIOS))
    assert cosim.main(["bench", "--all", "--json"]) == 0
    captured = capfd.readouterr()
    result = json.loads(captured.out)
    assert list(result["results"]) == list(benchmarks.BENCHES)
    expected = [(name, k + 1.5) for name, module in BENCH_MODULES.items() for k in range(len(module.RATIOS))]
    assert [(row["bench"], row["ratio"]) for row in result["table"]] == expected
    assert result["machine"]["cores"] >= 1
    assert as_markdown([Row(**row) for row in result["table"]], result["machine"]) in captured.err


@pytest.mark.parametrize("name", BENCH_MODULES)
def test_a_ratio_names_both_sides_and_its_limit(name: str) -> None:
    for ratio in BENCH_MODULES[name].RATIOS:
        assert ratio.measures
        assert ratio.bound_by


def test_the_machine_is_named() -> None:
    assert machine()["processor"]
    assert "numpy" in machine()["versions"]


@pytest.mark.parametrize("words", ["bench", "bench echo --all"])
def test_one_benchmark_or_all_of_them(words: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert cosim.main(words.split()) == 2
    assert (
        "either the name of a benchmark (echo, traffic, generate, train, infer, scene, live) or --all"
        in capfd.readouterr().err
    )
