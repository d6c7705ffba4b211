"""How far a predictor's answers can be trusted: calibration, and scores that recognise unknown maneuvers.

In come a predictor's outputs; out come a temperature, and scores of how well a window fits the known intentions.

Knows nothing of how predictors are trained or evaluated.
"""
