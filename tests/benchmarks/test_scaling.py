"""The benches of scaling, made small: what they report and that they take the real path, not how fast."""

from __future__ import annotations

import math

import pytest

from isac_cosim.benchmarks import cluster, scaling
from isac_cosim.benchmarks.scaling import Measurement


def measurement(jobs: int, episodes: int, seconds: float, peak_mib: int) -> Measurement:
    """Return a measurement with ten samples per episode, 3 s of start-up and 1 s at the end."""
    return Measurement(jobs, episodes, 10 * episodes, seconds, 3.0, 1.0, 2.0, peak_mib * 2**20)


def test_start_up_is_told_apart_from_the_rate() -> None:
    """By hand: one worker 20 samples a second, two 36 or 38."""
    one = measurement(1, 48, 28.0, 200)
    several = {
        1: measurement(2, 12, 4 + 120 / 36, 200),
        2: measurement(2, 24, 4 + 240 / 38, 201),
        4: measurement(2, 48, 4 + 480 / 38, 201),
    }
    result = scaling.summarise(one, several)
    assert result["ratio"] == 1.9
    assert result["ratio_with_start"] == pytest.approx(28 / (4 + 480 / 38), abs=1e-3)
    assert result["spread"] == pytest.approx(38 / 36 - 1, abs=1e-3)
    assert result["spread_with_start"] > 0.5
    assert result["parent_growth_mib"] == 1.0
    assert [run["samples_per_s"] for run in result["runs"]] == [20.0, 36.0, 38.0, 38.0]


@pytest.mark.slow
def test_twice_the_work_is_twice_the_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scaling, "UNIT", 2)
    once, twice = scaling.measure(2, 1), scaling.measure(4, 2)
    assert (once.episodes, twice.episodes) == (2, 4)
    assert twice.samples == 2 * once.samples > 0
    for run in (once, twice):
        assert run.start_s > 0
        assert run.end_s > 0
        assert run.seconds - run.start_s - run.end_s >= run.episode_s * run.episodes / run.jobs - 0.01


def test_the_index_of_shards_grows_straight() -> None:
    few, many = cluster.indexed(100), cluster.indexed(400)
    assert few["episodes"] == 100
    per_episode = (many["bytes"] - few["bytes"]) / 300
    # The digest alone, which cannot be compressed, takes 32 bytes.
    assert 32 < per_episode < 150
    # What does not depend on the episodes is most of the small one's rest.
    assert few["bytes"] - 100 * per_episode < 30_000


@pytest.mark.slow
def test_a_simulated_cluster_makes_every_episode() -> None:
    result = cluster.simulated(40, 3)
    assert (result["workers"], result["episodes"]) == (3, 40)
    # From the sixth episode's end on: two more may have ended by then, the other 32 take turns at three workers.
    assert 0 < result["episodes_per_s"] <= 34 / (math.ceil(32 / 3) * cluster.PAUSE_S) + 0.1
    for side in ("scheduler", "parent"):
        assert result[side]["cpu_ms"] > 0
        assert len(result[side]["mib"]) == 3
        assert result[side]["episodes_per_s"] == pytest.approx(1000 / result[side]["cpu_ms"], rel=0.05)
