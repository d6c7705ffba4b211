"""Alarms and events are matched one to one; mir_eval and brute force are the witnesses."""

from __future__ import annotations

from itertools import permutations

import mir_eval.util
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from isac_cosim.evaluation.in_traffic.alarms.alarms import Alarms
from isac_cosim.evaluation.in_traffic.scores.matching import EventTable, match
from isac_cosim.labeling.intentions import KNOWN, Intention
from isac_cosim.labeling.streams.events import LiveEvent

times = st.lists(st.integers(0, 40).map(lambda k: k / 4), max_size=6).map(lambda values: np.array(sorted(values)))


def most_matches(
    alarms: np.ndarray, earliest: np.ndarray, latest: np.ndarray, commit: np.ndarray
) -> tuple[int, int, float]:
    """The best matching, by trying every order of the alarms: pairs, those by the commit, and how early they come."""
    padded = [*alarms.tolist(), *[np.nan] * len(earliest)]
    best = (0, 0, 0.0)
    for order in permutations(padded, len(earliest)):
        rows = zip(order, earliest, latest, commit, strict=False)
        pairs = [(time, at) for time, low, high, at in rows if low <= time <= high]
        best = max(best, (len(pairs), sum(time <= at for time, at in pairs), -sum(time for time, _ in pairs)))
    return best


@given(times, st.lists(st.tuples(st.integers(0, 40), st.integers(0, 12), st.integers(0, 12)), max_size=3))
def test_as_many_alarms_as_possible_are_matched_and_of_these_by_the_commit(
    alarms: np.ndarray, spans: list[tuple[int, int, int]]
) -> None:
    earliest = np.array([start / 4 for start, _, _ in spans])
    latest = np.array([(start + length) / 4 for start, length, _ in spans])
    commit = np.array([(start + min(length, late)) / 4 for start, length, late in spans])
    matched = match(alarms, earliest, latest, commit)
    hits = matched[matched >= 0]
    assert len(set(hits.tolist())) == len(hits)
    for event in np.flatnonzero(matched >= 0):
        assert earliest[event] <= alarms[matched[event]] <= latest[event]
    timely = int((alarms[hits] <= commit[matched >= 0]).sum())
    if len(earliest):
        assert (len(hits), timely, -alarms[hits].sum()) == most_matches(alarms, earliest, latest, commit)
    else:
        assert not len(hits)


def test_mir_eval_matches_as_many_within_a_symmetric_window() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        onsets = np.sort(rng.uniform(0, 30, rng.integers(1, 12)))
        alarms = np.sort(rng.uniform(0, 30, rng.integers(1, 15)))
        window = float(rng.uniform(0.1, 3))
        matched = match(alarms, onsets - window, onsets + window, onsets)
        assert (matched >= 0).sum() == len(mir_eval.util.match_events(onsets, alarms, window))


def test_of_two_alarms_for_an_event_the_earlier_one_counts() -> None:
    assert match(np.array([3.0, 4.0]), np.array([2.0]), np.array([5.0]), np.array([4.5])).tolist() == [0]


def test_an_alarm_that_fits_two_events_predicts_the_second_one_rather_than_coming_late_for_the_first() -> None:
    times, earliest, latest = np.array([19.5]), np.array([8.0, 19.0]), np.array([20.0, 25.0])
    assert match(times, earliest, latest, np.array([12.0, 23.0])).tolist() == [-1, 0]


def test_two_events_share_two_alarms_that_both_fit() -> None:
    """The first alarm fits both events, the second one only the first event."""
    latest = np.array([2.5, 3.0])
    assert match(np.array([2.0, 1.0]), np.array([0.0, 1.5]), latest, latest).tolist() == [1, 0]


def event(vehicle: str, intention: Intention, onset: float, left_out: str | None = None) -> LiveEvent:
    return LiveEvent(
        vehicle=vehicle, intention=intention.text, onset=onset, commit=onset + 1, end=onset + 3, group="natural",
        left_out=left_out,
    )  # fmt: skip


def raised(*rows: tuple[int, Intention, float]) -> Alarms:
    intention = np.array([KNOWN.index(what) for _, what, _ in rows])
    return Alarms(
        intention, np.arange(len(rows)), np.array([who for who, _, _ in rows]), np.array([at for _, _, at in rows])
    )


