"""The price of knowing: what is compared, and what the symbols would carry."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.benchmarks.findings.sensing import scene_price
from isac_cosim.benchmarks.findings.sensing.scene_price import (
    CASES,
    FEWER,
    SPENT,
    answered,
    carried_mbps,
    main,
    of_a_vehicle_m,
    rows,
)
from isac_cosim.isacsim.scene.scores import SceneScores


def scores(gospa_m: float, vehicles: int = 50) -> SceneScores:
    """Scores of 10 instants with so many vehicles."""
    return SceneScores(
        instants=10, vehicle_fixes=10 * vehicles, rms_m=0.2, missed=0.01, false=0.02, switches_per_km=0.1, idf1=0.98,
        gospa_m=gospa_m,
    )  # fmt: skip


def test_all_symbols_carry_the_peak_rate_of_the_standard() -> None:
    """273 resource blocks at 30 kHz carry 2.34 Gbit/s on four layers in a downlink of FR1."""
    assert 4 * carried_mbps(1.0) == pytest.approx(2337, rel=1e-3)
    assert CASES["bodies"].share == pytest.approx(1000 / 28000)


def test_gospa_of_a_vehicle_does_not_grow_with_their_number() -> None:
    assert of_a_vehicle_m(scores(2.0, 100)) == pytest.approx(of_a_vehicle_m(scores(1.0, 25)))
    assert of_a_vehicle_m(scores(2.0, 4)) == pytest.approx(1.0)


def test_differences_are_paired_by_seed() -> None:
    base, less = [scores(5.0, 25), scores(10.0, 25)], [scores(4.0, 25), scores(8.0, 25)]
    first, second = rows({"bodies": base, "bodies, truth": less})
    assert first[-1] == ""
    assert second[-2:] == ["1.200", "0.300 (0.200 to 0.400)"]


def answers() -> dict[str, object]:
    """Of 10 windows just after onset of either seed, 8 are right by the truth, 7 and 5 with 25 instants a second."""
    right = {"truth": (8, 8), "bodies, tracks": (7, 5), **dict.fromkeys(FEWER, (4, 4))}
    return {
        f"trees; {way}": {
            "counts": [[f"road-{k}", end, "natural", 10, n] for k, n in enumerate(of) for end in (0.0, 2.0)]
        }
        for way, of in right.items()
    }


def test_right_answers_are_less_by_what_is_lost() -> None:
    of_case = answered(answers())  # type: ignore[arg-type]
    assert of_case[""] == (80.0, 0.0)
    value, half = of_case["bodies"]
    assert value == pytest.approx(60.0)
    assert half == pytest.approx(100 * 12.7062 * 0.1 * np.sqrt(2) / np.sqrt(2), rel=1e-4)  # Student's t of two seeds
    assert {of_case[name][0] for name in FEWER} == {40.0}
    with pytest.raises(InputError, match="no answers by bodies, 5 Hz"):
        answered({way: of for way, of in answers().items() if "5 Hz" not in way or "12.5" in way})  # type: ignore[misc]


def test_the_command_draws_what_it_has_and_senses_nothing_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    sensed: list[int] = []

    def scored(seed: int, *_: object) -> tuple[SceneScores, float]:
        sensed.append(seed)
        return scores(5.0 + seed), 1.0

    monkeypatch.setattr(scene_price, "scored", scored)
    (tmp_path / "split.json").write_text(json.dumps(answers()))
    command = ["scene_price", *(str(tmp_path / name) for name in ("cases.json", "price.png", "split.json"))]
    command[2:2] = ["1:2", "40"]
    monkeypatch.setattr("sys.argv", command)
    for _ in range(2):
        main()
    assert len(sensed) == 2 * len(CASES) == len(json.loads((tmp_path / "cases.json").read_text()))
    assert (tmp_path / "price.png").stat().st_size > 10_000
    assert "| bodies, masts every 500 m |" in capsys.readouterr().out
    assert SPENT["power, dBm"] == {"bodies, 26 dBm": 26.0, "bodies, 36 dBm": 36.0, "bodies": 46.0}
    monkeypatch.setattr("sys.argv", [*command, "bodies"])
    with pytest.raises(InputError, match="the figure shows all cases"):
        main()
