"""Picks the moments of an evaluation in traffic that are worth a look: its worst false alarms and missed maneuvers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain, zip_longest

import numpy as np

from isac_cosim.base.arrays import Array, BoolArray, Float32Array
from isac_cosim.evaluation.in_traffic.alarms.alarms import Alarms
from isac_cosim.evaluation.in_traffic.measurement.measuring import MeasuredAlarms
from isac_cosim.evaluation.in_traffic.scores.scoring import Truth
from isac_cosim.evaluation.in_traffic.streams.store import RUN, LiveEpisode
from isac_cosim.evaluation.report.replay.content import Maneuver, ShownAlarm
from isac_cosim.labeling.intentions import KNOWN, spoken
from isac_cosim.labeling.streams.events import LiveEvent

MOST_MOMENTS = 20
"""On one page."""
MOST_EPISODES = 4
"""From which the moments are: each of them is simulated again for the page."""
BEFORE_S, AFTER_S = 5.0, 4.0
"""How much is shown before the alarm or the onset, and after the alarm or the commit, s."""
LONGEST_S = 16.0
"""Of a moment, s."""


@dataclass(frozen=True)
class Mistake:
    """A false alarm, or a maneuver for which no alarm came.

    episode: number among the measured ones. tv: number of the vehicle in the episode. intention: the one that the alarm
    names, or that was missed, as its number. time_s: of the alarm or the onset. until_s: of the alarm or the commit, s
    of simulation time. probability: of that intention at the alarm, or the highest one while an alarm could have come.
    """

    episode: int
    tv: int
    intention: int
    time_s: float
    until_s: float
    probability: float
    missed: bool

    @property
    def rank(self) -> tuple[float, int, float]:
        """By which the worst of its kind comes first."""
        return (self.probability if self.missed else -self.probability, self.episode, self.time_s)

    @property
    def span_s(self) -> tuple[float, float]:
        """From when until when it is shown, s of simulation time."""
        return self.time_s - BEFORE_S, min(self.until_s + AFTER_S, self.time_s - BEFORE_S + LONGEST_S)


def worst_moments(truths: Sequence[Truth], measured: MeasuredAlarms) -> list[Mistake]:
    """Return the worst false alarms and missed maneuvers in turn, at most MOST_MOMENTS from MOST_EPISODES episodes.

    A false alarm is the worse the likelier the run held the intention that it names; a miss, the less likely it held
    the maneuver at best. Moments of one vehicle that overlap are shown once, as the worse of them.
    """
    pairs = list(enumerate(zip(truths, measured.alarms, strict=True)))
    false, missed = (
        sorted((one for k, of_episode in pairs for one in of_kind(k, *of_episode)), key=lambda moment: moment.rank)
        for of_kind in (_false, _missed)
    )
    in_turn = (moment for moment in chain(*zip_longest(false, missed)) if moment is not None)
    return _apart(in_turn)


def _false(number: int, truth: Truth, alarms: Alarms) -> Iterable[Mistake]:
    probabilities = truth.episode.answers[RUN].probabilities
    for alarm in truth.table.match(alarms).false.tolist():
        intention, time_s = int(alarms.intention[alarm]), float(alarms.time_s[alarm])
        probability = float(probabilities[alarms.row[alarm], intention])
        yield Mistake(number, int(alarms.vehicle[alarm]), intention, time_s, time_s, probability, False)


def _missed(number: int, truth: Truth, alarms: Alarms) -> Iterable[Mistake]:
    episode, table = truth.episode, truth.table
    for event in np.flatnonzero(table.match(alarms).event_alarm < 0).tolist():
        vehicle, intention = int(table.vehicle[event]), int(table.intention[event])
        asked = rows_of(episode, vehicle, float(table.earliest[event]), float(table.commit[event]))
        if asked.any():
            probability = float(episode.answers[RUN].probabilities[asked, intention].max())
            onset, commit = float(truth.onset[event]), float(truth.commit[event])
            yield Mistake(number, vehicle, intention, onset, commit, probability, True)


def _apart(moments: Iterable[Mistake]) -> list[Mistake]:
    kept, episodes = list[Mistake](), set[int]()
    for moment in moments:
        if len(kept) == MOST_MOMENTS:
            break
        if moment.episode not in episodes and len(episodes) == MOST_EPISODES:
            continue
        if any(_overlap(moment, other) for other in kept):
            continue
        kept.append(moment)
        episodes.add(moment.episode)
    return kept


def _overlap(one: Mistake, other: Mistake) -> bool:
    (begin, end), (other_begin, other_end) = one.span_s, other.span_s
    return (one.episode, one.tv) == (other.episode, other.tv) and begin < other_end and other_begin < end


def rows_of(episode: LiveEpisode, vehicle: int, from_s: float, to_s: float) -> BoolArray:
    """Return which predictions are of a vehicle and end within a span of time, s, (n,)."""
    times = episode.time_s
    return np.asarray((episode.vehicle == vehicle) & (times >= from_s - 1e-9) & (times <= to_s + 1e-9))


def maneuvers_within(events: Iterable[LiveEvent], tv: str, from_s: float, to_s: float) -> list[Maneuver]:
    """Return what a vehicle really does within a span of time, s, by onset; neutral events say why they are."""
    return [
        Maneuver(event.intention, event.onset - from_s, event.commit - from_s, spoken(event.left_out or ""))
        for event in events
        if event.vehicle == tv and event.onset <= to_s and event.commit >= from_s
    ]


def alarms_within(truth: Truth, alarms: Alarms, tv: int, from_s: float, to_s: float) -> list[ShownAlarm]:
    """Return the alarms for a vehicle within a span of time, s, by time."""
    false = set(truth.table.match(alarms).false.tolist())
    inside = (alarms.vehicle == tv) & (alarms.time_s >= from_s) & (alarms.time_s <= to_s)
    found = [
        ShownAlarm(KNOWN[int(alarms.intention[k])].text, float(alarms.time_s[k]) - from_s, k in false)
        for k in np.flatnonzero(inside).tolist()
    ]
    return sorted(found, key=lambda alarm: alarm.time_s)


def answers_around(
    episode: LiveEpisode, tv: int, at_s: float, from_s: float, to_s: float
) -> tuple[float, Float32Array]:
    """Return the run's answers for a vehicle around an instant, up to a pause or the ends of a span of time, s.

    Returns when the first window of them ends, s of simulation time, and the probabilities, a decision apart, (n, 6).
    """
    rows = np.flatnonzero(rows_of(episode, tv, from_s, to_s))
    times: Array = episode.time_s[rows]
    runs = np.cumsum(np.diff(times, prepend=times[0]) > 1.5 * episode.facts.decision_s)
    rows = rows[runs == runs[np.abs(times - at_s).argmin()]]
    return float(episode.time_s[rows[0]]), episode.answers[RUN].probabilities[rows]
