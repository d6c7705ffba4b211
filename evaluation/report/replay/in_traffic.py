"""Makes a replay of the worst moments of an evaluation in traffic. Their episodes are simulated and sensed again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.workers.engine import Engine
from isac_cosim.base.workers.threads import limited
from isac_cosim.evaluation.in_traffic.alarms.alarms import Alarms
from isac_cosim.evaluation.in_traffic.measurement.summary import TrafficEvaluation
from isac_cosim.evaluation.in_traffic.scores.scoring import Truth
from isac_cosim.evaluation.in_traffic.streams.store import EpisodeFacts, LiveEpisode
from isac_cosim.evaluation.report.replay.again import Again, Seen, Wanted
from isac_cosim.evaluation.report.replay.content import RATE_HZ, AnswersAlong, Moving, Replay
from isac_cosim.evaluation.report.replay.kept import digest_of, read_kept, write_kept
from isac_cosim.evaluation.report.replay.making import lanes_near
from isac_cosim.evaluation.report.replay.moments import (
    Mistake,
    alarms_within,
    answers_around,
    maneuvers_within,
    rows_of,
    worst_moments,
)
from isac_cosim.isacsim.scenarios.scenario import resolved
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.intentions import KNOWN, spoken
from isac_cosim.labeling.streams.events import GROUPS

DIFFERS = "its traffic is not the same when it is simulated again"


@limited()
def replay_in_traffic(
    evaluation: TrafficEvaluation,
    engine: Engine,
    feedback: Feedback = SILENT,
    source: MotionSource | None = None,
    folder: Path | None = None,
) -> Replay | None:
    """Return the replay of the worst false alarms and missed maneuvers of an evaluation; None where there is none.

    engine: simulates their episodes again. What then differs is left out, and a remark says so. source: of motion; by
    default, the one that the study names. folder: of the evaluation, which keeps what was simulated (`kept`).
    """
    result, measured = evaluation.result, next(iter(evaluation.methods.values()), None)
    by_episode: dict[int, list[Mistake]] = {}
    for moment in [] if measured is None else worst_moments(evaluation.truths, measured):
        by_episode.setdefault(moment.episode, []).append(moment)
    if measured is None or not by_episode:
        return None
    study, episodes = result.made_by.study, {k: evaluation.truths[k].episode for k in by_episode}
    items = {k: (one.facts, [_wanted(one, moment) for moment in by_episode[k]]) for k, one in episodes.items()}
    try:
        source = source or motion_source(study.dataset)
        where = resolved(study.dataset.scenarios[0])
        scenario = source.load(where)
        found, reasons = _found(items, Again(study, source, where, result.made_by.run.shape), engine, feedback, folder)
    except (InputError, RunError) as error:
        feedback.message(f"warning: the page shows no moment of the traffic in motion: {error}")
        return None
    for k, reason in sorted(reasons.items()):
        feedback.message(f"warning: the page shows no moment of {_name(episodes[k])} in motion: {reason}")
    seen = {one: how for k, of_episode in found.items() for one, how in zip(by_episode[k], of_episode, strict=True)}
    moments = sorted(seen, key=lambda moment: (moment.missed, moment.rank))
    if not moments:
        return None
    truths, alarms = evaluation.truths, measured.alarms
    records = [_moving(one, seen[one], truths[one.episode], alarms[one.episode]) for one in moments]
    return Replay(
        title=f"{result.name} in running traffic: its worst false alarms and misses",
        records=records,
        lanes=lanes_near(scenario.lanes, records),
        sites=[(site.id, site.x, site.y, site.azimuth_deg) for site in scenario.sites],
        classes=[intention.text for intention in KNOWN],
        remarks=[_remark(moments, len(truths)), *(f"Left out: {_name(episodes[k])}, {reasons[k]}." for k in reasons)],
        noun="moment",
    )


def _found(
    items: Mapping[int, tuple[EpisodeFacts, Sequence[Wanted]]],
    task: Again,
    engine: Engine,
    feedback: Feedback,
    folder: Path | None,
) -> tuple[dict[int, list[Seen]], dict[int, str]]:
    """Return how the wanted TVs of each episode move, and of the others why that is not known.

    What the folder keeps is taken from there; what had to be simulated is kept in it afterwards.
    """
    digests = {k: digest_of(*item) for k, item in items.items()}
    kept = read_kept(folder)
    found = {k: kept[digests[k]] for k, (_, tvs) in items.items() if len(kept.get(digests[k], ())) == len(tvs)}
    missing = {item[0].seed: k for k, item in items.items() if k not in found}
    if not missing:
        return found, {}
    reasons = dict[int, str]()
    with feedback.bar("simulating episodes again for the page", "episodes") as move:
        move(0, len(missing))
        with closing(engine.run(task, [items[k] for k in missing.values()])) as outcomes:
            for done, outcome in enumerate(outcomes, 1):
                k = missing[outcome.item[0].seed]
                if outcome.result is None:
                    reasons[k] = outcome.error or DIFFERS
                else:
                    found[k] = outcome.result
                move(done, len(missing))
    if folder is not None and found:
        write_kept(folder, {digests[k]: seen for k, seen in found.items()})
    return found, reasons


def _remark(moments: Sequence[Mistake], measured: int) -> str:
    missed = sum(moment.missed for moment in moments)
    episodes = len({moment.episode for moment in moments})
    return (
        f"False alarms: {len(moments) - missed}, missed maneuvers: {missed}, from {episodes} of {measured} measured "
        "episodes, simulated again for this page. The predictor was surest of these alarms, and gave these maneuvers "
        "the least probability before their commit. Alarms are those chosen for all six intentions."
    )


def _name(episode: LiveEpisode) -> str:
    return f"{episode.facts.scenario}-{episode.facts.seed}"


def _wanted(episode: LiveEpisode, moment: Mistake) -> Wanted:
    from_s, to_s = moment.span_s
    decided = episode.time_s[rows_of(episode, moment.tv, from_s, to_s)]
    return Wanted(episode.names[moment.tv], from_s, to_s, float(decided[_nearest(decided, moment.time_s)]), decided)


def _nearest(times: Array, time_s: float) -> int:
    return int(np.abs(times - time_s).argmin())


def _moving(moment: Mistake, seen: Seen, truth: Truth, alarms: Alarms) -> Moving:
    """Return a moment as it is replayed."""
    episode, start_s = truth.episode, seen.start_s
    end_s = start_s + (seen.truth.shape[1] - 1) / RATE_HZ
    first_s, probabilities = answers_around(episode, moment.tv, moment.time_s, start_s, end_s)
    rows = np.flatnonzero(episode.vehicle == moment.tv)
    origin = GROUPS[int(episode.group[rows[_nearest(episode.time_s[rows], moment.time_s)]])]
    tv, what, probability = episode.names[moment.tv], spoken(KNOWN[moment.intention].text), moment.probability
    at = f"{_name(episode)} at {moment.time_s:.1f} s"
    if moment.missed:
        name, happened = "Missed", f"No alarm came for its {what}: probability {probability:.2f} at most."
    else:
        name, happened = (
            "False alarm",
            f"The alarm for {what} belongs to no such maneuver: probability {probability:.2f}.",
        )
    return Moving(
        id=f"{_name(episode)}-{tv}-{moment.time_s:.1f}",
        intention=KNOWN[moment.intention].text,
        origin=origin,
        tv_id=tv,
        uv_id=seen.uv,
        start_s=start_s,
        maneuvers=maneuvers_within(episode.facts.events, tv, start_s, end_s),
        truth=seen.truth,
        sensed=seen.sensed,
        uv=seen.uv_path,
        sizes=seen.around.sizes,
        others=seen.around.others,
        answers=AnswersAlong(first_s - start_s, episode.facts.decision_s, probabilities.astype(np.float64), None, True),
        alarms=alarms_within(truth, alarms, moment.tv, start_s, end_s),
        sensed_from_s=seen.sensed_from_s,
        uv_from_s=seen.uv_from_s,
        name=f"{name}: {what}, {at}",
        about=f"TV {tv}, UV {seen.uv}, {at} ({origin}). {happened}",
    )
