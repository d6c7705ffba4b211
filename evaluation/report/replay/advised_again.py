"""Simulates an arm of a closed loop again, and makes moments of the instructions that were given in it."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from isac_cosim.base import landlock
from isac_cosim.base.arrays import Array, IntArray
from isac_cosim.base.workers.threads import limited
from isac_cosim.evaluation.closed_loop.advising import Fate, Sent
from isac_cosim.evaluation.closed_loop.episode import ArmTask, DrivenArm, drive_arm, measured
from isac_cosim.evaluation.closed_loop.loop import Decision
from isac_cosim.evaluation.closed_loop.policy import Instruction
from isac_cosim.evaluation.closed_loop.store import ArmFacts
from isac_cosim.evaluation.in_traffic.alarms import stream
from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.evaluation.report.replay.again import driven
from isac_cosim.evaluation.report.replay.content import AnswersAlong, Moving, ShownAlarm, Told
from isac_cosim.evaluation.report.replay.moments import AFTER_S, BEFORE_S, LONGEST_S, maneuvers_within
from isac_cosim.evaluation.report.replay.others import around_path
from isac_cosim.labeling.detectors.events import label
from isac_cosim.labeling.intentions import spoken
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.streams.events import GROUPS, LiveEvent, events_of, groups_at
from isac_cosim.models.inference import Infer

SAYS: dict[Instruction, str] = {"open_gap": "open the gap", "slow": "slow down", "hold_lane": "hold the lane"}
"""What instructions ask for."""
BECAME: dict[Fate, str] = {
    "followed": "followed to its end",
    "refused": "ignored by the driver",
    "busy": "not taken up, for another instruction or command at or just before that time",
    "dropped": "dropped for a reaction of the driver's own",
    "gone": "ended because the vehicle left",
    "pending": "under way when the simulation ended",
}


@dataclass
class _Watch:
    """What the network knew of each TV, decision by decision: when, s, which UV, place, m, and probabilities."""

    time_s: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    uv: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))
    place: dict[str, list[Array]] = field(default_factory=lambda: defaultdict(list))
    probabilities: dict[str, list[Array]] = field(default_factory=lambda: defaultdict(list))

    def __call__(self, decision: Decision) -> None:
        knowledge = decision.knowledge
        if knowledge.answers is None:
            return
        for row, (tv, uv) in enumerate(zip(knowledge.tv, knowledge.uv, strict=True)):
            self.time_s[tv].append(knowledge.time_s)
            self.uv[tv].append(uv)
            self.place[tv].append(knowledge.windows[0][row, :2, -1].copy())
            self.probabilities[tv].append(knowledge.answers.probabilities[row].astype(np.float64))


@dataclass(frozen=True)
class AdvisedAgain:
    """Drives an arm again, in worker processes. most: moments of one seed."""

    arms: ArmTask
    most: int

    @limited()
    def __call__(self, stored: ArmFacts) -> list[Moving] | None:
        """Return moments of an arm with instructions; None where it is not driven as it is stored, to the last bit."""
        arms, watch = self.arms, _Watch()
        scenario, infer = arms.source.load(arms.where), Infer.load(arms.run)
        arm = landlock.confined(
            lambda: drive_arm(arms.study, arms.settings, scenario, stored.seed, stored.arm, infer, arms.alarming, watch)
        )
        if measured(arm).facts.model_copy(update={"fingerprint": stored.fingerprint}) != stored:
            return None
        return _Moments(arms.study, arm, watch, _events(arms.study, arm, watch)).found(self.most)


def _events(study: LiveStudy, arm: DrivenArm, watch: _Watch) -> list[LiveEvent]:
    surroundings = Surroundings(arm.recording)
    labels = label(arm.recording, study.dataset.labels, surroundings, study.live.near_misses)
    decisions = {tv: np.array(times) for tv, times in watch.time_s.items()}
    return events_of(surroundings, labels, study.dataset, decisions, study.live.streams.decision_s)


@dataclass(frozen=True)
class _Moments:
    """The moments of an arm."""

    study: LiveStudy
    arm: DrivenArm
    watch: _Watch
    events: Sequence[LiveEvent]

    def found(self, most: int) -> list[Moving]:
        """Return the first moments by `_ranked` whose vehicles have states, by time; those of a TV do not overlap."""
        kept = list[tuple[stream.Alarm, Moving]]()
        for alarm, sent in _ranked(self.arm.sent):
            near = (one for one, _ in kept if one.tv == alarm.tv)
            if len(kept) < most and all(abs(one.time_s - alarm.time_s) >= LONGEST_S for one in near):
                moving = self._moving(alarm, sent)
                kept += [] if moving is None else [(alarm, moving)]
        return [moving for _, moving in sorted(kept, key=lambda pair: pair[0].time_s)]

    def _moving(self, alarm: stream.Alarm, sent: Sequence[Sent]) -> Moving | None:
        recording, motion, tv = self.arm.recording, self.study.dataset.motion, alarm.tv
        known_s = np.array(self.watch.time_s[tv])
        at = int(np.abs(known_s - alarm.time_s).argmin())
        uv = self.watch.uv[tv][at]
        if not {tv, uv} <= recording.tracks.keys():  # One that collides has no states.
            return None
        sent_s = sent[0].advisory.time_s
        ended_s = max([sent_s, *(one.ended_s for one in sent if one.ended_s is not None)])
        span_s = sent_s - BEFORE_S, min(ended_s + AFTER_S, sent_s - BEFORE_S + LONGEST_S)
        times, truth = driven(recording, tv, *span_s, motion)
        uv_times, uv_path = driven(recording, uv, float(times[0]), float(times[-1]), motion)
        rows = self._rows_around(known_s, at, times)
        inside = times[(times >= known_s[rows[0]]) & (times <= known_s[rows[-1]])]
        if not len(inside) or not len(uv_times):
            return None
        start_s, end_s = float(times[0]), float(times[-1])
        places = np.stack([self.watch.place[tv][row] for row in rows], axis=1)
        around = around_path(recording, (tv, uv), times, truth, motion)
        told = self._told(sent, {tv, uv, *(other.id for other in around.others)}, start_s, end_s)
        name = f"{recording.scenario}-{recording.seed}"
        said = list(dict.fromkeys(SAYS[one.advisory.instruction] for one in sent))
        return Moving(
            id=f"{name}-{self.arm.arm}-{tv}-{sent_s:.1f}",
            intention=alarm.intention,
            origin=GROUPS[int(groups_at(recording, tv, np.array([alarm.time_s]))[0])],
            tv_id=tv,
            uv_id=uv,
            start_s=start_s,
            maneuvers=maneuvers_within(self.events, tv, start_s, end_s),
            truth=truth,
            sensed=np.stack([np.interp(inside, known_s[rows], axis) for axis in places]),
            uv=uv_path,
            sizes=around.sizes,
            others=around.others,
            answers=AnswersAlong(
                float(known_s[rows[0]]) - start_s,
                self.study.live.streams.decision_s,
                np.stack([self.watch.probabilities[tv][row] for row in rows]),
                None,
                None,
            ),
            alarms=[
                ShownAlarm(one.intention, one.time_s - start_s, None)
                for one in self.arm.alarms
                if one.tv == tv and start_s <= one.time_s <= end_s
            ],
            sensed_from_s=float(inside[0]) - start_s,
            uv_from_s=float(uv_times[0]) - start_s,
            name=f"Instruction: {', '.join(said)}, on an alarm for {spoken(alarm.intention)}, {name} at {sent_s:.1f} s",
            about=f"TV {tv}, UV {uv}, {name}, arm {self.arm.arm}, from {start_s:.1f} s of the simulation. Alarm for "
            f"{spoken(alarm.intention)} on the window that ends at {alarm.time_s - start_s:.1f} s. "
            + " ".join(_sentence(one) for one in told),
            told=told,
        )

    def _rows_around(self, known_s: Array, at: int, times: Array) -> IntArray:
        """Return which answers within a span of times, s, belong to one pause-free stretch with the one `at`."""
        stretch = np.cumsum(np.diff(known_s, prepend=known_s[0]) > 1.5 * self.study.live.streams.decision_s)
        inside = (known_s >= times[0] - 1e-9) & (known_s <= times[-1] + 1e-9)
        return np.flatnonzero(inside & (stretch == stretch[at]))

    def _told(self, own: Sequence[Sent], shown: set[str], start_s: float, end_s: float) -> list[Told]:
        """Return the instructions on the moment's alarm, and others that shown vehicles follow meanwhile."""

        def wanted(one: Sent) -> bool:
            begun_s, ended_s = one.begun_s, one.ended_s
            follows = begun_s is not None and begun_s <= end_s and (ended_s is None or ended_s >= start_s)
            return any(one is mine for mine in own) or (follows and one.advisory.vehicle in shown)

        return [_as_told(one, start_s) for one in self.arm.sent if wanted(one)]