LEFT, BRAKE, OVERTAKE = Intention.LEFT_LANE_CHANGE, Intention.HARD_BRAKE, Intention.OVERTAKE


def test_an_alarm_needs_the_vehicle_and_the_intention_of_its_event() -> None:
    table = EventTable.of((event("a", LEFT, 10), event("b", LEFT, 10)), ("a", "b"), 2.0)
    matching = table.match(raised((0, LEFT, 9.0), (1, BRAKE, 9.0), (0, LEFT, 7.9)))
    assert matching.event_alarm.tolist() == [0, -1]
    assert matching.false.tolist() == [1, 2]


def test_an_alarm_after_the_end_or_too_early_is_false() -> None:
    table = EventTable.of((event("a", LEFT, 10),), ("a",), 2.0)
    for time, is_false in ((7.95, True), (8.0, False), (13.0, False), (13.05, True)):
        assert bool(len(table.match(raised((0, LEFT, time))).false)) == is_false


def test_a_second_alarm_for_one_event_is_false() -> None:
    table = EventTable.of((event("a", LEFT, 10),), ("a",), 2.0)
    matching = table.match(raised((0, LEFT, 9.0), (0, LEFT, 11.5)))
    assert (matching.event_alarm.tolist(), matching.false.tolist()) == ([0], [1])


def test_a_neutral_event_takes_alarms_that_are_neither_right_nor_false() -> None:
    """A pulling-out whose outcome is open may be a lane change or an overtake, but no brake."""
    table = EventTable.of((event("a", LEFT, 10, "unresolved"),), ("a",), 2.0)
    matching = table.match(raised((0, LEFT, 9.0), (0, OVERTAKE, 10.0), (0, BRAKE, 10.0)))
    assert (len(matching.event_alarm), matching.false.tolist()) == (0, [2])


def test_an_event_of_a_vehicle_that_was_never_watched_matches_nothing() -> None:
    table = EventTable.of((event("z", LEFT, 10),), ("a",), 2.0)
    assert table.match(raised((0, LEFT, 10.0))).event_alarm.tolist() == [-1]


@given(
    st.lists(st.tuples(st.integers(0, 1), st.sampled_from([LEFT, BRAKE, OVERTAKE]), st.integers(0, 40)), max_size=12),
    st.lists(
        st.tuples(
            st.sampled_from("abz"),
            st.sampled_from([LEFT, BRAKE]),
            st.integers(0, 40),
            st.sampled_from([None, None, "near_miss", "no_uv"]),
        ),
        max_size=6,
    ),
)
def test_a_whole_episode_is_matched_as_each_vehicle_and_intention_by_itself(
    alarms: list[tuple[int, Intention, int]], events: list[tuple[str, Intention, int, str | None]]
) -> None:
    table = EventTable.of(tuple(event(who, what, at / 4, why) for who, what, at, why in events), ("a", "b"), 2.0)
    of_episode = raised(*[(who, what, at / 4) for who, what, at in alarms])
    matching = table.match(of_episode)
    taken: set[int] = set()
    for who, what in {(who, what) for who, what in zip(table.vehicle.tolist(), table.intention.tolist(), strict=True)}:
        rows = np.flatnonzero((table.vehicle == who) & (table.intention == what))
        mine = np.flatnonzero((of_episode.vehicle == who) & (of_episode.intention == what))
        matched = match(of_episode.time_s[mine], table.earliest[rows], table.latest[rows], table.commit[rows])
        times = [of_episode.time_s[mine[k]] if k >= 0 else None for k in matched]
        assert [of_episode.time_s[k] if k >= 0 else None for k in matching.event_alarm[rows]] == times
        taken |= set(matching.event_alarm[rows].tolist())
    for k in range(len(of_episode)):
        fits = (table.neutral_vehicle == of_episode.vehicle[k]) & (table.neutral_intention == of_episode.intention[k])
        fits &= (table.neutral_earliest <= of_episode.time_s[k]) & (of_episode.time_s[k] <= table.neutral_latest)
        neutral, near = bool(fits[~table.near_miss].any()), bool(fits.any())
        expected = "right" if k in taken else "neutral" if neutral else "near" if near else "false"
        found = "false" if k in matching.false else "near" if k in matching.near_misses else "else"
        assert found == {"right": "else", "neutral": "else"}.get(expected, expected)
