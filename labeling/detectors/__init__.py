"""One detector per file: each finds the events of one intention in the motion of one vehicle.

In comes the motion of one vehicle along and across its road; out come events, each with onset, commit and end.

Detectors see observed motion and the surrounding traffic. They do not know about commands, sensing, datasets or models.
"""
