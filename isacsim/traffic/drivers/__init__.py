"""Who drives: the driver model, commanded maneuvers, reactions to hazards, sway and wander."""
