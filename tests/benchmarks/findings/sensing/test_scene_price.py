"""The price of knowing: what is compared, and what the symbols would carry."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from isac_cosim.base.errors import InputError
from isac_cosim.benchmarks.findings.sensing import scene_price
from isac_cosim.benchmarks.findings.sensing.scene_price import CASES, SPENT, carried_mbps, main, of_a_vehicle_m, rows
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


def test_the_command_draws_what_it_has_and_senses_nothing_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    sensed: list[int] = []

    def scored(seed: int, *_: object) -> tuple[SceneScores, float]:
        sensed.append(seed)
        return scores(5.0 + seed), 1.0

    monkeypatch.setattr(scene_price, "scored", scored)
    command = ["scene_price", str(tmp_path / "cases.json"), "1:2", "40", str(tmp_path / "price.png")]
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
