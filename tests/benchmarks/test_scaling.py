"""The benches of scaling, made small: what they report and that they take the real path, not how fast."""

from __future__ import annotations

import math

import pytest

from benchmarks import cluster, scaling
from benchmarks.scaling import Made


def made(jobs: int, episodes: int, seconds: float, peak_mib: int) -> Made:
    """Ten samples an episode; 3 s of start-up and 1 s at the end."""
    return Made(jobs, episodes, 10 * episodes, seconds, 3.0, 1.0, 2.0, peak_mib * 2**20)


def test_start_up_is_told_apart_from_the_rate() -> None:
    """By hand: one worker 20 samples a second, two 36 or 38."""
    one = made(1, 48, 28.0, 200)
    several = {1: made(2, 12, 4 + 120 / 36, 200), 2: made(2, 24, 4 + 240 / 38, 201), 4: made(2, 48, 4 + 480 / 38, 201)}
    found = scaling.summed_up(one, several)
    assert found["ratio"] == 1.9
    assert found["ratio_with_start"] == pytest.approx(28 / (4 + 480 / 38), abs=1e-3)
    assert found["spread"] == pytest.approx(38 / 36 - 1, abs=1e-3)
    assert found["spread_with_start"] > 0.5
    assert found["parent_growth_mib"] == 1.0
    assert [each["samples_per_s"] for each in found["runs"]] == [20.0, 36.0, 38.0, 38.0]


@pytest.mark.slow
def test_twice_the_work_is_twice_the_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scaling, "UNIT", 2)
    once, twice = scaling.make(2, 1), scaling.make(4, 2)
    assert (once.episodes, twice.episodes) == (2, 4)
    assert twice.samples == 2 * once.samples > 0
    for each in (once, twice):
        assert each.start_s > 0
        assert each.end_s > 0
        assert each.seconds - each.start_s - each.end_s >= each.episode_s * each.episodes / each.jobs - 0.01


def test_the_list_of_shards_grows_straight() -> None:
    few, many = cluster.metadata(100), cluster.metadata(400)
    assert few["episodes"] == 100
    per_episode = (many["bytes"] - few["bytes"]) / 300
    assert 500 < per_episode < 1500
    # What does not depend on the episodes is most of the small one's rest.
    assert few["bytes"] - 100 * per_episode < 30_000


@pytest.mark.slow
def test_a_simulated_cluster_makes_every_episode() -> None:
    found = cluster.simulated(40, 3)
    assert (found["workers"], found["episodes"]) == (3, 40)
    # From the sixth episode's end on: two more may have ended by then, the other 32 take turns at three workers.
    assert 0 < found["episodes_per_s"] <= 34 / (math.ceil(32 / 3) * cluster.PAUSE_S) + 0.1
    for side in ("scheduler", "parent"):
        assert found[side]["cpu_ms"] > 0
        assert len(found[side]["mib"]) == 3
        assert found[side]["episodes_per_s"] == pytest.approx(1000 / found[side]["cpu_ms"], rel=0.05)
