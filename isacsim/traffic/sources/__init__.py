"""Where recordings come from: SUMO's traffic, the kinematic model of the ASI-BIP paper, or files, by a contract.

In come a scenario or files, and a seed; out comes a recording.
"""

DEFAULT = "sumo"
"""The motion source where none is named."""
