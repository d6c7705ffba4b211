"""Pull-outs: changes to the faster side behind a UV, and when the TV passes that UV, if it does.

`overtake` needs a return within 30 s, which is mostly open when a window ends, and pull-outs that pass without
returning are in no class. Whether the TV passes the UV soon is a question that every pull-out answers.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import Literal

import numpy as np

from isac_cosim.labeling.detectors.overtake import SAMPLE_S
from isac_cosim.labeling.intentions import Event, Intention, outward
from isac_cosim.labeling.road.surroundings import Surroundings

PassOutcome = Literal["overtaken", "not_passed", "passed_did_not_return", "unresolved"]
DROPPED: tuple[PassOutcome, ...] = ("passed_did_not_return", "unresolved")
"""Outcomes that are in no class. Pull-outs with the others are overtakes and changes to the faster side."""


@dataclass(frozen=True)
class PullOut:
    """What became of a pull-out, for the UV that was ahead when it began.

    outcome: of the overtake rule (`labeling.detectors.overtake`).
    t_pass: when the TV's front bumper is level with the UV's along the road the TV drives, s; NaN if that is not
    observed.
    t_pair_end: until when the pair is observed, s: the first of both tracks ends, or the two are on different roads.
    """

    outcome: PassOutcome
    t_pass: float
    t_pair_end: float

    @property
    def dropped(self) -> bool:
        """Whether the pull-out is in no class."""
        return self.outcome in DROPPED


def pull_out_of(surroundings: Surroundings, event: Event, uv: str) -> PullOut | None:
    """Return an event as a pull-out behind a UV, or None if it is none.

    event: as it was judged for this UV. It is no pull-out where it is no change to the faster side, or where the UV is
    not ahead on the same road at its onset.
    """
    outcome = _outcome(event, outward(surroundings.recording.lefthand))
    if outcome is None:
        return None
    observed = observed_pass(surroundings, event.vehicle, uv, event.onset)
    return None if observed is None else PullOut(outcome, *observed)


def _outcome(event: Event, change_out: Intention) -> PassOutcome | None:
    """Return what became of a pull-out, None for every other event; change_out: the change to the faster side."""
    if event.mark is not None:
        return next((outcome for outcome in DROPPED if outcome == event.mark), None)
    if event.intention is Intention.OVERTAKE:
        return "overtaken"
    return "not_passed" if event.intention is change_out else None


def observed_pass(surroundings: Surroundings, tv: str, uv: str, onset: float) -> tuple[float, float] | None:
    """Return when a TV passes a UV that is ahead at `onset`, and until when the pair is observed, s.

    The TV passes when its front bumper is level with the UV's along the road that the TV drives. Positions are compared
    every `SAMPLE_S`, and interpolated linearly in between. The time of passing is NaN if the pair is not observed then.
    The pair is observed until one of the tracks ends, or until the UV leaves the road that the TV drives; what happens
    after that is not looked at, even if the two meet again. Returns None if the UV is not ahead at onset.
    """
    recording = surroundings.recording
    tracks = recording.tracks[tv], recording.tracks[uv]
    last = min(track.first_step + len(track) - 1 for track in tracks)
    stride = max(1, round(SAMPLE_S / recording.step_s))
    steps = np.unique(np.append(np.arange(surroundings.step(onset), last, stride), last))
    times = steps * recording.step_s
    gaps = surroundings.gaps(tv, uv, times)
    apart = np.flatnonzero(np.isnan(gaps))
    times, gaps = (values[: apart[0]] if len(apart) else values for values in (times, gaps))
    if not len(gaps) or gaps[0] <= 0:
        return None
    level = np.flatnonzero(gaps <= 0)
    if not len(level):
        return nan, float(times[-1])
    k = level[0]
    share = gaps[k - 1] / (gaps[k - 1] - gaps[k])
    return float(times[k - 1] + share * (times[k] - times[k - 1])), float(times[-1])
