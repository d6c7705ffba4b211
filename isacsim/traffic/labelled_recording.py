"""Recordings whose source says what each target vehicle does, so that no detector has to find it."""

from __future__ import annotations

from dataclasses import dataclass

from isacsim.traffic.recording import Recording


@dataclass(frozen=True)
class GeneratedManeuver:
    """One maneuver that a motion source generated, with the pair of vehicles that it is about.

    intention: its name in datasets, such as `hard_brake`. tv, uv: ids of the target vehicle, which does it, and of the
    own vehicle. onset, commit, end: first motion, decision and end of the maneuver, s of simulation time, as in
    `labeling.intentions.Event`. cause: what the target vehicle reacts to; empty if it acts on its own accord.
    """

    intention: str
    tv: str
    uv: str
    onset: float
    commit: float
    end: float
    cause: str = ""


@dataclass(frozen=True)
class LabelledRecording(Recording):
    """A recording with the maneuvers that its source generated.

    Each maneuver becomes one sample with the generated label. The detectors run as well, to be compared with these
    labels (`labeling.samples.generated_labels`). `save` stores the motion only.
    """

    maneuvers: tuple[GeneratedManeuver, ...] = ()