def _as_told(sent: Sent, start_s: float) -> Told:
    advisory, alarm = sent.advisory, sent.advisory.alarm
    assert alarm is not None, "the network tells nothing without an alarm"
    return Told(
        vehicle=advisory.vehicle,
        says=SAYS[advisory.instruction],
        alarm=f"{spoken(alarm.intention)} of {alarm.tv}",
        sent_s=round(advisory.time_s - start_s, 3),
        begun_s=None if sent.begun_s is None else round(sent.begun_s - start_s, 3),
        ended_s=None if sent.ended_s is None else round(sent.ended_s - start_s, 3),
        fate=BECAME[sent.fate],
    )


def _sentence(told: Told) -> str:
    if told.begun_s is None:
        followed = ""
    elif told.ended_s is None:
        followed = f" from {told.begun_s:.1f} s on,"
    else:
        followed = f" from {told.begun_s:.1f} to {told.ended_s:.1f} s,"
    does = f"does so{followed}" if followed else "does not begin,"
    return (
        f"On the alarm for {told.alarm}, vehicle {told.vehicle} is told at {told.sent_s:.1f} s to {told.says}, and "
        f"{does} {told.fate}."
    )


def _ranked(sent: Iterable[Sent]) -> Iterator[tuple[stream.Alarm, list[Sent]]]:
    """Yield each alarm on which instructions were sent, and these.

    Alarms that made a vehicle do something come first, and among them the first one for each intention.
    """
    groups = defaultdict[stream.Alarm, list[Sent]](list)
    for one in sent:
        if one.advisory.alarm is not None:
            groups[one.advisory.alarm].append(one)
    before, ranks = Counter[tuple[bool, str]](), dict[stream.Alarm, tuple[bool, int, float]]()
    for alarm, of_alarm in groups.items():
        idle = all(one.begun_s is None for one in of_alarm)
        ranks[alarm] = idle, before[idle, alarm.intention], alarm.time_s
        before[idle, alarm.intention] += 1
    yield from ((alarm, groups[alarm]) for alarm in sorted(groups, key=ranks.__getitem__))
