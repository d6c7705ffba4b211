"""Near misses: motion that stays just under the threshold of a label."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import Field

from isac_cosim.base.settings import Settings
from isac_cosim.labeling.detectors.evasive_swerve import EvasiveSwerveDetector
from isac_cosim.labeling.detectors.hard_accel import HardAccelDetector
from isac_cosim.labeling.detectors.hard_brake import HardBrakeDetector
from isac_cosim.labeling.detectors.protocol import Detector, VehicleView
from isac_cosim.labeling.detectors.settings import LabelSettings
from isac_cosim.labeling.intentions import Event


class NearMissSettings(Settings):
    """From which share of its threshold on a motion is a near miss; by default from 3 and 2 m/s2 along the road."""

    hard_brake: float = Field(0.75, gt=0.0, le=1.0, description="share of the threshold of a hard brake")
    hard_accel: float = Field(0.8, gt=0.0, le=1.0, description="share of the threshold of a hard acceleration")
    evasive_swerve: float = Field(
        0.75, gt=0.0, le=1.0, description="share of the thresholds of a swerve: both accelerations, and the way aside"
    )


def near_misses(
    view: VehicleView, events: Sequence[Event], labels: LabelSettings, settings: NearMissSettings
) -> list[Event]:
    """Return the near misses of one vehicle: the events of softer detectors that are no events of that intention.

    A softer detector has lower thresholds, and asks for no time above them. A lane change has no threshold, and so no
    near miss; nor has an intention whose definition a selected detector replaces.
    events: those of the vehicle, after precedence.
    """
    return [
        soft
        for detector in _softer(labels, settings)
        for soft in detector.detect(view)
        if soft.intention not in labels.replaced and not any(_overlap(soft, event) for event in events)
    ]


def _softer(labels: LabelSettings, settings: NearMissSettings) -> list[Detector]:
    """Return the built-in detectors that have thresholds, with lower ones."""
    brake, accel, swerve = labels.hard_brake, labels.hard_accel, labels.evasive_swerve
    share = settings.evasive_swerve
    return [
        HardBrakeDetector(
            brake.model_copy(update={"threshold_mps2": settings.hard_brake * brake.threshold_mps2, "hold_s": 0.0})
        ),
        HardAccelDetector(
            accel.model_copy(update={"threshold_mps2": settings.hard_accel * accel.threshold_mps2, "hold_s": 0.0})
        ),
        EvasiveSwerveDetector(
            swerve.model_copy(
                update={name: share * getattr(swerve, name) for name in ("threshold_mps2", "reversal_mps2", "aside_m")}
            )
        ),
    ]


def _overlap(soft: Event, event: Event) -> bool:
    """Return whether a softer detector found an event that is one."""
    return soft.intention is event.intention and soft.onset <= event.end and event.onset <= soft.end
