"""From the sites' measurements to fixes, and from fixes to a vehicle's state over time.

This room knows geometry and standard deviations, but nothing of waveforms, echoes or channels.
"""
