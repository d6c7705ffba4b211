"""One arm of one seed, in a worker process: simulated, watched, advised, and measured."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np

from isac_cosim.base import landlock
from isac_cosim.base.seeding import stream
from isac_cosim.base.workers.threads import limited
from isac_cosim.evaluation.closed_loop.advising import Sent
from isac_cosim.evaluation.closed_loop.crossings import crossings, joined
from isac_cosim.evaluation.closed_loop.loop import ClosedLoop, Decision
from isac_cosim.evaluation.closed_loop.policy import advisories
from isac_cosim.evaluation.closed_loop.safety import driving_of, encroachments
from isac_cosim.evaluation.closed_loop.settings import NOT_OF_A_SENSOR, Arm, ClosedLoopSettings
from isac_cosim.evaluation.closed_loop.store import (
    AdvisoryFacts,
    AlarmFacts,
    ArmEpisode,
    ArmFacts,
    digest_of,
    encroachment_facts,
    file_name,
    write_arm,
)
from isac_cosim.evaluation.in_traffic.alarms.background import BackgroundTrees
from isac_cosim.evaluation.in_traffic.alarms.stream import Alarm, AlarmStream, levelling
from isac_cosim.evaluation.in_traffic.settings import AlarmSettings, LiveStudy
from isac_cosim.evaluation.in_traffic.streams.predictions import run_answering
from isac_cosim.isacsim.scenarios.scenario import Scenario
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource, recorded
from isac_cosim.isacsim.traffic.sources.registry import running_source
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.inference import Infer


@dataclass(frozen=True)
class Alarming:
    """How alarms are raised in every arm: as chosen on the development seeds, and frozen.

    settings: None if no alarm could be chosen; then none is raised. background: for the method of that name.
    random_per_hour: alarms of the random arm per vehicle-hour, by intention.
    """

    settings: AlarmSettings | None
    background: BackgroundTrees | None
    random_per_hour: Mapping[str, float]


@dataclass(frozen=True)
class ArmTask:
    """Runs the arms of an evaluation; it is sent to worker processes.

    where: path or bundled name of the scenario. run: folder of the predictor. fingerprints: of what each arm rests on.
    folder: where episodes are written.
    """

    study: LiveStudy
    settings: ClosedLoopSettings
    source: MotionSource
    where: str
    run: Path
    alarming: Alarming
    fingerprints: Mapping[Arm, str]
    folder: Path

    @limited()
    def __call__(self, item: tuple[int, Arm]) -> str:
        """Run one arm and write it."""
        seed, arm = item
        scenario = self.source.load(self.where)
        infer = _load(self.run)
        # SUMO runs in between the other work, all of which is therefore kept from writing files.
        episode = landlock.confined(
            lambda: run_arm(self.study, self.settings, scenario, seed, arm, infer, self.alarming)
        )
        facts = episode.facts.model_copy(update={"fingerprint": self.fingerprints[arm]})
        write_arm(self.folder / file_name(scenario.name, seed, arm), ArmEpisode(facts, episode.driving))
        return arm


@lru_cache(maxsize=4)
def _load(path: Path) -> Infer:
    return Infer.load(path)


@dataclass(frozen=True)
class DrivenArm:
    """One arm of one seed as it was driven. predicted_hours: as in `ArmFacts`."""

    recording: Recording
    arm: Arm
    alarms: list[AlarmFacts] = field(default_factory=list)
    sent: list[Sent] = field(default_factory=list)
    predicted_hours: float = 0.0


def run_arm(
    study: LiveStudy,
    settings: ClosedLoopSettings,
    scenario: Scenario,
    seed: int,
    arm: Arm,
    infer: Infer,
    alarming: Alarming,
) -> ArmEpisode:
    """Simulate one arm of one seed, and measure it."""
    return measured(drive_arm(study, settings, scenario, seed, arm, infer, alarming))


def drive_arm(
    study: LiveStudy,
    settings: ClosedLoopSettings,
    scenario: Scenario,
    seed: int,
    arm: Arm,
    infer: Infer,
    alarming: Alarming,
    watch: Callable[[Decision], None] | None = None,
) -> DrivenArm:
    """Simulate one arm of one seed. watch: sees every decision, and changes none."""
    if arm == "none":
        return DrivenArm(recorded(running_source(study.dataset), scenario, seed), arm)
    silent = arm == "random" or alarming.settings is None
    answering = None if silent else run_answering(infer, study.live.background.lanes and not infer.run.is_of_streams)
    sensor = study.live.streams.sensor if arm in NOT_OF_A_SENSOR else arm
    loop = ClosedLoop.of(scenario, seed, study, settings, infer.run.card.shape, sensor, answering)
    source = _RandomAlarms(scenario, seed, alarming, study) if arm == "random" else _PredictedAlarms(alarming, study)
    alarms: list[AlarmFacts] = []
    predicted = 0
    decisions = loop.decisions()
    while True:
        try:
            decision = next(decisions)
        except StopIteration as stop:
            hours = predicted * study.live.streams.decision_s / 3600
            return DrivenArm(stop.value, arm, alarms, loop.advisor.sent, hours)
        if watch is not None:
            watch(decision)
        predicted += len(decision.knowledge.tv)
        for alarm in source.raised(decision):
            alarms.append(_facts(alarm, decision))
            if arm != "placebo":
                _send(alarm, decision, loop, settings)


def _send(alarm: Alarm, decision: Decision, loop: ClosedLoop, settings: ClosedLoopSettings) -> None:
    surroundings, pairs = decision.knowledge.surroundings, loop.study.dataset.pairs
    range_m, time_s = settings.advisories.range_m, decision.moment.time_s
    for advisory in advisories(alarm, surroundings, pairs, range_m, time_s):
        loop.advisor.send(advisory)


def _facts(alarm: Alarm, decision: Decision) -> AlarmFacts:
    track = decision.knowledge.surroundings.recording.tracks[alarm.tv]
    x, y = float(track.x[0]), float(track.y[0])
    return AlarmFacts(
        tv=alarm.tv,
        intention=alarm.intention,
        time_s=round(alarm.time_s, 6),
        raised_s=round(decision.moment.time_s, 6),
        x=round(x, 3),
        y=round(y, 3),
    )


class _PredictedAlarms:
    """Alarms by the predictor's answers."""

    def __init__(self, alarming: Alarming, study: LiveStudy) -> None:
        self._stream = None
        if alarming.settings is not None:
            levels = levelling(alarming.settings, alarming.background)
            self._stream = AlarmStream(alarming.settings, levels, study.live.streams.decision_s)

    def raised(self, decision: Decision) -> list[Alarm]:
        knowledge = decision.knowledge
        if self._stream is None or knowledge.answers is None:
            return []
        return self._stream.raised(knowledge.tv, knowledge.answers, knowledge.time_s)


