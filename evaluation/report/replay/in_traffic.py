"""Makes a replay of the worst moments of an evaluation in traffic. Their episodes are simulated and sensed again."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.base.errors import InputError, RunError
from isac_cosim.base.feedback import SILENT, Feedback
from isac_cosim.base.workers.engine import Engine
from isac_cosim.base.workers.threads import limited
from isac_cosim.evaluation.in_traffic.alarms.alarms import Alarms
from isac_cosim.evaluation.in_traffic.measurement.summary import TrafficEvaluation
from isac_cosim.evaluation.in_traffic.scores.scoring import Truth
from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.evaluation.in_traffic.streams.episode import timing_of
from isac_cosim.evaluation.in_traffic.streams.store import EpisodeFacts, LiveEpisode
from isac_cosim.evaluation.report.replay.content import RATE_HZ, Answers, Moving, Replay
from isac_cosim.evaluation.report.replay.making import lanes_near
from isac_cosim.evaluation.report.replay.moments import (
    Moment,
    alarms_within,
    answers_around,
    maneuvers_within,
    rows_of,
    worst_moments,
)
from isac_cosim.evaluation.report.replay.others import Around, around_path
from isac_cosim.isacsim.scenarios.scenario import resolved
from isac_cosim.isacsim.traffic.motion import MotionSettings, states
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource, recorded
from isac_cosim.isacsim.traffic.sources.registry import motion_source
from isac_cosim.labeling.generation.watching import watch_episode
from isac_cosim.labeling.intentions import KNOWN, spoken
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.streams.events import GROUPS
from isac_cosim.labeling.streams.sensed import StretchSensing
from isac_cosim.labeling.streams.stretches import Stretch, watched
from isac_cosim.models.predictors.protocol import WindowShape

DIFFERS = "its traffic is not the same when it is simulated again"


@dataclass(frozen=True)
class Wanted:
    """A TV to be shown. Times in s of simulation time; at_s: end of an answered window, decided_s: of all of them."""

    tv: str
    from_s: float
    to_s: float
    at_s: float
    decided_s: Array


@dataclass(frozen=True)
class Seen:
    """How a moment moves. start_s: s of simulation time. Paths as in `content.Moving`."""

    uv: str
    start_s: float
    truth: Array
    sensed: Array
    sensed_from_s: float
    uv_path: Array
    uv_from_s: float
    around: Around


@dataclass(frozen=True)
class Again:
    """Simulates and senses episodes of an evaluation again, in worker processes. shape: of the run's windows."""

    study: LiveStudy
    source: MotionSource
    where: str
    shape: WindowShape

    @limited()
    def __call__(self, item: tuple[EpisodeFacts, Sequence[Wanted]]) -> list[Seen] | None:
        """Return how the TVs of an episode move; None where it is not the same as when it was evaluated."""
        facts, wanted = item
        scenario = self.source.load(self.where)
        recording = recorded(self.source, scenario, facts.seed)
        names = {one.tv for one in wanted}
        same = (recording.lasts_s, len(recording.tracks)) == (facts.simulated_s, facts.vehicles)
        if not same or names - recording.tracks.keys():
            return None
        timing, surroundings = timing_of(self.study, self.shape), Surroundings(recording)
        alone = replace(recording, tracks={name: recording.tracks[name] for name in sorted(names)})
        stretches = watched(alone, surroundings, self.study.dataset.pairs, timing).stretches
        sensor_name = self.study.live.streams.sensor
        sensor = watch_episode(
            self.study.dataset, scenario, facts.seed, recording, sensor_name, self.study.sensor_settings
        )
        sensing = StretchSensing(self.study.dataset, recording, sensor, timing.before_decision_s)
        seen = [self._seen(sensing, one, [stretch for stretch in stretches if stretch.tv == one.tv]) for one in wanted]
        found = [one for one in seen if one is not None]
        return found if len(found) == len(wanted) else None

    def _seen(self, sensing: StretchSensing, wanted: Wanted, stretches: Sequence[Stretch]) -> Seen | None:
        decided = np.concatenate([np.empty(0), *(stretch.decision_s for stretch in stretches)])
        if not np.isin(wanted.decided_s, decided).all():
            return None
        recording, motion = sensing.recording, self.study.dataset.motion
        times, truth = _driven(recording, wanted.tv, wanted.from_s, wanted.to_s, motion)
        stretch = next(one for one in stretches if wanted.at_s in one.decision_s)
        track = next((one for one in sensing.tracks([stretch]) if wanted.at_s in one.stretch.decision_s), None)
        if track is None:
            return None
        known_s = track.stretch.start_s + np.arange(track.state.shape[1]) / self.study.dataset.record.tv_rate_hz
        inside = times[(times >= known_s[0]) & (times <= known_s[-1])]
        uv = stretch.uv[stretch.decision_s.tolist().index(wanted.at_s)]
        uv_times, uv_path = _driven(recording, uv, float(times[0]), float(times[-1]), motion)
        return Seen(
            uv=uv,
            start_s=float(times[0]),
            truth=truth,
            sensed=np.stack([np.interp(inside, known_s, track.state[axis]) for axis in (0, 1)]),
            sensed_from_s=float(inside[0] - times[0]),
            uv_path=uv_path,
            uv_from_s=float(uv_times[0] - times[0]),
            around=around_path(recording, (wanted.tv, uv), times, truth, motion),
        )


