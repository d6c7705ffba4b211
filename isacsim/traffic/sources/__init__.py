"""Where recordings come from: SUMO's traffic, or the kinematic model of the ASI-BIP paper."""