class _RandomAlarms:
    """Alarms drawn for the TVs that could be predicted, by intention at a rate."""

    def __init__(self, scenario: Scenario, seed: int, alarming: Alarming, study: LiveStudy) -> None:
        decision_h = study.live.streams.decision_s / 3600
        self._rng = stream("random alarms", "closed loop", scenario.name, seed)
        self._chances = np.array([alarming.random_per_hour.get(known.text, 0.0) for known in KNOWN]) * decision_h

    def raised(self, decision: Decision) -> list[Alarm]:
        knowledge = decision.knowledge
        drawn = self._rng.random((len(knowledge.tv), len(KNOWN))) < self._chances
        return [Alarm(knowledge.tv[row], KNOWN[k].text, knowledge.time_s) for row, k in np.argwhere(drawn).tolist()]


def measured(driven: DrivenArm) -> ArmEpisode:
    """Measure an arm."""
    recording = driven.recording
    driving = driving_of(recording)
    facts = ArmFacts(
        fingerprint="",
        scenario=recording.scenario,
        seed=recording.seed,
        arm=driven.arm,
        traffic=digest_of(recording),
        vehicles=len(recording.tracks),
        collided=recording.incidents.collided,
        teleported=recording.incidents.teleported,
        predicted_hours=driven.predicted_hours,
        every_s=driving.every_s,
        alarms=tuple(driven.alarms),
        advisories=tuple(
            AdvisoryFacts(
                vehicle=item.advisory.vehicle,
                instruction=item.advisory.instruction,
                time_s=round(item.advisory.time_s, 6),
                fate=item.fate,
                begun_s=None if item.begun_s is None else round(item.begun_s, 6),
            )
            for item in driven.sent
        ),
        encroachments=encroachment_facts(joined(encroachments(recording), crossings(recording))),
    )
    return ArmEpisode(facts, driving)
