"""Adds moments with instructions to the replay of a closed loop. Their arms are driven again."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.feedback import Feedback
from isac_cosim.base.workers.engine import Engine
from isac_cosim.base.workers.threads import limited
from isac_cosim.evaluation.closed_loop.evaluation import ClosedLoopEvaluation
from isac_cosim.evaluation.closed_loop.store import FILES, ArmFacts, file_name
from isac_cosim.evaluation.report.replay.advised_again import AdvisedAgain
from isac_cosim.evaluation.report.replay.content import Moving, Replay
from isac_cosim.evaluation.report.replay.in_traffic import DIFFERS
from isac_cosim.evaluation.report.replay.kept import digest_of_arm, read_advised, write_advised
from isac_cosim.evaluation.report.replay.making import lanes_near
from isac_cosim.labeling.intentions import KNOWN

ARM = "isac"
"""The arm whose instructions are shown."""
MOST_ADVISED = 6
"""Moments on one page."""
MOST_SEEDS = 2
"""From which they are: the arm of each is driven again."""


@limited()
def with_instructions(
    replay: Replay | None, evaluation: ClosedLoopEvaluation, engine: Engine, feedback: Feedback, folder: Path
) -> Replay | None:
    """Return a replay with moments of the arm `isac` in which instructions were given; as it is where there is none.

    replay: of the open loop. engine: drives the arm again. What is then not the same, to the last bit, is left out, and
    a remark says so. folder: of the evaluation, which keeps what was simulated (`kept`).
    """
    task = evaluation.task
    try:
        scenario = task.source.load(task.where)
        chosen = _chosen(evaluation, scenario.name)
        again = AdvisedAgain(task, MOST_ADVISED // max(len(chosen), 1))
        found, reasons = _found(chosen, again, engine, feedback, folder)
    except (InputError, RunError) as error:
        feedback.message(f"warning: the page shows no instruction in motion: {error}")
        return replay
    names = {seed: f"{scenario.name}-{seed}, arm {ARM}" for seed in reasons}
    for seed, reason in sorted(reasons.items()):
        feedback.message(f"warning: the page shows no instruction of {names[seed]} in motion: {reason}")
    moments = [moving for seed in sorted(found) for moving in found[seed]]
    left_out = [f"Left out: {names[seed]}, {reasons[seed]}." for seed in sorted(reasons)]
    if replay is None:
        if not moments:
            return None
        replay = Replay(
            title=f"{evaluation.result.name} in running traffic: instructions to vehicles",
            records=[],
            lanes=[],
            sites=[(site.id, site.x, site.y, site.azimuth_deg) for site in scenario.sites],
            classes=[intention.text for intention in KNOWN],
            noun="moment",
        )
    records = [*replay.records, *moments]
    remarks = [*replay.remarks, *([_remark(moments)] if moments else []), *left_out]
    return replace(replay, records=records, lanes=lanes_near(scenario.lanes, records), remarks=remarks)


def _chosen(evaluation: ClosedLoopEvaluation, scenario: str) -> list[ArmFacts]:
    """Return the arm on the first seeds on which it sent something, those first on which a vehicle did as it was told.

    There is none where the arm was not run.
    """
    if ARM not in evaluation.result.arms:
        return []
    task = evaluation.task
    paths = (task.folder / file_name(scenario, seed, ARM) for seed in task.study.dataset.seeds)
    sent = [facts for facts in map(FILES.read_facts, paths) if facts is not None and facts.advisories]
    sent.sort(key=lambda facts: not any(one.fate == "followed" for one in facts.advisories))
    return sent[:MOST_SEEDS]


def _found(
    chosen: Sequence[ArmFacts], task: AdvisedAgain, engine: Engine, feedback: Feedback, folder: Path
) -> tuple[dict[int, list[Moving]], dict[int, str]]:
    """Return the moments of each seed, from the folder or driven again, and for the others why there is none."""
    digests, kept = {facts.seed: digest_of_arm(facts, task.most) for facts in chosen}, read_advised(folder)
    found = {seed: kept[digest] for seed, digest in digests.items() if digest in kept}
    missing, reasons = [facts for facts in chosen if facts.seed not in found], dict[int, str]()
    if not missing:
        return found, reasons
    with feedback.bar("driving with advisories again for the page", "arms") as move:
        move(0, len(missing))
        with closing(engine.run(task, missing)) as outcomes:
            for done, outcome in enumerate(outcomes, 1):
                if outcome.result is None:
                    reasons[outcome.item.seed] = outcome.error or DIFFERS
                else:
                    found[outcome.item.seed] = outcome.result
                move(done, len(missing))
    if found:
        write_advised(folder, {digests[seed]: moments for seed, moments in found.items()})
    return found, reasons


def _remark(moments: Sequence[Moving]) -> str:
    return (
        f"Instructions: {len(moments)} moments of the arm {ARM}, driven again for this page. A ring marks a vehicle "
        "that got one: solid while it follows it, dashed before and after. The traffic is that of the arm, and whether "
        "its alarms are right is not judged."
    )
