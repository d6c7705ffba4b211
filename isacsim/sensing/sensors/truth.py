"""The true state as a sensor: what sensing costs is measured against it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from isac_cosim.isacsim.sensing.passages import Passage, SensedRecord, WatchedTraffic
from isac_cosim.isacsim.sensing.sensors.by_record import RecordPicture
from isac_cosim.isacsim.sensing.sensors.protocol import SensorSettings


class TruthSensor:
    """No error and no SNR; every record is usable."""

    label = "the true state"
    cost_s = 0.4e-6
    by_sites = False
    filtered = False
    unusable = "never"

    def refusal(self, settings: SensorSettings) -> str | None:
        """The truth is always there."""
        return None

    def watch(self, traffic: WatchedTraffic, settings: SensorSettings) -> TruthPicture:
        """The truth needs no watching."""
        return TruthPicture(traffic)


class TruthPicture(RecordPicture):
    """Knows the motion itself, wherever the vehicle is."""

    def record(self, passages: Sequence[Passage]) -> list[SensedRecord]:
        """Return the true states."""
        return [
            SensedRecord(state=truth, fixes=truth[:4], n_sites=0, snr_db=np.nan, detected=1.0, usable=True)
            for truth in (passage.truth for passage in passages)
        ]
