"""Sensors, by name: what turns the true motion of stored records into what is known of it.

They know nothing of labels, datasets or predictors. To add a sensor, write a class that fulfils
`protocol.Sensor`, and give it a line below or, in a package of its own, an entry point of GROUP.
"""

from isac_cosim.base.registry import Registry
from isac_cosim.isacsim.sensing.sensors.isac import IsacSensor
from isac_cosim.isacsim.sensing.sensors.protocol import Sensor
from isac_cosim.isacsim.sensing.sensors.radar import RadarSensor
from isac_cosim.isacsim.sensing.sensors.truth import TruthSensor

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
