"""All vehicles in a panel's view in one echo: detections, tracks, and who is who.

In comes the motion of all vehicles of an episode; out come the network's tracks at every instant, and whose they are.

This room knows panels, echoes and filters, but nothing of records, labels or sensors, which ask it.
"""
