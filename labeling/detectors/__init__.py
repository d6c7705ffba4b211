"""One detector per file: each finds the events of one intention in the motion of one vehicle.

Detectors see observed motion and the surrounding traffic. They do not know about commands, sensing, datasets or models.
"""
