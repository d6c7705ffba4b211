"""Who drives: the driver model, commanded maneuvers, reactions to hazards, sway and wander.

In come settings, a seed and a running simulation; out come commands to its vehicles, and motion that wanders as
people's does.
"""
