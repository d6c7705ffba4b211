import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st
from rich.console import Console

from isac_cosim.labeling.dataset.distributions import _peaks, too_few_seeds
from isac_cosim.labeling.dataset.summary import EPISODES_SHOWN, _episodes_table, faults
from isac_cosim.labeling.intentions import Intention


@settings(max_examples=25, deadline=None)
@given(angle=st.floats(0, 2 * np.pi), peak=st.floats(-9, 9), across=st.floats(-6, 6), onset=st.integers(0, 90))
@example(angle=0.0, peak=0.0, across=0.0, onset=1)  # nothing happens after onset
def test_peaks_are_along_and_across_the_driving_direction(angle: float, peak: float, across: float, onset: int) -> None:
    """A vehicle drives straight on, and accelerates in one row after the onset, and harder in one before it."""
    along, left = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    truth = np.zeros((1, 6, 100), np.float32)
    truth[0, 2:4] = 30.0 * along[:, None]
    truth[0, 4:6, 95] = peak * along + across * left
    if onset > 0:
        truth[0, 4:6, onset - 1] = 50.0 * along + 50.0 * left
    peaks = _peaks(truth, np.array([onset]))
    np.testing.assert_allclose(np.concatenate(peaks), [peak, across], atol=1e-4)


def test_a_class_from_few_seeds_is_named_and_an_absent_one_is_not() -> None:
    by_intention = {"hard_brake": {"seeds": 12}, "overtake": {"seeds": 3}, "following": {"seeds": 0}}
    assert too_few_seeds(by_intention) == ["overtake"]


def test_the_warning_names_the_classes_that_cannot_be_split() -> None:
    """Four seeds cannot hold one for each side of 60, 20 and 20 %, five can."""
    seeds = {"hard_brake": {"seeds": 5}, "overtake": {"seeds": 4}, "following": {"seeds": 0}}
    summary = {"lost": [], "traffic": None, "samples": 9, "short": [], "distributions": seeds}
    assert faults(summary) == ["too few seeds to split into training, validation and test: overtake"]
    assert faults({**summary, "distributions": {"overtake": {"seeds": 5}}}) == []


def shown(episodes: int) -> list[list[str]]:
    """The cells of the table of episodes; every episode has as many samples of every intention as its seed says."""
    by_seed = {f"my-road-{seed}": seed for seed in range(1, episodes + 1)}
    counts = {"by_scenario": {"my-road": sum(by_seed.values())}, "by_seed": by_seed}
    console = Console(width=80)
    with console.capture() as output:
        console.print(_episodes_table({intention.text: counts for intention in Intention}))
    lines = [line for line in output.get().splitlines() if "my-road" in line]
    return [[cell.strip() for cell in line.strip("│").split("│")] for line in lines]


def test_counts_by_scenario_and_by_few_seeds_in_their_order_are_shown_whole() -> None:
    assert shown(11)[0] == ["my-road", *["66"] * 7, "462"]
    assert [row[0] for row in shown(11)[1:]] == [f"my-road-{seed}" for seed in range(1, 12)]
    assert shown(11)[10] == ["my-road-10", *["10"] * 7, "70"]
    assert len(shown(EPISODES_SHOWN + 1)) == 1
