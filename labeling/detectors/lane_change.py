"""Lane changes to the left and to the right."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace

from pydantic import Field

from isacsim.settings import Settings
from labeling.detectors.threshold_crossings import first_below, spells
from labeling.intentions import Event, Intention
from labeling.road.road_motion import Crossing, RoadMotion


class LaneChangeSettings(Settings):
    """What counts as a change. UN R79 has an automated one done within 5 s at a lateral acceleration up to 1 m/s2."""

    stay_s: float = Field(1.0, ge=0.0, le=10.0, description="how long the centre stays across the marking, s")
    onset_mps: float = Field(0.2, gt=0.0, le=2.0, description="lateral speed of the first motion, m/s")
    pause_s: float = Field(0.5, ge=0.0, le=5.0, description="slower stretches up to this long do not end the motion, s")


@dataclass(frozen=True)
class Crossings:
    """completed: after which the centre stays across, in order. dithering: how many others there were.

    cut_off: how many were followed by the track's end before they could be told.
    """

    completed: list[Crossing]
    dithering: int
    cut_off: int


@dataclass(frozen=True)
class LaneChange:
    """The vehicle's centre crosses a lane marking and stays across it for at least `stay_s`.

    Each marking is looked at by itself: a move over two lanes is two changes, and a vehicle that pokes across for less
    than `stay_s` and comes back made none (it dithered). Where two are one motion, the middle of the lane between
    parts them.
    onset: the lateral speed passes `onset_mps`, traced back from the crossing; commit: the centre crosses;
    end: the lateral speed is under `onset_mps` again. peak: the greatest size of the lateral acceleration, m/s2,
    positive for a change to the left.
    Fails where: a driver drifts over at less than `onset_mps` (onset is then the crossing); lanes are not modelled as
    lanes (two-wheelers side by side); a lane's own bend or a fork is used to change, which is no motion across the
    lane.
    """

    settings: LaneChangeSettings

    def detect(self, motion: RoadMotion) -> list[Event]:
        """The lane changes of one vehicle, in order of crossing."""
        done = self.crossings(motion).completed
        events = [self._event(motion, crossing) for crossing in done]
        for k in range(1, len(done)):
            if done[k - 1].left == done[k].left and events[k].onset < done[k - 1].time:
                turn = _middle(motion, done[k - 1], done[k])
                events[k - 1] = replace(events[k - 1], end=turn)
                events[k] = replace(events[k], onset=turn)
        return events

    def crossings(self, motion: RoadMotion) -> Crossings:
        """The crossings of one vehicle, told apart by whether its centre stayed across."""
        of_marking: dict[int, list[Crossing]] = defaultdict(list)
        for crossing in motion.crossings:
            of_marking[crossing.marking].append(crossing)
        completed: list[Crossing] = []
        cut_off = 0
        for crossings in of_marking.values():
            settled_left = not crossings[0].left
            until = [crossing.time for crossing in crossings[1:]] + [motion.until]
            for crossing, stop in zip(crossings, until, strict=True):
                if crossing.left == settled_left:
                    continue
                # A stay of exactly that long is one, whatever rounding makes of the difference of two times.
                if stop - crossing.time >= self.settings.stay_s - 1e-6:
                    settled_left = crossing.left
                    completed.append(crossing)
                elif stop == motion.until:
                    cut_off += 1
        dithering = len(motion.crossings) - len(completed) - cut_off
        return Crossings(sorted(completed, key=lambda crossing: crossing.time), dithering, cut_off)

    def _event(self, motion: RoadMotion, crossing: Crossing) -> Event:
        sign = 1.0 if crossing.left else -1.0
        onset, end = moving_span(motion, sign, crossing.time, self.settings.onset_mps, self.settings.pause_s)
        during = motion.aq[(motion.times >= onset) & (motion.times <= end)]
        peak = sign * float(abs(during).max(initial=0.0))
        intention = Intention.LEFT_LANE_CHANGE if crossing.left else Intention.RIGHT_LANE_CHANGE
        return Event(motion.vehicle, intention, onset, crossing.time, end, peak)


def _middle(motion: RoadMotion, first: Crossing, second: Crossing) -> float:
    """When a vehicle is halfway, across the lane, between two crossings to one side, s."""
    sign = 1.0 if first.left else -1.0
    halfway = sign * (first.at_m + second.at_m) / 2
    there = first_below(motion.times, -sign * motion.q, -halfway, first.time)
    return second.time if there is None else min(there, second.time)


def moving_span(motion: RoadMotion, sign: float, time: float, speed_mps: float, pause_s: float) -> tuple[float, float]:
    """When the lateral motion to one side that is under way at an instant began and ends, s.

    sign: 1 left, -1 right. The motion goes on through stretches slower than speed_mps of up to pause_s.
    Returns the instant itself twice where the vehicle does not move to that side then.
    """
    moving: list[tuple[float, float]] = []
    for start, stop in spells(motion.times, sign * motion.vq, speed_mps):
        if moving and start - moving[-1][1] <= pause_s:
            start = moving.pop()[0]
        moving.append((start, stop))
    for start, stop in moving:
        if start - pause_s <= time <= stop + pause_s:
            return min(start, time), max(stop, time)
    return time, time
