"""All vehicles in a panel's view in one echo: detections, tracks, and who is who.

This room knows panels, echoes and filters, but nothing of records, labels or sensors, which ask it.
"""
