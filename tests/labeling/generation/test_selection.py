"""How an episode's candidates are balanced by setting."""

from __future__ import annotations

from collections import Counter

import hypothesis.strategies as st
from hypothesis import given, settings

from isac_cosim.labeling.generation.episode import select
from isac_cosim.labeling.generation.settings import SelectionSettings
from isac_cosim.labeling.intentions import Intention
from isac_cosim.labeling.samples.candidates import Candidate


def candidates(of: dict[Intention, int]) -> list[Candidate]:
    """So many of each intention, at onsets that interleave the classes."""
    available = [
        Candidate(f"{intention}-{k}", "u", intention, "natural", 10.0 + k, 12.6 + k, 13.0 + k, 14.0 + k, "ahead")
        for intention, number in of.items()
        for k in range(number)
    ]
    return sorted(available, key=lambda candidate: (candidate.t_onset, candidate.tv))


numbers = st.dictionaries(st.sampled_from(list(Intention)), st.integers(0, 30), max_size=len(Intention))


@settings(max_examples=60, deadline=None)
@given(of=numbers, cap=st.integers(1, 40), following=st.integers(0, 40), seed=st.integers(0, 10))
def test_a_class_gets_what_there_is_up_to_its_most(
    of: dict[Intention, int], cap: int, following: int, seed: int
) -> None:
    available = candidates(of)
    chosen, dropped = select(available, SelectionSettings(per_class=cap, following=following), ("road", seed))
    most = {intention: following if intention is Intention.FOLLOWING else cap for intention in Intention}
    expected = +Counter({intention: min(number, most[intention]) for intention, number in of.items()})
    assert Counter(candidate.intention for candidate in chosen) == expected
    assert len(set(chosen)) == len(chosen)
    assert set(chosen) <= set(available)
    assert dropped == len(available) - len(chosen)
    assert [candidate.t_onset for candidate in chosen] == sorted(candidate.t_onset for candidate in chosen)


def test_beyond_every_cap_the_natural_balance_is_kept() -> None:
    available = candidates({Intention.OVERTAKE: 3, Intention.FOLLOWING: 300, Intention.HARD_BRAKE: 40})
    assert select(available, SelectionSettings(per_class=1000, following=1000), ("road", 1)) == (available, 0)


def test_the_draw_is_even_over_the_episode_and_another_one_for_another_seed() -> None:
    available = candidates({Intention.LEFT_LANE_CHANGE: 20})
    episodes = 2000
    times: Counter[str] = Counter()
    for seed in range(episodes):
        chosen, _ = select(available, SelectionSettings(per_class=5), ("road", seed))
        times.update(candidate.tv for candidate in chosen)
    expected = episodes * 5 / 20
    # Six standard deviations of a binomial count: late events are taken as often as early ones.
    assert max(abs(times[candidate.tv] - expected) for candidate in available) < 6 * (expected * 0.75) ** 0.5
