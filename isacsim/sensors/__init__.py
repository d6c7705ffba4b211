"""Sensors, by name: what turns the true motion of stored records into what is known of it.

They know nothing of labels, datasets or predictors. To add a sensor, write a class that fulfils
`isacsim.sensors.protocol.Sensor`, and give it a line below or, in a package of its own, an entry point of GROUP.
"""

from isacsim.registry import Registry
from isacsim.sensors.isac import IsacSensor
from isacsim.sensors.protocol import Sensor
from isacsim.sensors.radar import RadarSensor
from isacsim.sensors.truth import TruthSensor

GROUP = "isac_cosim.sensors"
SENSORS: Registry[Sensor] = Registry(
    "sensor",
    {
        "isac": IsacSensor(),
        "radar": RadarSensor(),
        "truth": TruthSensor(),
    },
    GROUP,
)