def _driven(
    recording: Recording, vehicle: str, from_s: float, to_s: float, motion: MotionSettings
) -> tuple[Array, Array]:
    """Return at which of RATE_HZ instants a second a vehicle is on the road, s, (n,), and where, m, (2, n).

    from_s, to_s: the first instant, and the end of the span of time, s.
    """
    track = recording.tracks[vehicle]
    first, last = recording.times(track)[[0, -1]]
    times = from_s + np.arange(int((to_s - from_s) * RATE_HZ + 1e-6) + 1) / RATE_HZ
    times = times[(times >= first) & (times <= last)]
    return times, states(recording, track, times, motion)[:2]


@limited()
def replay_in_traffic(
    evaluation: TrafficEvaluation, engine: Engine, feedback: Feedback = SILENT, source: MotionSource | None = None
) -> Replay | None:
    """Return the replay of the worst false alarms and missed maneuvers of an evaluation; None where there is none.

    engine: simulates their episodes again. What then differs is left out, and a remark says so. source: of motion; by
    default, the one that the study names.
    """
    result, measured = evaluation.result, next(iter(evaluation.methods.values()), None)
    by_episode: dict[int, list[Moment]] = {}
    for moment in [] if measured is None else worst_moments(evaluation.truths, measured):
        by_episode.setdefault(moment.episode, []).append(moment)
    if measured is None or not by_episode:
        return None
    study, episodes = result.made_by.study, {k: evaluation.truths[k].episode for k in by_episode}
    seen, reasons = dict[Moment, Seen](), dict[int, str]()
    try:
        source = source or motion_source(study.dataset)
        where = resolved(study.dataset.scenarios[0])
        scenario = source.load(where)
        task = Again(study, source, where, result.made_by.run.shape)
        items = {
            k: (episode.facts, [_wanted(episode, one) for one in by_episode[k]]) for k, episode in episodes.items()
        }
        number = {episode.facts.seed: k for k, episode in episodes.items()}
        with feedback.bar("simulating episodes again for the page", "episodes") as move:
            move(0, len(items))
            with closing(engine.run(task, items.values())) as outcomes:
                for done, outcome in enumerate(outcomes, 1):
                    k = number[outcome.item[0].seed]
                    if outcome.result is None:
                        reasons[k] = outcome.error or DIFFERS
                    else:
                        seen |= zip(by_episode[k], outcome.result, strict=True)
                    move(done, len(items))
    except (InputError, RunError) as error:
        feedback.message(f"warning: the page shows no moment of the traffic in motion: {error}")
        return None
    for k, reason in sorted(reasons.items()):
        feedback.message(f"warning: the page shows no moment of {_name(episodes[k])} in motion: {reason}")
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


def _remark(moments: Sequence[Moment], measured: int) -> str:
    missed = sum(moment.missed for moment in moments)
    episodes = len({moment.episode for moment in moments})
    return (
        f"False alarms: {len(moments) - missed}, missed maneuvers: {missed}, from {episodes} of {measured} measured "
        "episodes, simulated again for this page. The predictor was surest of these alarms, and gave these maneuvers "
        "the least probability before their commit. Alarms are those chosen for all six intentions."
    )


def _name(episode: LiveEpisode) -> str:
    return f"{episode.facts.scenario}-{episode.facts.seed}"


def _wanted(episode: LiveEpisode, moment: Moment) -> Wanted:
    from_s, to_s = moment.span_s
    decided = episode.time_s[rows_of(episode, moment.tv, from_s, to_s)]
    return Wanted(episode.names[moment.tv], from_s, to_s, float(decided[_nearest(decided, moment.time_s)]), decided)


def _nearest(times: Array, time_s: float) -> int:
    return int(np.abs(times - time_s).argmin())


def _moving(moment: Moment, seen: Seen, truth: Truth, alarms: Alarms) -> Moving:
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
        maneuvers=maneuvers_within(episode, moment.tv, start_s, end_s),
        truth=seen.truth,
        sensed=seen.sensed,
        uv=seen.uv_path,
        sizes=seen.around.sizes,
        others=seen.around.others,
        answers=Answers(first_s - start_s, episode.facts.decision_s, probabilities.astype(np.float64), None, True),
        alarms=alarms_within(truth, alarms, moment.tv, start_s, end_s),
        sensed_from_s=seen.sensed_from_s,
        uv_from_s=seen.uv_from_s,
        name=f"{name}: {what}, {at}",
        about=f"TV {tv}, UV {seen.uv}, {at} ({origin}). {happened}",
    )
