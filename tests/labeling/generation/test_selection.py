"""How an episode's candidates are balanced by setting."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

import hypothesis.strategies as st
from hypothesis import given, settings

from isac_cosim.base.seeding import stream
from isac_cosim.labeling.generation.selection import Selection, draws, select
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


KEY = ("road", 1)
numbers = st.dictionaries(st.sampled_from(list(Intention)), st.integers(0, 30), max_size=len(Intention))


def chosen_of(
    available: list[Candidate],
    limits: SelectionSettings,
    seed: int = 1,
    seen: Callable[[Candidate], bool] = lambda _: True,
) -> Selection[str]:
    return select(
        draws(available, limits, ("road", seed)),
        lambda batch: [candidate.tv if seen(candidate) else None for candidate in batch],
    )


@settings(max_examples=60, deadline=None)
@given(of=numbers, cap=st.integers(1, 40), following=st.integers(0, 40), seed=st.integers(0, 10))
def test_a_class_gets_what_there_is_up_to_its_most(
    of: dict[Intention, int], cap: int, following: int, seed: int
) -> None:
    available = candidates(of)
    selection = chosen_of(available, SelectionSettings(per_class=cap, following=following), seed)
    chosen = [candidate for candidate, _ in selection.made]
    most = {intention: following if intention is Intention.FOLLOWING else cap for intention in Intention}
    expected = +Counter({intention: min(number, most[intention]) for intention, number in of.items()})
    assert Counter(candidate.intention for candidate in chosen) == expected
    assert len(set(chosen)) == len(chosen)
    assert set(chosen) <= set(available)
    assert (selection.surplus, selection.unseen) == (len(available) - len(chosen), 0)
    assert [candidate.t_onset for candidate in chosen] == sorted(candidate.t_onset for candidate in chosen)
    assert [made for _, made in selection.made] == [candidate.tv for candidate in chosen]


def test_beyond_every_cap_the_natural_balance_is_kept() -> None:
    available = candidates({Intention.OVERTAKE: 3, Intention.FOLLOWING: 300, Intention.HARD_BRAKE: 40})
    selection = chosen_of(available, SelectionSettings(per_class=1000, following=1000))
    assert [candidate for candidate, _ in selection.made] == available


def test_the_draw_is_even_over_the_episode_and_another_one_for_another_seed() -> None:
    available = candidates({Intention.LEFT_LANE_CHANGE: 20})
    episodes = 2000
    times: Counter[str] = Counter()
    for seed in range(episodes):
        times.update(made for _, made in chosen_of(available, SelectionSettings(per_class=5), seed).made)
    expected = episodes * 5 / 20
    # Six standard deviations of a binomial count: late events are taken as often as early ones.
    assert max(abs(times[candidate.tv] - expected) for candidate in available) < 6 * (expected * 0.75) ** 0.5


@settings(max_examples=60, deadline=None)
@given(of=numbers, cap=st.integers(1, 12), share=st.floats(0.0, 1.0), seed=st.integers(0, 10))
def test_those_that_no_site_sees_are_replaced_by_those_that_are_left(
    of: dict[Intention, int], cap: int, share: float, seed: int
) -> None:
    """As many as there are in view, up to the limit; every candidate is a sample, unseen, or beyond the cap."""
    available = candidates(of)
    visible = {candidate for candidate in available if stream("view", seed, candidate.tv).random() < share}
    limits = SelectionSettings(per_class=cap, following=cap)
    selection = chosen_of(available, limits, seed, lambda candidate: candidate in visible)
    in_view = Counter(candidate.intention for candidate in visible)
    chosen = Counter(candidate.intention for candidate, _ in selection.made)
    assert chosen == +Counter({intention: min(cap, number) for intention, number in in_view.items()})
    assert len(selection.made) + selection.unseen + selection.surplus == len(available)
    for intention in Intention:
        if chosen[intention] < cap:
            # Whoever lacks samples has asked for all of them.
            assert chosen[intention] == in_view[intention]
    short = all(chosen[intention] < cap for intention in of)
    assert selection.unseen == len(available) - len(visible) if short else True
    assert not (short and selection.surplus)


def test_a_candidate_is_asked_for_once_and_no_more_are_asked_than_needed() -> None:
    available = candidates({Intention.HARD_BRAKE: 40, Intention.FOLLOWING: 40})
    asked: Counter[str] = Counter()

    def make(batch: Sequence[Candidate]) -> list[str | None]:
        asked.update(candidate.tv for candidate in batch)
        return [candidate.tv if int(candidate.tv.rpartition("-")[2]) % 4 == 0 else None for candidate in batch]

    selection = select(draws(available, SelectionSettings(per_class=4, following=2), KEY), make)
    assert set(asked.values()) == {1}
    assert len(selection.made) == 6
    assert selection.unseen == asked.total() - 6
    assert selection.surplus == 80 - asked.total() > 0


def test_where_all_are_seen_the_choice_is_the_first_draw() -> None:
    """The draw of former versions: the first ones of a permutation that is named by scenario, seed and intention."""
    available = candidates({Intention.HARD_BRAKE: 30})
    order = stream("selection", *KEY, "hard_brake").permutation(30)[:5]
    selection = chosen_of(available, SelectionSettings(per_class=5))
    assert {made for _, made in selection.made} == {available[k].tv for k in order}
