"""Where recordings come from: SUMO's traffic, the kinematic model of the ASI-BIP paper, or files, by a contract."""

DEFAULT = "sumo"
"""The motion source where none is named."""
