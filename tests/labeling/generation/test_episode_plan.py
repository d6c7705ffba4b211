"""The stop rule, against a restatement of it by brute force."""

from __future__ import annotations

import random
from collections import Counter

from hypothesis import given, settings
from hypothesis import strategies as st

from isac_cosim.labeling.dataset.dataset import Lost
from isac_cosim.labeling.generation.episode_plan import Counts, EpisodeJob, EpisodePlan, Jobs
from isac_cosim.labeling.generation.settings import SeedRange, SelectionSettings
from isac_cosim.labeling.intentions import KNOWN

NAMES = [intention.text for intention in KNOWN]


def episode(job: EpisodeJob, counts: list[int]) -> Counts | Lost:
    """An episode with these counts of the six known intentions, or a lost one where the first is negative."""
    if counts[0] < 0:
        return Lost(scenario=job.scenario, seed=job.seed, reason="broke")
    return dict(zip(NAMES, counts, strict=True))


def shortest_run(episodes: list[list[int]], windows: int, least: int, patience: int) -> int:
    """Try every length of run, shortest first."""
    for length in range(len(episodes) + 1):
        total: Counter[str] = Counter()
        for counts in episodes[:length]:
            total.update({name: max(count, 0) for name, count in zip(NAMES, counts, strict=True)})
        enough = total.total() >= windows and all(total[name] >= least for name in NAMES)
        idle = length >= patience and all(sum(counts) <= 0 for counts in episodes[length - patience : length])
        if enough or idle:
            return length
    return len(episodes)


COUNTS = st.one_of(st.lists(st.integers(0, 4), min_size=6, max_size=6), st.just([0] * 6), st.just([-1] + [0] * 5))


@settings(max_examples=150, deadline=None)
@given(
    episodes=st.lists(COUNTS, min_size=1, max_size=12), windows=st.integers(1, 60), least=st.integers(0, 8),
    patience=st.integers(1, 4), order=st.randoms(use_true_random=False),
)  # fmt: skip
def test_the_run_is_the_shortest_whatever_the_order(
    episodes: list[list[int]], windows: int, least: int, patience: int, order: random.Random
) -> None:
    jobs = [EpisodeJob("road", "road", seed) for seed in range(len(episodes))]
    plan = EpisodePlan(jobs, SelectionSettings(windows=windows, min_per_class=least, patience=patience))
    numbers = list(range(len(jobs)))
    order.shuffle(numbers)
    for number in numbers:
        if not plan.done:
            plan.add(jobs[number], episode(jobs[number], episodes[number]))
    assert plan.done
    assert plan.length == shortest_run(episodes, windows, least, patience)
    broke = {job.seed for job, counts in zip(jobs, episodes, strict=True) if counts[0] < 0}
    assert [lost.seed for lost in plan.lost] == [seed for seed in range(plan.length) if seed in broke]
    assert [job.seed for job in plan.kept()] == [seed for seed in range(plan.length) if seed not in broke]


def test_jobs_are_every_scenario_seed_by_seed() -> None:
    jobs = Jobs((("nets/a", "a", range(3, 6)), ("nets/b", "b", range(3, 6))))
    listed = [EpisodeJob(f"nets/{name}", name, seed) for seed in (3, 4, 5) for name in "ab"]
    assert list(jobs) == listed
    assert jobs[1:4] == listed[1:4]
    assert jobs[-1] == listed[-1]
    assert jobs.find("b", 5) == listed[-1]
    assert jobs.find("b", 6) is jobs.find("nets/b", 5) is None


def test_a_scenario_with_fewer_seeds_leaves_the_rest_to_the_others() -> None:
    jobs = Jobs((("nets/a", "a", (4, 9)), ("nets/b", "b", (1,)), ("nets/c", "c", (2, 3, 5))))
    assert [(job.scenario, job.seed) for job in jobs] == [
        ("a", 4), ("b", 1), ("c", 2), ("a", 9), ("c", 3), ("c", 5),
    ]  # fmt: skip


def test_a_range_of_all_seeds_is_not_made_before_it_is_asked_for() -> None:
    jobs = Jobs((("road", "road", SeedRange(first=0, last=2**31 - 1).numbers),))
    plan = EpisodePlan(jobs, SelectionSettings(windows=12))
    for job in plan.missing():
        plan.add(job, episode(job, [1] * 6))
    assert plan.progress() == (12, 12)
    assert plan.length == 2


def test_without_windows_every_episode_is_used() -> None:
    jobs = [EpisodeJob("road", "road", seed) for seed in range(30)]
    plan = EpisodePlan(jobs, SelectionSettings(patience=2))
    assert list(plan.missing()) == jobs
    for job in jobs:
        assert not plan.done
        plan.add(job, episode(job, [0] * 6))
    assert plan.done
    assert plan.length == 30
    assert plan.progress() == (30, 30)


def test_missing_episodes_are_taken_in_order_and_only_while_needed() -> None:
    jobs = [EpisodeJob("road", "road", seed) for seed in range(10)]
    plan = EpisodePlan(jobs, SelectionSettings(windows=5))
    plan.add(jobs[1], episode(jobs[1], [1] * 6))
    taken = []
    for job in plan.missing():
        taken.append(job.seed)
        plan.add(job, episode(job, [0] * 6))
    assert taken == [0]
    assert plan.length == 2


def test_progress_waits_for_the_rarest_class() -> None:
    jobs = [EpisodeJob("road", "road", seed) for seed in range(4)]
    plan = EpisodePlan(jobs, SelectionSettings(windows=10, min_per_class=4))
    plan.add(jobs[0], episode(jobs[0], [9, 9, 9, 9, 9, 1]))
    assert plan.progress() == (2, 10)
    assert plan.short() == (NAMES[5],)


def plan_of(episodes: list[int], wanted: int, least: int = 0, patience: int = 99) -> EpisodePlan:
    """A plan whose episodes hold so many samples, all of one intention."""
    jobs = Jobs((("road", "road", range(1, len(episodes) + 1)),))
    plan = EpisodePlan(jobs, SelectionSettings(windows=wanted, min_per_class=least, patience=patience))
    for job, count in zip(jobs, episodes, strict=True):
        plan.add(job, {NAMES[0]: count})
    return plan


def test_another_number_of_samples_than_was_asked_for_is_explained() -> None:
    assert plan_of([2, 4], 6).difference is None
    assert plan_of([2, 10], 6).difference == (
        "12 samples, where 6 were asked for: an episode is kept whole, and the last one that was needed ends there"
    )
    assert plan_of([2, 3], 6).difference == (
        "5 samples, where 6 were asked for: the seeds hold no more; name more with --seeds"
    )
    assert plan_of([2, 0, 0], 6, patience=2).difference == "2 samples, where 6 were asked for: the episodes hold none"
    assert plan_of([7, 1, 2], 6, least=1).difference == (
        "10 samples, where 6 were asked for: 2 more episodes ran to have 1 of every known intention, "
        "and did not find them"
    )


def test_no_number_asked_for_is_none_to_explain() -> None:
    plan = EpisodePlan(Jobs((("road", "road", range(1, 2)),)), SelectionSettings(windows=None))
    plan.add(plan.jobs[0], {NAMES[0]: 3})
    assert plan.difference is None
