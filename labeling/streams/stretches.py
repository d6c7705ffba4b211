"""Finds which vehicles the network watches, with which UV, and when.

A dataset chooses the UV of a sample by a rule; here the same rule applies all the time. The UV of a window is the
leader in the TV's lane when the window begins, if it is connected and within range. It stays the UV until the window
ends, even if the TV changes lane, as in the records that predictors are trained on.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.isacsim.traffic.recordings.recording import Recording, Track
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.samples.uv_choice import PairSettings, choose_uv, may_be_tv

TRACK_ENDS = "near_the_ends_of_the_track"
NO_UV = "no_connected_leader"
UV_ENDS = "leader_enters_or_leaves"
TV_KIND = "vehicle_class"
"""Reasons why a vehicle is not predicted at an instant, apart from sensing."""


@dataclass(frozen=True)
class Timing:
    """Times around a prediction, s.

    decision_s: time between predictions, which are made at its multiples. window_s: length of a window.
    report_delay_s: age of the newest report. run_in_s: how long a TV is sensed before its first window, for the filter
    to settle. margin_s: how long both vehicles have to be on the road before and after what is sensed, for the
    conditioning kernel. outcome_s, longest_stretch_s: see `StreamSettings`.
    """

    decision_s: float
    window_s: float
    report_delay_s: float
    run_in_s: float
    margin_s: float
    outcome_s: float
    longest_stretch_s: float

    @property
    def before_decision_s(self) -> float:
        """How long before a decision the TV has to be sensed, s, a whole number of decisions."""
        return float(np.ceil((self.window_s + self.run_in_s) / self.decision_s - 1e-6)) * self.decision_s

    def decisions(self, recording: Recording, track: Track) -> Array:
        """Return the instants within a track at which a prediction is due, s, shape (n,)."""
        first_s, last_s = track.first_step * recording.step_s, (track.first_step + len(track) - 1) * recording.step_s
        numbers = np.arange(np.ceil(first_s / self.decision_s - 1e-6), np.floor(last_s / self.decision_s + 1e-6) + 1)
        return np.asarray(np.round(numbers * self.decision_s, 9))


@dataclass(frozen=True)
class Stretch:
    """A TV that is sensed without interruption.

    start_s, end_s: first and last sensed instant, s of simulation time; sensing starts with the run-in of the filter.
    decision_s: ends of the predicted windows, s, (n,). uv: the UV of each window, "" if it has none, n of them.
    """

    tv: str
    start_s: float
    end_s: float
    decision_s: Array
    uv: tuple[str, ...]

    def part(self, start_s: float, end_s: float, before_decision_s: float) -> Stretch | None:
        """Return the part of the stretch within a span of time (s), or None if it holds no prediction.

        before_decision_s: how long a TV has to be sensed before a prediction, s.
        """
        kept = (self.decision_s >= start_s + before_decision_s - 1e-6) & (self.decision_s <= end_s + 1e-6)
        if not kept.any():
            return None
        times = self.decision_s[kept]
        uv = tuple(self.uv[k] for k in np.flatnonzero(kept))
        return Stretch(self.tv, start_s, float(times[-1]), times, uv)


@dataclass(frozen=True)
class WatchedStretches:
    """The stretches of a recording, and how much driving they leave out.

    stretches: those in which the TV has a UV. alone: those in which it has none, and could be predicted by itself.
    instants: number of due predictions of all vehicles. uncovered: how many of them are not in `stretches`, by reason.
    """

    stretches: tuple[Stretch, ...]
    alone: tuple[Stretch, ...]
    instants: int
    uncovered: Mapping[str, int]


def watched(recording: Recording, surroundings: Surroundings, pairs: PairSettings, timing: Timing) -> WatchedStretches:
    """Return the stretches of a recording, vehicle by vehicle."""
    stretches: list[Stretch] = []
    alone: list[Stretch] = []
    uncovered: Counter[str] = Counter()
    instants = 0
    for track in recording.tracks.values():
        times = timing.decisions(recording, track)
        instants += len(times)
        if not may_be_tv(track, pairs):
            uncovered[TV_KIND] += len(times)
            continue
        paired: list[tuple[float, str]] = []
        unpaired: list[tuple[float, str]] = []
        for time in times.tolist():
            uv, reason = _uv_at(surroundings, track.vehicle, time, pairs, timing)
            if uv is None:
                uncovered[reason] += 1
                if reason != TRACK_ENDS:
                    unpaired.append((time, ""))
            else:
                paired.append((time, uv))
        stretches += _joined(track.vehicle, paired, timing)
        alone += _joined(track.vehicle, unpaired, timing)
    return WatchedStretches(tuple(stretches), tuple(alone), instants, dict(uncovered))


def _uv_at(
    surroundings: Surroundings, tv: str, time: float, pairs: PairSettings, timing: Timing
) -> tuple[str | None, str]:
    """Return the UV of the window that ends at a time (s) and "", or None and the reason why there is none."""
    begin = time - timing.window_s
    after_s = max(timing.margin_s, timing.outcome_s)
    if not surroundings.has(tv, time - timing.before_decision_s - timing.margin_s, time + after_s):
        return None, TRACK_ENDS
    pair = choose_uv(surroundings, tv, begin + pairs.before_onset_s, pairs)
    if pair is None:
        return None, NO_UV
    reported = (begin - timing.report_delay_s - timing.margin_s, time - timing.report_delay_s + timing.margin_s)
    return (pair.uv, "") if surroundings.has(pair.uv, *reported) else (None, UV_ENDS)


def _joined(tv: str, paired: list[tuple[float, str]], timing: Timing) -> list[Stretch]:
    """Join the predictions of one TV to stretches. Sensing goes on through pauses shorter than a prediction needs."""
    stretches: list[Stretch] = []
    members: list[tuple[float, str]] = []
    for time, uv in paired:
        if members:
            pause = time - members[-1][0] > timing.before_decision_s
            too_long = time - members[0][0] > timing.longest_stretch_s - timing.before_decision_s
            if pause or too_long:
                stretches.append(_stretch(tv, members, timing))
                members = []
        members.append((time, uv))
    if members:
        stretches.append(_stretch(tv, members, timing))
    return stretches


def _stretch(tv: str, members: list[tuple[float, str]], timing: Timing) -> Stretch:
    times = np.array([time for time, _ in members])
    start_s = round(float(times[0]) - timing.before_decision_s, 9)
    return Stretch(tv, start_s, float(times[-1]), times, tuple(uv for _, uv in members))
