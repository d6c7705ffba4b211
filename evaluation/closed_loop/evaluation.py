"""Evaluates a run in a closed loop: the open loop first, which chooses the alarms, then every arm of every seed.

DIR/                  as of the open loop (`evaluation.in_traffic.measurement.evaluation`)
DIR/arms.json         what the closed loop is, so that the same command continues it
DIR/arms/             one file for each seed and arm
DIR/metrics.json      both results; the same for any number of worker processes
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from isac_cosim.base.errors import InputError
from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.files import claim, write_json
from isac_cosim.base.settings import Settings, read_json
from isac_cosim.base.workers.engine import Engine, LocalEngine
from isac_cosim.base.workers.episodes import Episodes, begin_episodes, run_episodes
from isac_cosim.base.workers.threads import limited
from isac_cosim.evaluation.closed_loop.episode import Alarming, ArmTask
from isac_cosim.evaluation.closed_loop.loop import kernel_of
from isac_cosim.evaluation.closed_loop.results import ClosedLoopFacts, ClosedLoopLatency, ClosedLoopResult
from isac_cosim.evaluation.closed_loop.scoring import ALARMING, REFERENCE, arm_results
from isac_cosim.evaluation.closed_loop.settings import ARMS, Arm, ClosedLoopSettings
from isac_cosim.evaluation.closed_loop.store import FILES, ArmEpisode, file_name, read_arm
from isac_cosim.evaluation.in_traffic.alarms.background import TREES_FOLDER, BackgroundTrees, KeptTrees
from isac_cosim.evaluation.in_traffic.measurement.evaluation import STUDY_FILE, BegunEvaluation, evaluate_traffic
from isac_cosim.evaluation.in_traffic.measurement.measuring import truths_of
from isac_cosim.evaluation.in_traffic.measurement.summary import TrafficEvaluation
from isac_cosim.evaluation.in_traffic.scores.results import METRICS_FILE
from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.evaluation.in_traffic.streams import store as open_loop
from isac_cosim.evaluation.in_traffic.streams.store import EPISODES
from isac_cosim.isacsim.scenarios.scenario import resolved
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource
from isac_cosim.isacsim.traffic.sources.registry import running_source
from isac_cosim.labeling.generation.folder import fingerprint
from isac_cosim.labeling.intentions import KNOWN
from isac_cosim.models.runs.run import Run

ARMS_FILE, ARMS_FOLDER = "arms.json", "arms"


SCORED_AFTERWARDS = {"arms", "near_m", "after_s"}
"""The settings that an arm does not depend on."""


class BegunArms(Settings):
    """The content of ARMS_FILE. fingerprint: of earlier versions, which had one for all arms."""

    settings: ClosedLoopSettings
    fingerprint: str | None = None


@dataclass(frozen=True)
class ClosedLoopEvaluation:
    """A closed loop: its result, the open loop behind it, and what drives its arms."""

    result: ClosedLoopResult
    open_loop: TrafficEvaluation
    task: ArmTask


def evaluate_advisories(
    run: Run,
    study: LiveStudy,
    settings: ClosedLoopSettings,
    out: Path,
    engine: Engine | None = None,
    feedback: Feedback = SILENT,
    against: Sequence[Run] = (),
    source: MotionSource | None = None,
    alone: Run | None = None,
) -> ClosedLoopEvaluation:
    """Evaluate a run in the open loop and in a closed one, or finish what was begun, and write `metrics.json`.

    The arms `none` and `placebo` are always run: the one is what the others are compared with, the other says what is
    scored. Arguments as in `evaluate_traffic`.
    Raises InputError if the source only has recordings, `out` holds something else, or settings do not fit, RunError if
    an episode fails.
    """
    source = source or running_source(study.dataset)
    engine = engine or LocalEngine(1)
    _check_settings(out, settings)
    opened = evaluate_traffic(run, study, out, engine, feedback, against, source, alone)
    study = opened.result.made_by.study
    where = resolved(study.dataset.scenarios[0])
    scenario = source.load(where).name
    chosen = dict.fromkeys((REFERENCE, ALARMING, *settings.arms))
    arms = [*(arm for arm in ARMS if arm in chosen), *(arm for arm in chosen if arm not in ARMS)]
    settings = settings.model_copy(update={"arms": tuple(arms)})
    begun = read_json(BegunEvaluation, out / STUDY_FILE)
    assert begun is not None, "the open loop marks its folder"
    with claim(out, STUDY_FILE, "evaluation in traffic"):
        begin_episodes(out / ARMS_FILE, BegunArms(settings=settings), out / ARMS_FOLDER)
        alarming = alarming_of(opened, study, scenario, out)
        digests = _fingerprints(begun, settings, alarming)
        task = ArmTask(
            study, settings, source, where, run.path.resolve(), alarming, digests, (out / ARMS_FOLDER).resolve()
        )
        items = [(seed, arm) for seed in study.dataset.seeds for arm in arms]
        _run_arms(task, scenario, items, engine, feedback)
        result = _result(opened, study, settings, scenario, out)
        write_json(out / METRICS_FILE, result.model_dump(mode="json"))
    for line in warnings(result):
        feedback.message(line)
    return ClosedLoopEvaluation(result, opened, task)


@limited()
def alarming_of(opened: TrafficEvaluation, study: LiveStudy, scenario: str, out: Path) -> Alarming:
    """Return how the closed loop raises alarms: as the open loop chose on the development seeds.

    Alarms of the random arm come as often as the open loop raised alarms on the measured seeds.
    """
    settings, background = opened.result.alarms, None
    if settings is not None and settings.method == "background":
        live = study.live
        paths = [out / EPISODES / open_loop.file_name(scenario, seed) for seed in study.development]
        read = [open_loop.read_episode(path, features=True) for path in paths]
        episodes = [truth.episode for truth in truths_of(read, live.scoring)]
        kept = KeptTrees(out / TREES_FOLDER)
        background = BackgroundTrees.fit(episodes, live.background, live.scoring.before_onset_s, kept=kept)
    rates = dict.fromkeys([known.text for known in KNOWN], 0.0)
    if settings is not None and opened.result.vehicle_hours:
        first = next(iter(opened.methods.values()))
        for alarms in first.alarms:
            for k in alarms.intention.tolist():
                rates[KNOWN[k].text] += 1.0 / opened.result.vehicle_hours
    return Alarming(settings, background, rates)


def _check_settings(out: Path, settings: ClosedLoopSettings) -> None:
    """Raise InputError if a folder holds a closed loop with other settings."""
    before = read_json(BegunArms, out / ARMS_FILE)
    if before is None:
        return
    if before.settings.model_dump(exclude=SCORED_AFTERWARDS) != settings.model_dump(exclude=SCORED_AFTERWARDS):
        raise InputError(f"{out}: holds a closed loop with other settings; choose a new folder")


def _fingerprints(begun: BegunEvaluation, settings: ClosedLoopSettings, alarming: Alarming) -> dict[Arm, str]:
    """Return a digest of what each arm rests on: where it changes, the arm is driven again.

    `none` rests on the traffic, `random` on the rates of alarms too, and the others on how alarms are chosen.
    """
    base = fingerprint(begun.fingerprint, settings.model_dump(mode="json", exclude=SCORED_AFTERWARDS))
    study = begun.study
    chosen = None if alarming.settings is None else alarming.settings.model_dump(mode="json")
    background = (
        None if alarming.background is None else study.live.model_dump(mode="json", include={"background", "scoring"})
    )
    raised = fingerprint(base, chosen, background, study.development.model_dump(mode="json"))
    special = {"none": base, "random": fingerprint(base, dict(alarming.random_per_hour))}
    return {arm: special.get(arm, raised) for arm in settings.arms}


def _run_arms(
    task: ArmTask, scenario: str, items: Sequence[tuple[int, Arm]], engine: Engine, feedback: Feedback
) -> None:
    """Run the arms that have no file yet."""

    def finished(item: tuple[int, Arm]) -> bool:
        facts = FILES.read_facts(task.folder / file_name(scenario, *item))
        return facts is not None and facts.fingerprint == task.fingerprints[item[1]]

    arms = Episodes(items, finished, "driving with advisories", "arms", lambda item: f"seed {item[0]}, arm {item[1]}")
    run_episodes(task, arms, engine, feedback)


@limited()
def _result(
    opened: TrafficEvaluation, study: LiveStudy, settings: ClosedLoopSettings, scenario: str, out: Path
) -> ClosedLoopResult:
    """Score the arms and put the result together."""
    episodes: dict[Arm, list[ArmEpisode]] = {
        arm: [read_arm(out / ARMS_FOLDER / file_name(scenario, seed, arm)) for seed in study.dataset.seeds]
        for arm in settings.arms
    }
    arms, hours = arm_results(episodes, settings, study.live.streams.sensor)
    pairs = zip(episodes[REFERENCE], episodes[ALARMING], strict=True)
    latency = ClosedLoopLatency(
        sensing_s=round(kernel_of(study, settings).age_s, 6),
        network_s=settings.advisories.network_delay_s,
        reaction_s=settings.advisories.reaction_s,
    )
    facts = ClosedLoopFacts(
        settings=settings,
        latency=latency,
        scored_vehicle_hours=hours,
        placebo_equals_none=all(none.facts.traffic == placebo.facts.traffic for none, placebo in pairs),
        seeds=len(study.dataset.seeds),
    )
    return ClosedLoopResult(**dict(opened.result), arms=arms, closed_loop=facts)


def warnings(result: ClosedLoopResult) -> list[str]:
    """Return what a reader of the arms should know, a line each."""
    lines = []
    facts = result.closed_loop
    if not facts.placebo_equals_none:
        lines.append("warning: sensing without sending changed the traffic; the differences between arms mean nothing")
    if not result.arms[ALARMING].alarms:
        lines.append(
            "warning: the placebo arm raised no alarm, so nothing is scored; simulate longer, more seeds, or connect "
            "more vehicles"
        )
    elif not any(arm.advisories for arm in result.arms.values()):
        lines.append(
            "warning: no advisory was sent: no connected vehicle was near a TV with an alarm; all arms are equal"
        )
    if facts.seeds < 3:
        lines.append(f"warning: {facts.seeds} measured seeds: intervals need at least 3 to mean anything")
    return lines
