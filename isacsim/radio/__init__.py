"""From a vehicle and a panel to what the panel measures: waveform, channel, echo, estimation and their bounds.

In come motion, panels and settings; out come angles, ranges and radial velocities, snapshot by snapshot.

This room knows where panels and vehicles are, but nothing of fixes, tracks or filters.
"""
