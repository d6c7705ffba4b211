"""Simulates and senses moments of an evaluation in traffic again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from isac_cosim.base.arrays import Array
from isac_cosim.base.workers.threads import limited
from isac_cosim.evaluation.in_traffic.settings import LiveStudy
from isac_cosim.evaluation.in_traffic.streams.episode import timing_of
from isac_cosim.evaluation.in_traffic.streams.store import EpisodeFacts
from isac_cosim.evaluation.report.replay.content import RATE_HZ, Places
from isac_cosim.evaluation.report.replay.others import Around, around_path
from isac_cosim.isacsim.traffic.motion import MotionSettings, states
from isac_cosim.isacsim.traffic.recordings.recording import Recording
from isac_cosim.isacsim.traffic.sources.protocol import MotionSource, recorded
from isac_cosim.labeling.generation.watching import watch_episode
from isac_cosim.labeling.road.surroundings import Surroundings
from isac_cosim.labeling.streams.sensed import StretchSensing
from isac_cosim.labeling.streams.stretches import Stretch, watched
from isac_cosim.models.predictors.protocol import WindowShape


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
    truth: Places
    sensed: Places
    sensed_from_s: float
    uv_path: Places
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
        times, truth = driven(recording, wanted.tv, wanted.from_s, wanted.to_s, motion)
        stretch = next(one for one in stretches if wanted.at_s in one.decision_s)
        track = next((one for one in sensing.tracks([stretch]) if wanted.at_s in one.stretch.decision_s), None)
        if track is None:
            return None
        known_s = track.stretch.start_s + np.arange(track.state.shape[1]) / self.study.dataset.record.tv_rate_hz
        inside = times[(times >= known_s[0]) & (times <= known_s[-1])]
        uv = stretch.uv[stretch.decision_s.tolist().index(wanted.at_s)]
        uv_times, uv_path = driven(recording, uv, float(times[0]), float(times[-1]), motion)
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


def driven(
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
