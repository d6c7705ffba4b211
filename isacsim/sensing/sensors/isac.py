"""The sites of the mobile network as a sensor."""

from __future__ import annotations

from isac_cosim.isacsim.sensing.chain import SensedRecord, sense
from isac_cosim.isacsim.sensing.sensors.protocol import SensorSettings, StoredRecords


class IsacSensor:
    """The sites, through the chain of `isacsim.sensing.chain`."""

    label = "the sites"
    cost_s = 9.5e-6
    by_sites = True
    filtered = True
    unusable = "too_few_sites"

    def refusal(self, settings: SensorSettings) -> str | None:
        """Blockage cannot be sensed anew."""
        if not settings.sensing.channel.blockage:
            return None
        return (
            "blockage needs the other vehicles, which a dataset does not hold; generate with it, or sense without it "
            "(--no-blockage)"
        )

    def sense(self, records: StoredRecords, settings: SensorSettings) -> list[SensedRecord]:
        """Sense the records with the sites."""
        return sense(records.truth, records.rate_hz, records.sites, settings.sensing, records.keys, past=records.past)
