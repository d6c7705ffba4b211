"""How an episode's candidates are balanced by setting."""

from __future__ import annotations

from collections import Counter

import hypothesis.strategies as st
from hypothesis import given, settings

from labeling.generation.episode import select
from labeling.generation.settings import SelectionSettings
from labeling.intentions import Intention
from labeling.samples.candidates import Candidate


def candidates(of: dict[Intention, int]) -> list[Candidate]:
    """So many of each intention, at onsets that interleave the classes."""
    found = [
        Candidate(f"{intention}-{k}", "u", intention, "natural", 10.0 + k, 12.6 + k, 13.0 + k, 14.0 + k, "ahead")
        for intention, number in of.items()
        for k in range(number)
    ]
    return sorted(found, key=lambda each: (each.t_onset, each.tv))


numbers = st.dictionaries(st.sampled_from(list(Intention)), st.integers(0, 30), max_size=len(Intention))


@settings(max_examples=60, deadline=None)
@given(of=numbers, cap=st.integers(1, 40), following=st.integers(0, 40), seed=st.integers(0, 10))
def test_a_class_gets_what_there_is_up_to_its_most(
    of: dict[Intention, int], cap: int, following: int, seed: int
) -> None:
    found = candidates(of)
    chosen, dropped = select(found, SelectionSettings(per_class=cap, following=following), ("road", seed))
    most = {each: following if each is Intention.FOLLOWING else cap for each in Intention}
    assert Counter(each.intention for each in chosen) == +Counter({each: min(n, most[each]) for each, n in of.items()})
    assert len(set(chosen)) == len(chosen)
    assert set(chosen) <= set(found)
    assert dropped == len(found) - len(chosen)
    assert [each.t_onset for each in chosen] == sorted(each.t_onset for each in chosen)


def test_beyond_every_cap_the_natural_balance_is_kept() -> None:
    found = candidates({Intention.OVERTAKE: 3, Intention.FOLLOWING: 300, Intention.HARD_BRAKE: 40})
    assert select(found, SelectionSettings(per_class=1000, following=1000), ("road", 1)) == (found, 0)


def test_the_draw_is_even_over_the_episode_and_another_one_for_another_seed() -> None:
    found = candidates({Intention.LEFT_LANE_CHANGE: 20})
    episodes = 2000
    times: Counter[str] = Counter()
    for seed in range(episodes):
        chosen, _ = select(found, SelectionSettings(per_class=5), ("road", seed))
        times.update(each.tv for each in chosen)
    expected = episodes * 5 / 20
    # Six standard deviations of a binomial count: late events are taken as often as early ones.
    assert max(abs(times[each.tv] - expected) for each in found) < 6 * (expected * 0.75) ** 0.5
