"""Whether the true motion in a dataset does what its labels say.

Labels come from the speed of a recording, the states of a dataset from positions in the plane. Where the two disagree,
a predictor learns from motion that its label is not about.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy.ndimage import minimum_filter1d

from isac_cosim.base.arrays import Array, BoolArray
from isac_cosim.base.errors import InputError
from isac_cosim.base.settings import checked
from isac_cosim.labeling.dataset.dataset import Dataset
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Intention

ALONG = frozenset({Intention.HARD_BRAKE, Intention.HARD_ACCEL, Intention.FOLLOWING})
"""The intentions whose definitions say something of the acceleration along the road."""
LIMIT_MPS2 = 0.5
"""Labels and truth that differ by more than this disagree, m/s2."""
ALONE_BEFORE_S = 0.5
"""From this long before the onset on, the record of an event holds no other one, unless the study says otherwise, s."""
LEAST_MPS = 1.0
"""Below, a vehicle may move across its lane rather than along it, m/s."""
STANDING_MPS = 0.1
"""Below, a vehicle has no direction of travel, m/s."""


def label_truth(dataset: Dataset) -> dict[str, Any] | None:
    """Compare the acceleration along the path, in `tv_truth`, with what the built-in definitions of the labels say.

    A hard brake or a hard acceleration has its threshold at the commit. Following keeps within its bounds. The record
    of anything else holds no hard brake and no hard acceleration from shortly before the onset on.
    Returns the number of samples `compared`; the `limit_mps2`; the `share` of samples that differ by more; the largest
    difference, `worst_mps2`; and the `sample_id` that has it. Returns None without samples, or where a detector of
    another package finds one of these intentions.
    """
    definitions = _definitions(dataset)
    frame = dataset.frame(["sample_id", "label", "t_start", "t_onset", "t_commit"])
    if definitions is None or not len(frame):
        return None
    alone_s = float(dataset.meta.study.get("record", {}).get("alone_before_s", ALONE_BEFORE_S))
    label = frame["label"].to_numpy(np.int64)
    times = (frame[["t_onset", "t_commit"]].to_numpy() - frame[["t_start"]].to_numpy()).T
    differences, start = np.empty(len(frame)), 0
    # One shard at a time: all of them may exceed the memory.
    for shard in dataset.arrays_by_shard("tv_truth"):
        for k, states in enumerate(shard["tv_truth"].astype(np.float64), start):
            motion = _Motion.of(states, dataset.meta.tv_rate_hz)
            differences[k] = _difference(motion, Intention(int(label[k])), times[:, k], definitions, alone_s)
        start += len(shard["tv_truth"])
    worst = int(differences.argmax())
    return {
        "compared": len(frame),
        "limit_mps2": LIMIT_MPS2,
        "share": round(float((differences > LIMIT_MPS2).mean()), 4),
        "worst_mps2": round(float(differences[worst]), 3),
        "sample_id": str(frame["sample_id"].iloc[worst]),
    }


def _definitions(dataset: Dataset) -> LabelSettings | None:
    """Return the definitions of a dataset's labels; None where they are not, or not all, the built-in ones."""
    try:
        settings = checked(LabelSettings, dataset.meta.study.get("labels", {}), dataset.path)
    except InputError:  # a detector that is not installed here
        return None
    return settings if settings.replaced.isdisjoint(ALONG) else None


@dataclass(frozen=True)
class _Motion:
    """One record: times after its start, s, the acceleration along the path, m/s2, and where it counts, (S,) each."""

    times: Array
    along: Array
    known: BoolArray
    rate_hz: float

    @classmethod
    def of(cls, states: Array, rate_hz: float) -> Self:
        """Return the motion of true states (6, S)."""
        _, _, vx, vy, ax, ay = states
        speed = np.hypot(vx, vy)
        along = (vx * ax + vy * ay) / np.maximum(speed, STANDING_MPS)
        return cls(np.arange(len(vx)) / rate_hz, along, speed > LEAST_MPS, rate_hz)

    def held(self, sign: float, hold_s: float, start: float) -> float:
        """Return the highest level at or above which `sign` times the acceleration stays for a time, after a start, s.

        It is -inf where the motion is shorter than that.
        """
        signal, length = sign * self.along[self.known & (self.times >= start)], max(1, round(hold_s * self.rate_hz))
        if len(signal) < length:
            return -np.inf
        lowest = minimum_filter1d(signal, length, mode="nearest")
        return float(lowest[length // 2 : len(signal) - (length - 1) // 2].max())


def _difference(
    motion: _Motion, intention: Intention, times: Array, definitions: LabelSettings, alone_s: float
) -> float:
    """Return by how much the true acceleration differs from what a label says of it, m/s2.

    times: of onset and commit, s after the start of the record. alone_s: how long before the onset no other event is.
    """
    onset, commit = times
    brake, accel, following = definitions.hard_brake, definitions.hard_accel, definitions.following
    if intention in (Intention.HARD_BRAKE, Intention.HARD_ACCEL):
        wanted = -brake.threshold_mps2 if intention is Intention.HARD_BRAKE else accel.threshold_mps2
        return abs(float(np.interp(commit, motion.times, motion.along)) - wanted)
    if intention is Intention.FOLLOWING:
        if following.acceleration_mps2 is None:
            return 0.0
        near = motion.known & (np.abs(motion.times - onset) <= following.after_s)
        return float(max(np.abs(motion.along[near]).max(initial=0.0) - following.acceleration_mps2, 0.0))
    return max(
        motion.held(-1.0, brake.hold_s, onset - alone_s) - brake.threshold_mps2,
        motion.held(1.0, accel.hold_s, onset - alone_s) - accel.threshold_mps2,
        0.0,
    )
