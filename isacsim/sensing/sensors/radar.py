"""The UV's own radar as a sensor."""

from __future__ import annotations

from isac_cosim.isacsim.sensing.chain import SensedRecord
from isac_cosim.isacsim.sensing.onboard_radar import sense_onboard
from isac_cosim.isacsim.sensing.sensors.protocol import SensorSettings, StoredRecords


class RadarSensor:
    """The radar that the UV carries (`isacsim.sensing.onboard_radar`)."""

    label = "the UV's own radar"
    cost_s = 3.1e-6
    by_sites = False
    filtered = True
    unusable = "not_detected"

    def refusal(self, settings: SensorSettings) -> str | None:
        """A line of sight past other vehicles cannot be sensed anew."""
        if settings.radar.condition != "nlos" or settings.radar.pattern != "line_of_sight":
            return None
        return (
            "pattern line_of_sight needs the other vehicles, which a dataset does not hold; choose random or contiguous"
        )

    def sense(self, records: StoredRecords, settings: SensorSettings) -> list[SensedRecord]:
        """Sense the records from their UVs."""
        carrier, past = records.carrier, records.past
        return sense_onboard(records.truth, records.rate_hz, carrier, settings.radar, records.keys, past=past)
