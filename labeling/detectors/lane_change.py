"""Lane changes to the left and to the right."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from typing import ClassVar

from pydantic import Field

from isac_cosim.base.settings import Settings
from isac_cosim.labeling.detectors.protocol import VehicleView
from isac_cosim.labeling.detectors.threshold_crossings import first_below, intervals_above
from isac_cosim.labeling.intentions import LANE_CHANGES, Event, Intention
from isac_cosim.labeling.road.road_motion import MarkingCrossing, RoadMotion


class LaneChangeSettings(Settings):
    """Thresholds of a lane change.

    UN R79 wants an automated lane change done within 5 s, at a lateral acceleration of up to 1 m/s2.
    """

    stay_s: float = Field(1.0, ge=0.0, le=10.0, description="minimum time that the centre stays across the marking, s")
    onset_mps: float = Field(0.2, gt=0.0, le=2.0, description="lateral speed of the first motion, m/s")
    pause_s: float = Field(0.5, ge=0.0, le=5.0, description="slower stretches of up to this length are bridged, s")


@dataclass(frozen=True)
class Crossings:
    """The marking crossings of one vehicle, sorted out.

    completed: those after which the centre stays across, in order. dithering: the number of others, which go back.
    cut_off: the number of those followed by the end of the track too soon to tell.
    """

    completed: list[MarkingCrossing]
    dithering: int
    cut_off: int


@dataclass(frozen=True)
class LaneChangeDetector:
    """Finds lane changes: the vehicle's centre crosses a lane marking and stays across it for at least `stay_s`.

    Each marking counts by itself. A move over two lanes is two changes; where the two are one motion, they are
    separated at the middle of the lane in between. A vehicle that crosses a marking and comes back within `stay_s` has
    not changed lanes (it dithered).

    onset: the lateral speed towards the marking exceeds `onset_mps`, traced back from the crossing over slower
    stretches of up to `pause_s`.
    commit: the centre crosses the marking.
    end: the lateral speed falls below `onset_mps` again.
    peak: the largest magnitude of the lateral acceleration, m/s2, positive for a change to the left.

    Fails where a driver drifts across at less than `onset_mps` (the onset is then the crossing), where lanes are not
    used as lanes (two-wheelers side by side), and where the lane itself forks or bends towards the next one, which is
    no motion across the lane.

    A vehicle moves one lane to the left, 3.2 m within four seconds:

    >>> from isac_cosim.labeling.detectors.protocol import vehicle_view
    >>> from isac_cosim.labeling.road.straight_road import ScriptedVehicle, straight_road
    >>> changing = ScriptedVehicle("tv", lateral=[(10, 0.0), (14, 3.2)])
    >>> [change] = LaneChangeDetector(LaneChangeSettings()).detect(vehicle_view(straight_road(changing), "tv"))
    >>> change.intention.text, round(change.onset, 1), round(change.commit, 1), round(change.end, 1)
    ('left_lane_change', 9.9, 12.0, 14.1)
    """

    settings_type: ClassVar[type[Settings]] = LaneChangeSettings
    finds: ClassVar[tuple[Intention, ...]] = LANE_CHANGES

    settings: LaneChangeSettings

    def detect(self, view: VehicleView) -> list[Event]:
        """Return the completed lane changes of one vehicle, in order of crossing."""
        motion = view.motion
        crossings = self.crossings(motion).completed
        events = [self._event(motion, crossing) for crossing in crossings]
        for k in range(1, len(crossings)):
            if crossings[k - 1].left == crossings[k].left and events[k].onset < crossings[k - 1].time:
                middle = _time_at_middle(motion, crossings[k - 1], crossings[k])
                events[k - 1] = replace(events[k - 1], end=middle)
                events[k] = replace(events[k], onset=middle)
        return events

    def crossings(self, motion: RoadMotion) -> Crossings:
        """Return the crossings of one vehicle, sorted out by whether its centre stayed across."""
        by_marking: dict[int, list[MarkingCrossing]] = defaultdict(list)
        for crossing in motion.crossings:
            by_marking[crossing.marking].append(crossing)
        completed: list[MarkingCrossing] = []
        cut_off = 0
        for crossings in by_marking.values():
            settled_left = not crossings[0].left
            stays_until = [crossing.time for crossing in crossings[1:]] + [motion.until]
            for crossing, stop in zip(crossings, stays_until, strict=True):
                if crossing.left == settled_left:
                    continue
                # Tolerates rounding in the difference of two times: a stay of exactly `stay_s` is long enough.
                if stop - crossing.time >= self.settings.stay_s - 1e-6:
                    settled_left = crossing.left
                    completed.append(crossing)
                elif stop == motion.until:
                    cut_off += 1
        dithering = len(motion.crossings) - len(completed) - cut_off
        return Crossings(sorted(completed, key=lambda crossing: crossing.time), dithering, cut_off)

    def _event(self, motion: RoadMotion, crossing: MarkingCrossing) -> Event:
        sign = 1.0 if crossing.left else -1.0
        onset, end = moving_span(motion, sign, crossing.time, self.settings.onset_mps, self.settings.pause_s)
        during = motion.aq[(motion.times >= onset) & (motion.times <= end)]
        peak = sign * float(abs(during).max(initial=0.0))
        intention = Intention.LEFT_LANE_CHANGE if crossing.left else Intention.RIGHT_LANE_CHANGE
        return Event(motion.vehicle, intention, onset, crossing.time, end, peak)


def _time_at_middle(motion: RoadMotion, first: MarkingCrossing, second: MarkingCrossing) -> float:
    """Return when the vehicle is laterally halfway between two crossings towards one side, s."""
    sign = 1.0 if first.left else -1.0
    halfway = sign * (first.at_m + second.at_m) / 2
    time = first_below(motion.times, -sign * motion.q, -halfway, first.time)
    return second.time if time is None else min(time, second.time)


def moving_span(motion: RoadMotion, sign: float, time: float, speed_mps: float, pause_s: float) -> tuple[float, float]:
    """Return when the lateral motion to one side that is under way at `time` begins and ends, s.

    sign: 1 for left, -1 for right. speed_mps: minimum lateral speed of the motion. pause_s: slower stretches of up to
    this length are bridged. Returns `time` twice where the vehicle does not move to that side then.
    """
    spans: list[tuple[float, float]] = []
    for start, stop in intervals_above(motion.times, sign * motion.vq, speed_mps):
        if spans and start - spans[-1][1] <= pause_s:
            start = spans.pop()[0]
        spans.append((start, stop))
    for start, stop in spans:
        if start - pause_s <= time <= stop + pause_s:
            return min(start, time), max(stop, time)
    return time, time
